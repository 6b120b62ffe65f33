# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Advice agrees with a search of every cell, for loads in closed form and the shipped model."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.advice import (
    BOTH,
    HEIGHT,
    NOW,
    SPEED,
    AdviceError,
    Adviser,
    Question,
    advice_sentence,
    advise,
    is_quieter,
    smallest,
)
from linkage_vibration.prediction.excitation import excitations_from_mapping
from linkage_vibration.prediction.levels import kept_levels
from linkage_vibration.prediction.severity import WarningLimits
from linkage_vibration.prediction.worst_levels import WorstLevels
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.support.resources import config_file
from test.support.served import shipped

ENGINE, PTO, GROUND = range(3)
SOIL = "A tool is in the soil."
EXCITATIONS = excitations_from_mapping(
    {
        "shaft": {"speed": "pto", "orders": [1], "force": [1.0], "at": "E1.z", "at_speed": 1.0},
        "tyre": {
            "speed": "ground",
            "orders": [1],
            "rolling_radius": 0.8,
            "force": [1.0],
            "at": "E1.z",
            "at_speed": 1.0,
        },
    }
)


def load(angle: float, speed: float, shift: float = 0.0, steepness: float = 1.0) -> float:
    """Return a load that has a valley over the angle and grows with the speed."""
    return (0.05 + (angle - 2.0 - shift) ** 2) * (0.2 + 0.1 * abs(speed - 3.0) ** steepness)


MEMBERS = [(0.3 * math.sin(k), 0.6 + 0.05 * (k % 17)) for k in range(64)]


class Levels:
    """Loads in closed form: those beyond 20 m/s, of a pin at 2.9 rad or in the soil are unknown."""

    alpha3_range = 1.5, 3.0

    def __init__(self, n_members: int = 64, shift: float = 0.0, soil: float = 1.6) -> None:
        self.members = [(a + shift, b) for a, b in MEMBERS[:n_members]]
        self.shift, self.soil = shift, soil

    def at_all_pairs(self, alpha3: Any, speeds: Any) -> MessageColumns:
        """Return what `LevelTable.at_all_pairs` returns."""
        alpha3, speeds = np.repeat(alpha3, speeds.shape[1]), np.tile(speeds, len(alpha3))
        inside = (alpha3 >= 1.5) & (alpha3 <= 3.0)
        v = speeds[GROUND]
        total = np.array([load(a, b, self.shift) for a, b in zip(alpha3, v, strict=True)])
        total[~inside | (alpha3 > 2.9)] = math.nan
        tyre = np.where(v > 20.0, math.nan, 1.0)
        shaft = np.where(np.isnan(speeds[PTO]), math.nan, 1.0)
        return MessageColumns(
            total_load_ratio=total.astype(np.float32),
            total_velocity=(2.0 * total).astype(np.float32),
            velocities=np.column_stack([shaft, tyre]),
            ground_unknown=np.where((alpha3 < self.soil) & inside, SOIL, ""),
        )

    def member_totals(self, alpha3: Any, speeds: Any) -> Any:
        """Return what `LevelTable.member_totals` returns."""
        rows = [
            [load(a, b, *each) for a, b in zip(alpha3, speeds[GROUND], strict=True)]
            for each in self.members
        ]
        totals = np.array(rows).reshape(len(rows), len(alpha3))
        return totals, 2.0 * totals


def ask(angle: float = 2.7, speed: float = 8.0, n_members: int = 64, **permitted: Any) -> Any:
    """Return the advice about the loads in closed form."""
    levels: Any = Levels(n_members)
    return advise(
        levels, EXCITATIONS, Question(angle, np.array([1800.0, 540.0, speed]), **permitted)
    )


def known(angle: float, speed: float) -> bool:
    """Return whether a load is known, as the docstring of `Levels` says."""
    return 1.6 <= angle <= 2.9 and speed <= 20.0


