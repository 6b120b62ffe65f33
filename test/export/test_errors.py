# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of an export are the differences that were put into its numbers."""

from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.export.constants import (
    Constants,
    ExportError,
    _gaps,
    _kept_rows,
    constants_of,
    fewer_cells,
    single,
)
from linkage_vibration.export.cubics import extremes, moved
from linkage_vibration.export.errors import bounds, chosen_constants
from linkage_vibration.support.resources import PAPER_TABLE, config_file
from linkage_vibration.table.cells import Cells
from linkage_vibration.table.table import load_table


@pytest.fixture(scope="module")
def constants() -> Constants:
    """Return the numbers of the table of the paper's linkage."""
    return constants_of(load_table(config_file(PAPER_TABLE)))


def scaled(constants: Constants, first: int, last: int, share: float) -> Constants:
    """Return constants some of whose values are larger by a share."""
    cubics = constants.cubics.copy()
    cubics[:, :, first:last] *= 1.0 + share
    return replace(constants, cubics=cubics)


@pytest.mark.parametrize("share", [1e-4, -2e-3])
def test_each_error_is_that_of_its_number(constants: Constants, share: float) -> None:
    """A change of one kind of number is the bound of that kind, and of nothing else.

    The smallest value of a cell is less than 1 % below the largest one.
    """
    n, peaks = constants.n_modes, constants.n_peaks
    size, none = pytest.approx(1.005 * abs(share), rel=5e-3), pytest.approx(0.0, abs=1e-13)
    actual = bounds(constants, scaled(constants, 0, n, share))
    assert (actual.frequency, actual.damping_ratio, actual.peak) == (size, none, none)
    assert actual.slope == pytest.approx(abs(share), rel=1e-9)  # of the largest value
    actual = bounds(constants, scaled(constants, n, 2 * n, share))
    assert (actual.frequency, actual.damping_ratio, actual.slope) == (none, size, none)
    for first in (2 * n, 2 * n + peaks):
        actual = bounds(constants, scaled(constants, first, first + peaks, share))
        assert (actual.frequency, actual.damping_ratio, actual.peak) == (none, none, size)


def test_extremes_of_cubics() -> None:
    """They are those of the four kinds of cubics whose extremes are known on paper."""
    cubics = np.array([[1.0, -3.0, 0.0, 5.0], [0, 1.0, -2.0, 0], [0, 0, 2.0, 1.0], [0, 0, 0, 7.0]])
    low, high = extremes(cubics[:, :, np.newaxis], np.array([3.0, 3.0, 3.0, 3.0]))
    np.testing.assert_allclose(low[:, 0], [1.0, -1.0, 1.0, 7.0])  # at 2, 1, 0 and anywhere
    np.testing.assert_allclose(high[:, 0], [5.0, 3.0, 7.0, 7.0])
    low, high = extremes(cubics[:1, :, np.newaxis], np.array([1.0]))  # before the extreme at 2
    assert (low[0, 0], high[0, 0]) == (3.0, 5.0)
    np.testing.assert_array_equal(
        moved(cubics[:1, :, np.newaxis], np.array([2.0]))[0, :, 0], [1.0, 3.0, 0.0, 1.0]
    )


def test_what_an_export_says_of_its_errors(constants: Constants) -> None:
    """Bounds are added to those of the pieces, and rounded up where they are printed."""
    changed = scaled(constants, 0, constants.n_modes, 1e-4)
    chosen, errors = chosen_constants(constants, changed, in_single=False)
    assert 1e-4 < errors.frequency < 1.01e-4
    wider = constants.piece_errors + errors.frequency
    np.testing.assert_allclose(chosen.piece_errors, wider, rtol=1e-12)
    assert (chosen.piece_errors > wider).all()
    same, none = chosen_constants(constants, constants, in_single=False)
    assert same is constants
    assert none.text.endswith("are those of the table, to the last bit.")
    for name in ("frequency", "damping_ratio", "slope", "peak"):
        text = replace(none, **{name: 3.02e-7}).text
        assert "3.1e-07" in text
        assert "to the last bit" not in text


def test_cells_about_rounded_starts(constants: Constants) -> None:
    """In single precision, the cubics of rounded starts have the same values to its precision."""
    coarse, shift = single(constants), 1e-3
    exact = Cells(constants.starts, constants.cubics).many_values(constants.starts + shift)
    apart = constants.starts + shift - coarse.starts.astype(float)
    powers = np.stack([apart**3, apart**2, apart, apart**0])[..., np.newaxis]
    actual = (coarse.cubics.swapaxes(0, 1) * powers).sum(axis=0)
    assert 0.0 < np.nanmax(np.abs(actual / exact - 1.0)) < 4 * np.finfo(np.float32).eps


def test_gaps_of_neighbouring_cells() -> None:
    """Cells without cubics that touch are one gap."""
    ends, without = np.arange(6.0), np.array([True, False, True, True, False])
    assert _gaps(ends, without) == ((0.0, 1.0), (2.0, 4.0))
    assert _gaps(ends, ~without) == ((1.0, 2.0), (4.0, 5.0))


@pytest.mark.parametrize(("share", "every"), [(0.009, 8), (0.011, 2)])
def test_rows_that_are_kept(share: float, every: int) -> None:
    """Of 9 rows every second is left out, repeatedly, as long as a line between the others holds.

    It holds within 1 %: without the third and the seventh row, the line between 1 and 1 is left.
    """
    rows = np.ones((9, 2))
    rows[[2, 6], 1] = 1.0 / (1.0 - share)
    rows[[1, 3, 5, 7], 1] = 0.5 * (1.0 + rows[2, 1])
    assert _kept_rows(rows) == every
    assert _kept_rows(np.ones((9, 2))) == 8
    assert _kept_rows(np.ones((8, 2))) == 1  # seven steps have no half


@pytest.mark.parametrize("tolerance", [0.0, 1.01e-3, 1e-2, -1e-6, float("nan")])
def test_tolerances_that_are_refused(constants: Constants, tolerance: float) -> None:
    """A tolerance is greater than 0 and at most 1e-3."""
    with pytest.raises(ExportError, match="is not between 0 and 1e-3; give 1e-6"):
        fewer_cells(constants, tolerance)
    assert len(fewer_cells(constants, 1e-3).starts) < len(constants.starts)
