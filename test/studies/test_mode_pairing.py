# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measured modes are paired with those of a model by frequency, damping ratio and order."""

import math
from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from linkage_vibration.studies.measurement import pair_modes
from linkage_vibration.studies.ringdown import MeasuredMode

FREQUENCIES = st.lists(st.floats(0.5, 500.0), min_size=1, max_size=5).map(sorted)


def pairs(
    measured: Sequence[float],
    model: Sequence[float],
    ratios: Sequence[float] | None = None,
    model_ratios: Sequence[float] | None = None,
    deviation: float = 0.01,
) -> list[int | None]:
    """Return the modes of measured frequencies (Hz), all damping ratios 0.01 unless given."""
    return [first for first, *_ in candidates(measured, model, ratios, model_ratios, deviation)]


def candidates(
    measured: Sequence[float],
    model: Sequence[float],
    ratios: Sequence[float] | None = None,
    model_ratios: Sequence[float] | None = None,
    deviation: float = 0.01,
    lateral: Sequence[float] = (),
) -> list[tuple[int | None, ...]]:
    """Return what `pair_modes` does, with the rivals of doubtful pairs."""
    ratios = ratios or [0.01] * len(measured)
    modes = [
        MeasuredMode(hz, ratio, math.nan, math.nan, 5)
        for hz, ratio in zip(measured, ratios, strict=True)
    ]
    damping = np.array(model_ratios or [0.01] * len(model))
    deviations = np.full((len(measured), len(model)), deviation)
    return pair_modes(modes, np.array(model), damping, deviations, np.isin(model, lateral))


def test_the_mode_that_belongs_to_none_displaces_no_other() -> None:
    """log(20/95.1) + log(95.1/179.9) is log(20/179.9): the sums of distances are equal."""
    assert pairs([20.0, 95.1], [95.1, 179.9]) == [None, 0]
    assert pairs([95.1, 400.0], [50.0, 95.1]) == [1, None]


def test_modes_of_both_halves_may_change_their_order() -> None:
    """With 3 instead of 5 MN/m of a chain, sway falls from 5.26 to 4.63 Hz, below heave at 95 deg.

    Nothing is sure then, as the model of either half may be off by 16 %; in one half, order tells.
    """
    swapped = candidates([4.63, 4.89], [4.90, 5.26], lateral=[5.26])
    assert [set(modes) for modes in swapped] == [{0, 1}, {0, 1}]
    assert candidates([4.63, 4.89], [4.90, 5.26]) == [(0,), (1,)]
    assert candidates([4.63], [4.90, 5.26], lateral=[5.26]) == [(0, 1)]
    for higher, doubt in ((5.60, (1,)), (5.90, ())):
        assert candidates([4.90], [4.90, higher], lateral=[higher]) == [(0, *doubt)]


def test_modes_of_the_lateral_half_are_hardly_known() -> None:
    """With 2.6 instead of 5 MN/m of a chain, the sway at 4.289 Hz is nearer to the roll's 3.967 Hz.

    Its own prediction is 5.207 Hz. In the vertical half, a model is not off by so much.
    """
    model = [3.967, 5.207]
    assert candidates([4.299], model, lateral=model) == [(0, 1)]
    assert candidates([4.299], model) == [(0,)]
    assert candidates([4.0], model, lateral=model) == [(0,)]


def test_a_spurious_mode_takes_no_mode_that_another_fits() -> None:
    """At 171 deg, 119.2 Hz is within the permitted distance of the mode at 140.7 Hz."""
    model = [1.62, 2.47, 2.84, 8.71, 85.48, 140.69, 209.11, 307.25]  # of the tractor file
    assert pairs([119.2], model) == [5]
    assert pairs([85.0, 119.2, 140.4], model) == [4, None, 5]
    assert pairs([1.60, 2.45, 8.6, 84.9, 119.2, 140.4], model) == [0, 1, 3, 4, None, 5]
    assert pairs([85.0, 119.2, 140.4, 205.0], model) == [4, None, 5, 6]


def test_doubtful_pairs() -> None:
    """A pair is doubtful if its absence costs less than 0.2, of a distance that is 1 at 1.5.

    The costs were added by hand: a mode at 1.5**0.3 beside the measured one costs 0.3.
    """
    rivals: tuple[int | None, ...]
    for gap, rivals in ((0.19, (0, 1)), (0.21, (0,))):
        model = [100.0 * 1.5**-0.3, 100.0 * 1.5 ** (0.3 + gap)]
        assert candidates([100.0], model, deviation=0.0) == [rivals]
    for cost, rivals in ((0.81, (0, None)), (0.79, (0,))):  # belonging to no mode costs 1
        assert candidates([100.0], [100.0 * 1.5**cost], deviation=0.0) == [rivals]
    # A second measured mode that needs the rival clears the doubt: without the pair it has none.
    model = [100.0 * 1.5**-0.3, 100.0 * 1.5**0.4]
    assert candidates([100.0], model, deviation=0.0) == [(0, 1)]
    assert candidates([100.0, model[1]], model, deviation=0.0) == [(0,), (1,)]
    assert candidates([20.0], model) == [(None,)]


def test_a_model_that_is_too_stiff_everywhere_keeps_the_order() -> None:
    """Each mode is 10 % below its own, although the second equals the first of the model."""
    model = np.array([12.0, 13.2, 14.52])
    assert pairs((model / 1.1).tolist(), model.tolist()) == [0, 1, 2]


