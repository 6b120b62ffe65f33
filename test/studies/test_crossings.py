# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Crossings are where order times speed is a natural frequency of the model, by own arithmetic."""

import math
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable, kept_levels
from linkage_vibration.studies import crossings as study
from linkage_vibration.studies.crossings import Crossing, crossing_table, find_crossings
from test.support.served import shipped

TINES = {"speed": "pto", "ratio": 0.45, "orders": [2], "at": "E1.x", "at_speed": 1000.0}
STROKE = math.radians(90.0), math.radians(180.0)
WHY = "no number is uncertain"
HEAVE = "mode 8 (implement heave)"


def shipped_levels(mapping: Any) -> tuple[LevelTable, Any]:
    """Return levels of the shipped hitch by the excitations of a mapping, and these."""
    served, excitations = shipped(), excitations_from_mapping(mapping)
    return kept_levels(served.predictor, served.mechanism, excitations), excitations


def test_a_fixed_speed_crosses_at_the_root_of_the_model() -> None:
    """At 540 rpm, 2 x 0.45 x 9 Hz = 8.1 Hz is the heave's frequency at a root of the model."""
    levels, excitations = shipped_levels({"tines": {**TINES, "force": [200.0]}})
    model = LinkageModel(shipped().mechanism)
    fixed = {Source.PTO: (540.0, 540.0)}
    [found] = find_crossings([levels], excitations, STROKE, fixed, 0.33)

    def margin(alpha3: float) -> float:
        return float(model.solve(alpha3).natural_frequencies[3]) - 2 * 0.45 * 540.0 / 60.0

    # The frequency rises to 8.56 Hz at 174 deg and falls to 8.34 Hz at 180 deg: there is one root.
    root = brentq(margin, *np.radians([150.0, 170.0]))
    assert found.crank_angle == pytest.approx(root, abs=1e-4)
    assert (found.order, found.mode, found.speed, found.unknown) == ("tines 2", HEAVE, 540.0, "")
    below = {Source.PTO: (200.0, 305.0)}  # 4.58 Hz at most: less than the 4.65 Hz at 90 deg
    assert find_crossings([levels], excitations, STROKE, below, 0.33) == []
    just = {Source.PTO: (200.0, 312.0)}  # 4.68 Hz at most
    [found] = find_crossings([levels], excitations, STROKE, just, 0.33)
    assert found.crank_angle < math.radians(91.5)


def test_the_worst_height_of_a_range_of_speeds() -> None:
    """It is that of a scan of the model's curve, each angle at the speed where they cross."""
    levels, excitations = shipped_levels({"tines": {**TINES, "force": [200.0]}})
    model, loads = LinkageModel(shipped().mechanism), []
    for degrees in (scan := np.arange(92.0, 180.0, 4.0)):
        frequency = float(model.solve(math.radians(degrees)).natural_frequencies[3])
        speeds = np.array([[math.nan], [60.0 * frequency / 0.9], [math.nan]])
        loads.append(float(levels.at(np.radians([degrees]), speeds).load_ratios[0, 0]))
    between = {Source.PTO: (200.0, 1100.0)}
    [found] = find_crossings([levels], excitations, tuple(np.radians(scan[[0, -1]])), between, 0.33)
    assert math.degrees(found.crank_angle) == pytest.approx(scan[np.argmax(loads)])
    assert found.load_ratio == pytest.approx(max(loads), rel=1e-3)
    every = np.array([[math.nan], [found.speed], [math.nan]])
    members = levels.members(np.array([found.crank_angle]), every)[0, :, 4]  # load_ratios
    assert found.factor == pytest.approx(math.exp(np.log(members).std()), rel=1e-3)


class Levels:
    """Two modes of 10 and 20 Hz at all heights, with given loads of each order there."""

    def __init__(self, loads: Sequence[float], velocity: float = 1.0, mass: float = 1.0) -> None:
        self.excites = np.ones((len(loads), 2), np.bool_)
        self.excites[:, 1] = False
        self.mechanism = SimpleNamespace(rigid_bodies=[SimpleNamespace(mass=mass)])
        self.loads, self.velocity = np.array([*loads], np.float32), velocity
        self.predictor = SimpleNamespace(table=SimpleNamespace(mode_label=lambda k: f"mode {k}"))

    def at(self, alpha3: Any, speeds: Any) -> MessageColumns:
        """Return what `LevelTable.at` returns."""
        ratios = np.tile(self.loads, (len(alpha3), 1))
        return MessageColumns(load_ratios=ratios, velocities=np.full(ratios.shape, self.velocity))

    def factor_rows(self, alpha3: Any, speeds: Any, limit: float) -> Any:
        """Return what `LevelTable.factor_rows` returns: factors of 2 of the load ratios."""
        return np.repeat([[math.nan, 2.0]], len(self.loads), axis=1)