def test_the_whole_grid_by_brute_force() -> None:
    """Choices and probabilities are those of loops over all cells and members."""
    angles, speeds = np.linspace(1.5, 3.0, 91), np.linspace(1.0, 25.0, 17)
    answer = ask(crank_angles=(1.5, 3.0), ground_speeds=(1.0, 25.0))
    message, present = answer.message, (2.7, 8.0)
    among = {
        HEIGHT: [(a, 8.0) for a in angles],
        SPEED: [(2.7, v) for v in speeds],
        BOTH: [(a, v) for a in angles for v in speeds],
    }
    for place, cells in among.items():
        cells = [cell for cell in cells if known(*cell)]
        best = min(cells, key=lambda cell: np.float32(load(*cell)))
        at = message.crank_angles[place], message.ground_speeds[place]
        assert at == pytest.approx(best)
        assert message.load_ratios[place] == pytest.approx(load(*best), rel=1e-6)
        assert message.velocities[place] == pytest.approx(2.0 * load(*best), rel=1e-6)
        quieter = sum(load(*best, *each) < load(*present, *each) for each in MEMBERS)
        assert message.probabilities[place] == pytest.approx((quieter + 0.5) / 65.0)
        factor = math.exp(float(np.std([math.log(load(*best, *each)) for each in MEMBERS])))
        assert message.load_ratio_factors[place] == pytest.approx(factor)
        assert message.velocity_factors[place] == pytest.approx(factor)
    assert message.load_ratios[NOW] == pytest.approx(load(*present), rel=1e-6)
    assert math.isnan(message.probabilities[NOW])
    for i, angle in enumerate(angles):
        for j, speed in enumerate(speeds):
            assert math.isnan(answer.load_ratios[i, j]) != known(angle, speed)
            assert (answer.reasons[i, j] == 0) == known(angle, speed)


@pytest.mark.parametrize(("less", "row"), [(9e-7, 3), (1.2e-6, 5)])
def test_the_last_bit_does_not_choose(less: float, row: int) -> None:
    """Loads within a millionth of the smallest are the same, and the first row is chosen."""
    load = np.array([math.nan, 0.1, 0.3, 0.2, 0.2, 0.2 * (1.0 - less), 0.2])
    assert smallest(load, np.array([0, 2, 3, 4, 5, 6])) == row
    assert smallest(np.full(3, math.nan), np.array([2, 1])) == 2


@pytest.mark.parametrize(
    ("angle", "speed", "reason"),
    [
        (1.5, 8.0, SOIL),
        (1.5999, 8.0, SOIL),
        (1.6, 8.0, ""),
        (2.9, 20.0, ""),
        (2.9, 20.001, "beyond the band"),
        (2.9001, 20.0, "No excitation with an amplitude is at work"),
    ],
)
def test_both_sides_of_each_refusal(angle: float, speed: float, reason: str) -> None:
    """A single permitted cell is refused with its reason, or advised, at any present place."""
    answer = ask(crank_angles=(angle, angle), ground_speeds=(speed, speed))
    assert answer.load_ratios.shape == (1, 1)
    text = answer.reason_texts[answer.reasons[0, 0]]
    assert reason in text
    assert bool(reason) == bool(text)
    assert math.isnan(answer.message.load_ratios[BOTH]) == bool(reason)
    assert math.isnan(answer.message.crank_angles[BOTH]) == bool(reason)


@pytest.mark.parametrize(
    ("permitted", "words"),
    [
        ({"crank_angles": (2.5, 2.4)}, r"angles are 2.5 to 2.4 rad \(143.239 to 137.51 deg\)"),
        ({"crank_angles": (math.nan, 2.4)}, "angles are nan"),
        ({"crank_angles": (-math.inf, 2.4)}, "angles are -inf"),
        ({"crank_angles": (1.4999, 2.4)}, r"85\.9379 to 137\.51 deg, but the table has 85\.9437"),
        ({"crank_angles": (2.4, 3.0001)}, r"to 171\.893 deg, but the table has"),
        ({"ground_speeds": (9.0, 1.0)}, r"ground speeds are 9 to 1 m/s \(32.4 to 3.6 km/h\)"),
        ({"ground_speeds": (-0.1, 1.0)}, "of at least 0"),
        ({"ground_speeds": (1.0, math.inf)}, "ground speeds are 1 to inf"),
    ],
)
def test_invalid_ranges(permitted: Any, words: str) -> None:
    """A range that is reversed, infinite or not a number is refused by its name."""
    with pytest.raises(AdviceError, match=words):
        ask(**permitted)


def test_a_question_has_a_speed_of_each_source() -> None:
    """Two speeds, or one number, do not say of which source they are."""
    levels: Any = Levels(0)
    for speeds in (np.array([540.0, 3.0]), np.array(3.0)):
        with pytest.raises(AdviceError, match="give one of each: engine, pto, ground"):
            advise(levels, EXCITATIONS, Question(2.0, speeds))
    assert ask().message.sentence