def test_the_permitted_distance() -> None:
    """A ratio of 1.5 is permitted in both directions, and a larger one is not."""
    for hz in (150.0, 100.0 / 1.5, 149.99, 66.67):
        assert pairs([hz], [100.0]) == [0]
    for hz in (150.01, 66.66, 1000.0):
        assert pairs([hz], [100.0]) == [None]


def test_equally_near_modes_go_to_the_lower_one() -> None:
    """The measured frequency is the geometric mean of both, in several roundings."""
    for scale in (1.0, 1.0 / 3.0, math.pi, 1e-3, 7.7):
        for factor in (1.0 - 1e-15, 1.0, 1.0 + 1e-15):
            assert pairs([100.0 * scale * factor], [80.0 * scale, 125.0 * scale]) == [0]
            assert pairs([100.0 * scale * factor], [100.0 * scale, 100.0 * scale]) == [0]
    assert pairs([80.0, 125.0], [100.0]) == [0, None]  # the first pair is kept


def test_damping_decides_between_frequencies_that_are_as_near() -> None:
    """The mode with the same damping ratio is taken, below or above, also if both are equal."""
    for model in ([80.0, 125.0], [100.0, 100.0]):
        assert pairs([100.0], model, [0.02], [0.02, 0.1]) == [0]
        assert pairs([100.0], model, [0.1], [0.02, 0.1]) == [1]


def test_damping_forbids_no_pair() -> None:
    """The damping of a model is often a guess: a factor of 100 or none at all pairs, too."""
    for ratio in (0.0, 1e-4, 1.0, math.nan):
        assert pairs([110.0], [100.0], [0.01], [ratio]) == [0]


def test_a_frequency_that_is_not_well_known_weighs_less() -> None:
    """With 30 % of deviation damping decides, which it does not with 1 %: 0.55 and 0.40.

    By hand, in units of three deviations: log(125/100) is 0.55 of log(1.5), and 0.225 of
    3 hypot(0.135, 0.3); a factor of 2.5 of damping is 0.40 of log(10).
    """
    model, ratios = [100.0, 125.0], [0.025, 0.01]
    assert pairs([100.0], model, [0.01], ratios, deviation=0.01) == [0]
    assert pairs([100.0], model, [0.01], ratios, deviation=0.3) == [1]


def lowest_cost(measured: list[float], model: list[float]) -> float:
    """Return the least cost of all pairings that keep the order, by trying each of them."""
    spread = math.hypot(math.log(1.5) / 3.0, 0.01)
    costs = []
    for size in range(min(len(measured), len(model)) + 1):
        for chosen in combinations(range(len(measured)), size):
            for modes in combinations(range(len(model)), size):
                away = [
                    abs(math.log(measured[i] / model[j]))
                    for i, j in zip(chosen, modes, strict=True)
                ]
                if all(each <= math.log(1.5) for each in away):
                    each_cost = (min(each / (3.0 * spread), 1.0) for each in away)
                    costs.append(sum(each_cost) + len(measured) - size)
    return min(costs)


@given(FREQUENCIES, FREQUENCIES)
def test_no_pairing_is_better(measured: list[float], model: list[float]) -> None:
    """Order and permitted distance are kept, and no other pairing that does so costs less."""
    actual = pairs(measured, model)
    chosen = [j for j in actual if j is not None]
    assert chosen == sorted(set(chosen))
    ratios = [(hz, model[j]) for hz, j in zip(measured, actual, strict=True) if j is not None]
    assert all(1.0 / 1.5 - 1e-9 <= hz / other <= 1.5 + 1e-9 for hz, other in ratios)
    spread = math.hypot(math.log(1.5) / 3.0, 0.01)
    cost = sum(abs(math.log(hz / other)) / (3.0 * spread) for hz, other in ratios)
    cost += len(measured) - len(ratios)
    assert cost == pytest.approx(lowest_cost(measured, model), abs=1e-6)


@given(FREQUENCIES, FREQUENCIES, st.integers(-3, 3), st.integers(0, 2**32 - 1))
def test_the_last_bit_decides_nothing(
    measured: list[float], model: list[float], power: int, seed: int
) -> None:
    """Rounding changes no pair, nor does another unit of frequency; geometric grids have ties."""
    rounded = [float(f"{hz:.1e}") for hz in measured]
    grid = sorted(1.25 ** round(math.log(hz, 1.25)) for hz in model)
    random = np.random.default_rng(seed)
    for values in (measured, rounded, sorted(1.25 ** round(math.log(hz, 1.25)) for hz in rounded)):
        ours = np.array(values) * 3.0**power
        theirs = np.array(grid) * 3.0**power
        ours = np.sort(ours * (1.0 + 1e-14 * random.uniform(-1.0, 1.0, len(ours))))
        theirs = np.sort(theirs * (1.0 + 1e-14 * random.uniform(-1.0, 1.0, len(theirs))))
        assert pairs(ours.tolist(), theirs.tolist()) == pairs(values, grid)


@given(FREQUENCIES)
def test_an_exact_model_pairs_each_mode_with_its_own(model: list[float]) -> None:
    """Modes that equal those of the model, and one far from all, which belongs to none."""
    assume(all(b / a > 1.001 for a, b in pairwise(model)))
    assert pairs(model, model) == list(range(len(model)))
    assert pairs([0.01, *model], model) == [None, *range(len(model))]