@pytest.fixture(autouse=True)
def _flat(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the modes of `Levels` be 10 and 20 Hz."""
    if "flat" in request.node.name:
        rows = MessageColumns(natural_frequencies=np.tile([10.0, 20.0], (181, 1)))
        monkeypatch.setattr(study, "predict_many", lambda *_: rows)


def found(every: Sequence[Any], n: int, **silent: Any) -> list[Crossing]:
    """Return crossings of n orders of a shaft with an amplitude, and of one that is silent."""
    given = {"force": [1.0] * n, "at": "E1.z", "at_speed": 1.0}
    orders = [1.0 + k / 100 for k in range(n)]
    mapping: Any = {"shaft": {"speed": "pto", "orders": orders, **given}}
    excitations = excitations_from_mapping(mapping | silent)
    return find_crossings(every, excitations, (1.0, 2.0), {Source.PTO: (300.0, 900.0)}, 0.33)


def test_flat_order_of_the_rows() -> None:
    """Above the limit come first, then the unknown ones, then those below, each by their loads."""
    silent = {"gear": {"speed": "pto", "orders": [1]}, "far": {"speed": "pto", "orders": [3]}}
    loads = [0.1, 0.34, 0.32, 0.9, math.nan]
    rows = found([Levels([*loads, math.nan])], 4, **silent)
    names = [each.order for each in rows]
    assert names == ["shaft 1.03", "shaft 1.01", "gear 1", "shaft 1.02", "shaft 1"]
    assert [each.unknown for each in rows] == ["", "", "no amplitude is given", "", ""]
    title, [head, *cells], left = crossing_table(
        rows, {Source.PTO: (300.0, 900.0)}, (1.0, 2.0), WHY
    )
    assert title.endswith("from 57.3 to 114.6 deg, PTO 300 rpm to 900 rpm:")
    assert head == ["order", "mode", "angle [deg]", "speed", "load ratio", "factor", "unknown"]
    assert cells[0] == ["shaft 1.03", "mode 0", "57.3", "583 rpm", "0.9", "2", ""]
    assert cells[2][4:] == ["not known", "2", "no amplitude is given"]
    assert not left  # The factor of a load that is not known is not explained.


@pytest.mark.parametrize(
    ("velocity", "words"),
    [(math.nan, "beyond the band of the table"), (1.0, "no static force to compare with")],
)
def test_flat_reasons(velocity: float, words: str) -> None:
    """Without a level, the band is the reason; with one, nothing to compare it with."""
    [crossing] = found([Levels([math.nan], velocity)], 1)
    assert words in crossing.unknown
    assert math.isnan(crossing.load_ratio)


@pytest.mark.parametrize(("n", "rest"), [(10, ""), (12, "Of 2 more")])
def test_flat_ten_rows(n: int, rest: str) -> None:
    """Eleven rows with the head are shown; of what is left, the largest load is stated."""
    rows = found([Levels([0.5 - k / 100 for k in range(n)])], n)
    _, cells, left = crossing_table(rows, {}, (1.0, 2.0), WHY)
    assert len(cells) == 11
    assert left.startswith(rest)
    if rest:
        assert left == "Of 2 more, the largest known load ratio is 0.4."
        rows[-1] = replace(rows[-1], unknown="no amplitude is given")
        _, _, left = crossing_table(rows, {}, (1.0, 2.0), WHY)
        assert left.endswith("is 0.4. Those of 1 are not or not fully known.")
        rows[0] = replace(rows[0], factor=math.nan)
        _, [_, first, *_], left = crossing_table(rows, {}, (1.0, 2.0), WHY)
        assert first[5] == "not known"
        assert left.endswith("A factor is not known where no number is uncertain.")


def test_flat_masses() -> None:
    """Of several masses the worst counts with its mass; one that is unknown is worse than low."""
    every = [Levels([0.2], mass=300.0), Levels([0.4], mass=900.0), Levels([0.3], mass=1500.0)]
    [crossing] = found(every, 1)
    assert (crossing.load_ratio, crossing.mass) == (pytest.approx(0.4), "900")
    [crossing] = found([every[0], Levels([math.nan], mass=900.0)], 1)
    assert (crossing.mass, bool(crossing.unknown)) == ("900", True)
    [crossing] = found([every[1], Levels([math.nan], mass=1500.0)], 1)
    assert (crossing.mass, crossing.unknown) == ("900", "")


def test_nothing_is_crossed() -> None:
    """It is said, with the heights and speeds; a speed that is not known has no crossing."""
    speeds = {Source.ENGINE: (math.nan, math.nan), Source.GROUND: (10.0, 10.0)}
    title, rows, left = crossing_table([], speeds, (1.0, 2.0), WHY)
    assert title == (
        "No order meets a natural frequency from 57.3 to 114.6 deg, engine speed not known, "
        "ground 36 km/h."
    )
    assert not rows
    assert not left
    levels, excitations = shipped_levels({"tines": {**TINES, "force": [200.0]}})
    unknown = {Source.PTO: (math.nan, math.nan)}
    assert find_crossings([levels], excitations, STROKE, unknown, 0.33) == []