def test_the_worst_of_two_masses() -> None:
    """Choices and probabilities are by the larger load; what one mass lacks is not known."""
    every: Any = [Levels(), Levels(shift=0.4, soil=2.25)]
    speeds = np.array([1800.0, 540.0, 8.0])
    message = advise(WorstLevels(every), EXCITATIONS, Question(2.7, speeds)).message

    def worst(angle: float, shift: float = 0.0, steepness: float = 1.0) -> float:
        return max(load(angle, 8.0, shift + more, steepness) for more in (0.0, 0.4))

    best = min((a for a in np.linspace(1.5, 3.0, 91) if 2.25 <= a <= 2.9), key=worst)
    assert message.crank_angles[HEIGHT] == pytest.approx(best)
    assert message.load_ratios[HEIGHT] == pytest.approx(worst(best), rel=1e-6)
    assert message.load_ratios[NOW] == pytest.approx(worst(2.7), rel=1e-6)
    quieter = sum(worst(best, *each) < worst(2.7, *each) for each in MEMBERS)
    assert message.probabilities[HEIGHT] == pytest.approx((quieter + 0.5) / 65.0)
    lost = advise(WorstLevels(every), EXCITATIONS, Question(2.2, speeds)).message
    assert math.isnan(lost.load_ratios[NOW])
    assert lost.sentence.startswith("How strongly it is loaded now is not known: a tool is in")


def test_the_mass_that_loads_most() -> None:
    """It is named at each place; not where a load is not known, and not if there is one only."""
    loads = {300.0: [0.1, 0.4, 0.4], 1500.0: [0.2, math.nan, 0.3]}
    every: Any = [
        SimpleNamespace(
            at=lambda *_, row=row: MessageColumns(total_load_ratio=np.array(row)),
            mechanism=SimpleNamespace(rigid_bodies=[SimpleNamespace(mass=mass)]),
        )
        for mass, row in loads.items()
    ]
    angles, speeds = np.zeros(3), np.zeros((3, 3))
    assert WorstLevels(every).masses(angles, speeds) == ["1500", "", "300"]
    assert WorstLevels(every[:1]).masses(angles, speeds) == ["", "", ""]


def test_what_is_not_known_is_not_advised() -> None:
    """Without members, a present height or a speed, numbers are NaN, and sentences say so."""
    certain = ask(ground_speeds=(1.0, 10.0), n_members=0)
    assert np.isnan(certain.message.probabilities).all()
    assert np.isnan(certain.message.load_ratio_factors).all()
    assert "(how probably, is not known)" in certain.message.sentence
    assert "Not all factors and probabilities are known, as the table" in certain.message.sentence
    assert "Not all factors" not in ask().message.sentence
    outside = ask(angle=3.2, ground_speeds=(1.0, 10.0)).message
    assert np.isnan(outside.load_ratios[[NOW, SPEED]]).all()
    assert np.isfinite(outside.load_ratios[[HEIGHT, BOTH]]).all()
    assert np.isnan(outside.probabilities).all()
    reason = "the angle is outside the table."
    assert outside.sentence == f"How strongly it is loaded now is not known: {reason}"
    still = ask(speed=math.nan).message
    assert "tyre 1" in still.not_counted
    assert "shaft 1" not in still.not_counted


def test_a_load_that_is_known_only_elsewhere_is_no_quiet_place() -> None:
    """The shipped model at 100 m/s: lugs are beyond the band, so nothing is advised there."""
    served, excitations = shipped(), read_excitations(config_file("excitations.yaml"))
    levels = kept_levels(served.predictor, served.mechanism, excitations)
    speeds = np.array([1800.0, math.nan, 5.0])
    question = Question(math.radians(165.0), speeds, None, (0.0, 100.0))
    advised = advise(levels, excitations, question, (5, 3))
    assert (advised.reasons[:, :2] == 0).all()
    assert (advised.reasons[:, 2] > 0).all()
    assert "pto_shaft 1" in advised.message.not_counted
    # Each cell is what one row of the level table says.
    for i, angle in enumerate(advised.crank_angles.tolist()):
        for j, speed in enumerate(advised.ground_speeds[:2].tolist()):
            row = levels.at(np.array([angle]), np.array([[1800.0], [math.nan], [speed]]))
            assert advised.load_ratios[i, j] == row.total_load_ratio[0]


