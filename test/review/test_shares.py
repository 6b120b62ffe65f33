# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Shares of time at angles and load ratios, for drives whose results are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from linkage_vibration.review.log import Log, read_log
from linkage_vibration.review.shares import angle_shares, load_shares
from test.support.messages import resonance


def with_loads(log: Log, ratios: list[float]) -> Log:
    """Return the first predictions of a log with resonances of the given load ratios."""
    rows = {
        name: getattr(log, name)[: len(ratios)]
        for name in ("stamps", "status", "crank_angle", "natural_frequencies")
    }
    return replace(log, **rows, resonances=resonance(total_load_ratio=np.array(ratios)))


def test_shares_add_up_to_the_time_with_numbers(drive: Path) -> None:
    """The shares exclude exactly the time of predictions without numbers, and the gaps."""
    log = read_log(drive)
    sound = np.isfinite(log.natural_frequencies[:-1, 0]).mean()
    assert angle_shares(log)[1].sum() == pytest.approx(sound, rel=1e-9)


def test_shares_of_a_known_drive(drive: Path) -> None:
    """Two load ratios that each last for half of the time give two bars of one half."""
    found = load_shares(with_loads(read_log(drive), [0.01, 0.21] * 50 + [0.01]))
    assert found is not None
    edges, shares = found
    np.testing.assert_allclose(shares[shares > 0.0], [0.5, 0.5], rtol=1e-9)
    assert edges[np.flatnonzero(shares)].tolist() == pytest.approx([0.0, 0.2])


def test_bins_of_shares(drive: Path) -> None:
    """Angles have 45 bins over the table; load ratios have 30 of 0.02 up to 0.6, the last more."""
    log = read_log(drive)
    edges, shares = angle_shares(log)
    assert log.table is not None
    assert (len(edges), len(shares)) == (46, 45)
    assert (edges[0], edges[-1]) == log.table.alpha3_range
    alone = angle_shares(replace(log, table=None))[0]
    known = log.crank_angle[np.isfinite(log.peak_magnitude)]
    assert (alone[0], alone[-1]) == (known.min(), known.max())
    found = load_shares(with_loads(log, [0.019, 0.021, 0.599, 0.7, 3.0]))
    assert found is not None
    np.testing.assert_allclose(found[0], np.arange(31) * 0.02, atol=1e-12)
    assert np.flatnonzero(found[1]).tolist() == [0, 1, 29]
    assert found[1][29] == pytest.approx(2.0 * found[1][0])  # the last prediction has no duration


def test_unknown_loads_have_no_shares(drive: Path) -> None:
    """Without a known load there is no histogram."""
    assert load_shares(with_loads(read_log(drive), [np.nan, np.nan])) is None
    assert load_shares(replace(read_log(drive), resonances=None)) is None


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
