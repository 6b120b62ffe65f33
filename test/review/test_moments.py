# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Moments of resonance and shares of time, for drives whose results are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from linkage_vibration.review.log import Log, read_log
from linkage_vibration.review.moments import angle_shares, margin_shares, moments, worst
from test.support.messages import resonance


def with_resonances(
    log: Log, state: list[int], excitation: list[str], mode: list[int], margin: list[float]
) -> Log:
    """Return the first predictions of a log with the given resonances."""
    n = len(state)
    frequency = log.natural_frequencies[np.arange(n), mode]
    relative = np.array(margin)
    found = resonance(
        state=np.array(state),
        excitation=np.array(excitation),
        excitation_frequency=frequency * (1.0 + relative),
        mode=np.array(mode),
        natural_frequency=frequency,
        margin=frequency * relative,
        relative_margin=relative,
    )
    rows = {
        name: getattr(log, name)[:n]
        for name in ("stamps", "status", "crank_angle", "natural_frequencies")
    }
    return replace(log, **rows, resonances=found)


def test_moments_are_the_stretches_of_warnings(drive: Path) -> None:
    """A moment ends with its warning, and where the excitation or the mode changes."""
    log = with_resonances(
        read_log(drive),
        [0, 1, 1, 1, 1, 0, 1, 2],
        ["a", "a", "a", "b", "b", "b", "b", ""],
        [0, 0, 0, 0, 1, 1, 1, 0],
        [0.3, 0.05, -0.01, 0.04, 0.03, 0.2, 0.02, np.nan],
    )
    found = moments(log)
    shown = [(m.excitation, m.mode, m.nearest, m.crossed) for m in found]
    assert shown == [("a", 0, 2, True), ("b", 0, 3, False), ("b", 1, 4, False), ("b", 1, 6, False)]
    assert [(m.start, m.end) for m in found][:2] == [(0.01, 0.02), (0.03, 0.03)]
    assert found[0].excitation_frequency == pytest.approx(0.99 * found[0].natural_frequency)


def test_worst_are_the_nearest_in_order_of_time(
    drive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The moments with the smallest margins are kept, in order of time."""
    monkeypatch.setattr("linkage_vibration.review.moments.MAX_MOMENTS", 2)
    state, excitation = [1, 0, 1, 0, 1], ["a"] * 5
    margin = [0.01, 0.5, 0.09, 0.5, -0.02]
    log = with_resonances(read_log(drive), state, excitation, [0] * 5, margin)
    assert [m.nearest for m in worst(moments(log))] == [0, 4]


def test_shares_add_up_to_the_time_with_numbers(drive: Path) -> None:
    """The shares exclude exactly the time of predictions without numbers, and the gaps."""
    log = read_log(drive)
    sound = np.isfinite(log.natural_frequencies[:-1, 0]).mean()
    margins = margin_shares(log)
    assert margins is not None
    assert angle_shares(log)[1].sum() == pytest.approx(sound, rel=1e-9)
    assert margins[1].sum() == pytest.approx(sound, rel=1e-9)


def test_shares_of_a_known_drive(drive: Path) -> None:
    """Two margins that each last for half of the time give two bars of one half."""
    log = with_resonances(
        read_log(drive), [1] * 101, ["a"] * 101, [0] * 101, [0.01, -0.21] * 50 + [0.01]
    )
    found = margin_shares(log)
    assert found is not None
    edges, shares = found
    np.testing.assert_allclose(shares[shares > 0.0], [0.5, 0.5], rtol=1e-9)
    assert edges[np.flatnonzero(shares)].tolist() == pytest.approx([0.0, 0.2])


def test_first_and_last_prediction_of_a_moment(drive: Path) -> None:
    """A moment holds its first and its last warning, and the numbers at the nearest of them."""
    log = with_resonances(
        read_log(drive), [0, 1, 1, 1, 0], ["a"] * 5, [1] * 5, [0.3, -0.08, -0.02, -0.05, 0.3]
    )
    [found] = moments(log)
    assert (found.first, found.last, found.nearest) == (1, 3, 2)
    assert (found.start, found.end) == (float(log.times[1]), float(log.times[3]))
    assert found.natural_frequency == log.natural_frequencies[2, 1]
    assert (found.relative_margin, found.crossed) == (-0.02, False)
    assert moments(replace(log, resonances=None)) == []


@pytest.mark.parametrize(("margin", "crossed"), [(0.0, True), (1e-9, False)])
def test_a_margin_of_zero_is_a_crossing(drive: Path, margin: float, crossed: bool) -> None:
    """The frequencies crossed if the margin reached zero, from either side."""
    for sign in (1.0, -1.0):
        margins = [sign * 0.05, sign * margin, sign * 0.04]
        log = with_resonances(read_log(drive), [1] * 3, ["a"] * 3, [0] * 3, margins)
        assert moments(log)[0].crossed == crossed


def test_bins_of_shares(drive: Path) -> None:
    """Angles have 45 bins over the table; margins have 25 of 2 % up to 50 %, the last one more."""
    log = read_log(drive)
    edges, shares = angle_shares(log)
    assert log.table is not None
    assert (len(edges), len(shares)) == (46, 45)
    assert (edges[0], edges[-1]) == log.table.alpha3_range
    alone = angle_shares(replace(log, table=None))[0]
    known = log.crank_angle[np.isfinite(log.peak_magnitude)]
    assert (alone[0], alone[-1]) == (known.min(), known.max())
    made = with_resonances(log, [1] * 5, ["a"] * 5, [0] * 5, [0.019, -0.021, 0.499, 0.7, 3.0])
    found = margin_shares(made)
    assert found is not None
    np.testing.assert_allclose(found[0], np.arange(26) * 0.02, atol=1e-12)
    assert np.flatnonzero(found[1]).tolist() == [0, 1, 24]
    assert found[1][24] == pytest.approx(2.0 * found[1][0])  # the last prediction has no duration


def test_shares_of_a_single_moment(drive: Path) -> None:
    """One prediction takes no time, so that no share of it is known."""
    log = with_resonances(read_log(drive), [1], ["a"], [0], [0.01])
    found = margin_shares(log)
    assert found is not None
    assert not found[1].any()


def test_bins_without_a_table(drive: Path) -> None:
    """The bins reach over the known angles, also over a single one, and over 1 rad without any."""
    log = replace(read_log(drive), table=None)
    still = replace(log, crank_angle=np.full(len(log.stamps), 2.0))
    edges, shares = angle_shares(still)
    assert (edges[0], edges[-1]) == (2.0, pytest.approx(2.0 + 1e-6, abs=1e-12))
    assert shares[0] == shares.sum() > 0.9
    unknown = replace(log, peak_magnitude=np.full(len(log.stamps), np.nan))
    edges, shares = angle_shares(unknown)
    assert (edges[0], edges[-1], shares.sum()) == (0.0, 1.0, 0.0)
