# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A correction by measured frequencies, beside closed forms and models with other numbers."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmark.listening.simulation import FILE, GRID, HEAVE, modes
from linkage_vibration.listening import correction
from linkage_vibration.listening.correction import Correction, CorrectionError, read_correction
from linkage_vibration.listening.live import sensor_monitor
from linkage_vibration.listening.number_effects import NumberEffects
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.served import read_served
from linkage_vibration.readers.targets import Target
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table, load_table

HEIGHTS = 5, 24  # of `GRID`: 109 and 166 deg


@cache
def table() -> Table:
    """Return the table of the tractor."""
    return load_table(config_file(f"tables/{FILE}.npz"))


@cache
def true(mass: float, oil: float) -> FloatArray:
    """Return the frequencies of the heave of a model with other numbers, (n,), Hz."""
    return np.asarray(np.abs(modes(mass, oil, False)[0])[:, HEAVE] / (2.0 * math.pi))


def targets(frequencies: FloatArray) -> list[Target]:
    """Return targets of the heave at two heights, with deviations of 1 %."""
    return [Target(HEAVE + 1, float(GRID[i]), float(frequencies[i]), 0.01) for i in HEIGHTS]


@pytest.mark.parametrize(("mass", "oil"), [(1.2, 1.0), (1.2, 0.7), (0.8, 0.7), (1.0, 0.7)])
def test_the_whole_stroke_follows_two_heights(mass: float, oil: float) -> None:
    """The largest error of the heave falls below 1.1 %, and below two deviations."""
    predicted, wanted = table().evaluate(GRID)[:, HEAVE], true(mass, oil)
    corrected = Correction(table(), targets(wanted))
    factors, deviations = (
        np.array([corrected.at(angle)[part][HEAVE] for angle in GRID.tolist()]) for part in (0, 1)
    )
    errors = np.log(factors * predicted / wanted)
    before = np.abs(np.log(predicted / wanted)).max()
    assert np.abs(errors).max() < min(0.011, 0.5 * before)
    assert (np.abs(errors) < 2.0 * deviations).all()


def test_one_target_in_closed_form() -> None:
    """One target moves its own mode by the share of the prior's variance in both variances."""
    angle = float(GRID[5])
    prior = float((NumberEffects(table()).at(np.array([angle]))[0, HEAVE] ** 2).sum())
    predicted = float(table().evaluate(np.array([angle]))[0, HEAVE])
    corrected = Correction(table(), [Target(HEAVE + 1, angle, 1.01 * predicted, 0.01)])
    factors, deviations = corrected.at(angle)
    share = prior / (prior + 0.01**2)
    assert math.log(factors[HEAVE]) == pytest.approx(share * math.log(1.01), rel=1e-6)
    assert deviations[HEAVE] == pytest.approx(math.sqrt(prior * (1.0 - share)), rel=1e-6)
    # Far modes keep what is not known of them.
    assert deviations[1] == pytest.approx(0.0825, rel=0.05)


def test_a_single_wrong_target_hardly_counts() -> None:
    """One of eight targets is 15 % off: with equal weights it would move all the others."""
    wanted = true(1.2, 1.0)
    right = [Target(HEAVE + 1, float(GRID[i]), float(wanted[i]), 0.01) for i in range(3, 27, 3)]
    wrong = [*right[:-1], replace(right[-1], frequency=1.15 * right[-1].frequency)]
    both = [Correction(table(), each).at(float(GRID[12]))[0][HEAVE] for each in (right, wrong)]
    assert both[1] == pytest.approx(both[0], rel=5e-3)


@pytest.mark.parametrize(("factor", "refused"), [(1.04, False), (1.08, True)])
def test_frequencies_that_no_numbers_explain(factor: float, refused: bool) -> None:
    """Two targets at one height that differ by a factor are refused beyond the 1 % quantile.

    On paper: each is half of ln(factor) from both, so 2 * 5 ln(1 + r^2 / 4) with r = 1.96 or 3.85
    is 6.7 or 15.5, where chi-square of two is exceeded by 9.21 in 1 % of cases.
    """
    predicted = float(table().evaluate(GRID[5:6])[0, HEAVE])
    pair = [
        Target(HEAVE + 1, float(GRID[5]), predicted * math.sqrt(factor) ** sign, 0.01)
        for sign in (1.0, -1.0)
    ]
    if refused:
        with pytest.raises(CorrectionError, match=r"chi-square 15.* of 2 targets, at most 9.21"):
            Correction(table(), pair)
    else:
        factors, _ = Correction(table(), pair).at(float(GRID[5]))
        assert factors[HEAVE] == pytest.approx(1.0, abs=1e-6)


def test_refusals_follow_chance() -> None:
    """Of 1000 models that the priors describe, about 1 % are refused."""
    random, effects = np.random.default_rng(1), NumberEffects(table())
    rates = effects.at(GRID[::4])[:, HEAVE] / 0.01
    refused = 0
    for _ in range(1000):
        numbers, noise = random.standard_normal(rates.shape[1]), random.standard_normal(len(rates))
        try:
            correction._most_probable(rates, rates @ numbers + noise)
        except CorrectionError:
            refused += 1
    assert 1 <= refused <= 25


def test_what_is_refused(tmp_path: Path) -> None:
    """Targets over the stroke, beyond the table, of other modes, and tables without an ensemble."""
    [first, _] = targets(true(1.2, 1.0))
    bare = replace(table(), ensemble_alpha3=np.empty(0))
    for of, changed, words in (
        (table(), replace(first, at="lowest"), "targets at angles"),
        (table(), replace(first, at=0.2), "outside the angles"),
        (table(), replace(first, mode=7), "has 6 modes"),
        (table(), replace(first, mode=0), "counted from 1"),
        (bare, first, "state an uncertainty"),
    ):
        with pytest.raises(CorrectionError, match=words):
            Correction(of, [changed])
    path = tmp_path / "targets.yaml"
    path.write_text("targets: [{mode: 9, at_deg: 110, hz: 5}]\n")
    with pytest.raises(CorrectionError, match=r"targets\.yaml: The table has 6 modes"):
        read_correction(path, table())
    assert read_correction(None, table()) is None
    for text, words in (
        (
            "{mode: 4, at_deg: 110, hz: 5, deviaton: 0.05}",
            r"targets\[0\].deviaton: this key is not",
        ),
        ("{mode: 4, at_deg: 110, hz: -5}", r"targets\[0\].hz: -5 is not greater"),
    ):
        path.write_text(f"targets: [{text}]\n")
        with pytest.raises(MechanismError, match=rf"targets\.yaml: {words}"):
            read_correction(path, table())


def test_an_overdamped_mode_is_no_target(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its frequency is NaN in the table, so it corrects nothing."""
    [first, _] = targets(true(1.2, 1.0))
    monkeypatch.setattr(Table, "evaluate", lambda _, at: np.full((len(at), 6), math.nan))
    with pytest.raises(CorrectionError, match="overdamped at its angle"):
        Correction(table(), [first])


def test_a_correction_needs_sensors(tmp_path: Path) -> None:
    """Without sensors nothing would be corrected, so the node and a replay refuse it."""
    served = read_served(Parameters(), print)
    given = Parameters(correction_file=str(tmp_path / "targets.yaml"))
    with pytest.raises(CorrectionError, match="give them as sensor_file, or leave it out"):
        sensor_monitor([], served, (), given)
    assert sensor_monitor([], served, (), Parameters()) is None
