# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of an export are the differences that were put into its numbers."""

from dataclasses import fields, replace

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
from linkage_vibration.export.evaluation import ExportErrors, compare, evaluate, exported
from linkage_vibration.support.resources import PAPER_TABLE, config_file
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
    """A change of one kind of number is the error of that kind, and of nothing else."""
    n, peaks = constants.n_modes, constants.n_peaks
    size = pytest.approx(abs(share), rel=1e-9)
    found = compare(constants, scaled(constants, 0, n, share))
    assert (found.frequency, found.damping_ratio, found.peak) == (size, 0.0, 0.0)
    assert (found.slope, found.stddev) == (size, size)  # of their largest values
    found = compare(constants, scaled(constants, n, 2 * n, share))
    assert (found.frequency, found.damping_ratio, found.slope) == (0.0, size, 0.0)
    found = compare(constants, scaled(constants, 2 * n + peaks, 2 * n + 2 * peaks, share))
    assert (found.frequency, found.damping_ratio, found.peak) == (0.0, 0.0, size)


@pytest.mark.parametrize(("share", "other"), [(0.99e-3, False), (1.01e-3, True)])
def test_another_peak(constants: Constants, share: float, other: bool) -> None:
    """A frequency that differs by more than a thousandth belongs to another peak."""
    n = 2 * constants.n_modes
    found = compare(constants, scaled(constants, n, n + constants.n_peaks, share))
    assert found.other_peaks == (found.samples if other else 0)
    assert found.peak == (0.0 if other else pytest.approx(share, rel=1e-9))
    assert ("another of two equally high peaks" in found.text) == other


def test_what_an_export_says_of_its_errors(constants: Constants) -> None:
    """Measured errors, with a quarter more, are added to those of the pieces."""
    changed = scaled(constants, 0, constants.n_modes, 1e-4)
    chosen, errors = exported(constants, changed, in_single=False)
    assert errors.frequency == pytest.approx(1e-4)
    np.testing.assert_allclose(chosen.piece_errors, constants.piece_errors + 1.25e-4, rtol=1e-6)
    same, none = exported(constants, constants, in_single=False)
    assert same is constants
    assert none.text.endswith("are those of the table, to the last bit.")
    for name in ("frequency", "damping_ratio", "slope", "stddev", "peak"):
        text = replace(none, **{name: 3e-7}).text
        assert "3.0e-07" in text
        assert "to the last bit" not in text
    assert {field.name for field in fields(ExportErrors)} >= {"other_peaks", "samples"}


def test_cells_about_rounded_starts(constants: Constants) -> None:
    """In single precision, the cubics of rounded starts have the same values to its precision."""
    angles = np.linspace(*constants.alpha3_range, 501)[1:-1]
    coarse = single(constants)
    exact = evaluate(constants, angles, np.zeros(len(angles)))
    rounded = angles.astype(np.float32)
    found = evaluate(coarse, rounded, np.zeros(len(angles), np.float32))
    moved = exact.frequency_slopes * (rounded.astype(float) - angles)[:, np.newaxis]
    error = found.natural_frequencies - (exact.natural_frequencies + moved)
    assert np.abs(error / exact.natural_frequencies).max() < 4 * np.finfo(np.float32).eps


def test_gaps_of_neighbouring_cells() -> None:
    """Cells without cubics that touch are one gap."""
    ends, without = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], np.array([True, False, True, True, False])
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


@pytest.mark.parametrize("tolerance", [0.0, 0.1, -1e-6, float("nan")])
def test_tolerances_that_are_refused(constants: Constants, tolerance: float) -> None:
    """A tolerance is greater than 0 and less than 0.1."""
    with pytest.raises(ExportError, match=r"is not between 0 and 0\.1; give 1e-6"):
        fewer_cells(constants, tolerance)
    assert len(fewer_cells(constants, 0.0999).starts) < len(constants.starts)