def test_sentences() -> None:
    """Only what is notably and probably quieter is named, and it is said if it is not enough."""

    def said(
        height: float, speed: float, probability: float = 0.991, limit: float = math.nan
    ) -> str:
        return advice_sentence(
            MessageColumns(
                load_ratios=np.array([1.0, height, speed, 0.1]),
                crank_angles=np.radians([165.0, 130.0, 165.0, 130.0]),
                ground_speeds=np.array([30.0, 30.0, 24.0, 24.0]) / 3.6,
                probabilities=np.array([math.nan, probability, probability, 1.0]),
            ),
            limit=limit,
        )

    carried = "Carried at 130 deg instead of 165 deg at 30 km/h it would be loaded"
    sure = "(less with a probability of 99 %)."
    assert said(0.5, 1.0) == f"{carried} half as much {sure}"
    assert said(0.549, 1.0) == f"{carried} half as much {sure}"  # within a tenth of it
    assert said(0.551, 1.0) == f"{carried} 55 % as much {sure}"
    assert said(0.8, 1.0) == f"{carried} 80 % as much {sure}"
    assert said(0.801, 0.9) == ""
    assert "(less with a probability of 50 %)" in said(0.5, 1.0, 0.5)
    assert said(0.5, 1.0, 0.499) == ""
    assert said(0.5, 1.0, limit=0.5) == f"{carried} half as much {sure}"
    more = "That is not enough: 0.5 of the static force exceeds the limit of 0.499."
    assert said(0.5, 1.0, limit=0.499) == f"{carried} half as much {sure} {more}"
    assert said(0.34, 0.25, math.nan) == (
        f"{carried} a third as much (how probably, is not known). At 24 km/h instead of 30 km/h it "
        "would be loaded a quarter as much (how probably, is not known)."
    )


@pytest.mark.parametrize(("known", "unsure"), [(61, False), (60, True)])
def test_a_probability_needs_95_percent_of_the_members(known: int, unsure: bool) -> None:
    """61 of 64 members are more than 95 %, and 60 are less: then the answer says why."""
    levels: Any = Levels()
    totals = levels.member_totals

    def some(alpha3: Any, speeds: Any) -> Any:
        return np.where(np.arange(64)[:, np.newaxis] < known, totals(alpha3, speeds), math.nan)

    levels.member_totals = some
    answer = advise(levels, EXCITATIONS, Question(2.7, np.array([1800.0, 540.0, 8.0])))
    assert np.isnan(answer.message.probabilities[1:]).all() == unsure
    words = f"only {known} of 64 members of the ensemble have a load there"
    assert answer.message.sentence.endswith(f"known, as {words}.") == unsure


def test_the_only_candidate_is_not_quieter() -> None:
    """The present speed alone is permitted, so no speed is quieter, although a height is."""
    message = ask().message
    assert message.load_ratios[SPEED] == message.load_ratios[NOW]
    assert is_quieter(message).tolist() == [False, True, False, True]


@pytest.mark.parametrize(
    ("now", "least", "words"),
    [
        (0.0, 0.0, ""),
        (1.0, 0.0, "less than 1 %"),
        (1.0, 0.0049, "less than 1 %"),
        (1.0, 0.0051, "loaded 1 %"),
    ],
)
def test_sentences_at_rest(now: float, least: float, words: str) -> None:
    """Nothing is quieter than no load, and no load is less than a percent of any other."""
    message = MessageColumns(
        load_ratios=np.array([now, least, least, least]),
        crank_angles=np.full(4, 2.0),
        ground_speeds=np.array([5.0, 5.0, 0.0, 0.0]),
        probabilities=np.array([math.nan, 0.5, 0.5, 0.5]),
    )
    assert (f" {words} as much" in advice_sentence(message)) is bool(words)
    assert bool(advice_sentence(message)) is bool(words)


@pytest.mark.parametrize("source", [ENGINE, PTO])
def test_negative_speeds_of_shafts_are_refused(source: int) -> None:
    """At rest there is an answer, and in reverse; a shaft that turns backwards is a mistake."""
    levels: Any = Levels()
    speeds = np.array([1800.0, 540.0, 8.0])
    speeds[[source, GROUND]] = 0.0, -8.0
    assert math.isfinite(
        advise(levels, EXCITATIONS, Question(2.7, speeds)).message.load_ratios[NOW]
    )
    speeds[source] = -1e-3
    with pytest.raises(AdviceError, match=r"speed is -0\.001"):
        advise(levels, EXCITATIONS, Question(2.7, speeds))


def test_advice_is_due_once_a_second_above_the_limit() -> None:
    """Stamps decide, on both sides of the limit and of a second; a clock may jump back."""
    monitor: Any = SimpleNamespace(rules=SimpleNamespace(limits=WarningLimits(warning=0.33)))
    is_due = Adviser(monitor).is_due
    stamps = 0, 1, 999_999_999, 10**9, 10**9 + 1, 5, 6, 10**9 + 4, 10**9 + 5
    ratios = 0.33, 0.331, 0.4, 0.4, 0.4, 0.4, math.nan, 0.4, 0.4
    due = [False, True, False, False, True, True, False, False, True]
    assert [is_due(*each) for each in zip(ratios, stamps, strict=True)] == due
