# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Standard deviations of numbers are read by their paths, and errors name the remedy."""

import math
import pickle
from dataclasses import replace
from typing import Any

import pytest

from linkage_vibration.mechanics.description import Mechanism, MechanismError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping

MASS, INERTIA = "rigid_bodies.implement.mass", "rigid_bodies.implement.inertia"
HEIGHT = "links.lower_link.section.height"
CLAIMS = {"relative": {MASS: 0.1, HEIGHT: 0.05}, "absolute": {INERTIA: 40.0}}


def correlated(value: float, *pairs: tuple[str, str], also: float = 0.0) -> dict[str, Any]:
    """Return three uncertain numbers with equal correlations of some pairs, and of another one."""
    others = [([INERTIA, HEIGHT], also)] * bool(also)
    entries = [*((list(pair), value) for pair in pairs), *others]
    return CLAIMS | {"correlations": [{"between": p, "value": value} for p, value in entries]}


def test_deviations_are_those_of_the_numbers(mapping: Any, mechanism: Mechanism) -> None:
    """Relative ones are shares of the number; a deviation of 0 leaves the number exact."""
    claims = correlated(0.5, (MASS, INERTIA))
    claims["relative"] = claims["relative"] | {"damping.ratio": 0.0}
    mapping["uncertainty"] = claims
    actual = mechanism_from_mapping(mapping).uncertainty
    assert actual is not None
    deviations = {number.path: number.deviation for number in actual.numbers}
    assert deviations == pytest.approx({MASS: 80.0, HEIGHT: 0.0016, INERTIA: 40.0})
    assert actual.correlation == ((1.0, 0.0, 0.5), (0.0, 1.0, 0.0), (0.5, 0.0, 1.0))
    mass = mechanism.rigid_bodies[0].mass
    assert actual.numbers[0].moved(-1.0) == pytest.approx(mass * math.exp(-80.0 / mass))
    assert actual.numbers[1].moved(0.0) == actual.numbers[1].value


def test_another_process_has_the_same_numbers(mapping: Any) -> None:
    """A mechanism that was sent to another process still gives mechanisms with other numbers."""
    mapping["uncertainty"] = CLAIMS
    sent = pickle.loads(pickle.dumps(mechanism_from_mapping(mapping))).uncertainty
    heavier = sent.described([900.0 if each.path == MASS else each.value for each in sent.numbers])
    assert heavier.rigid_bodies[0].mass == 900.0


def test_hash_includes_what_is_uncertain(mapping: Any, mechanism: Mechanism) -> None:
    """A table belongs to its deviations; without them the hash is that of the numbers alone."""
    mapping["uncertainty"] = CLAIMS
    uncertain = mechanism_from_mapping(mapping)
    assert uncertain.model_hash != mechanism.model_hash
    assert replace(uncertain, uncertainty=None).model_hash == mechanism.model_hash
    mapping["uncertainty"] = correlated(0.1, (MASS, INERTIA))
    assert mechanism_from_mapping(mapping).model_hash != uncertain.model_hash


@pytest.mark.parametrize(
    ("claims", "message"),
    [
        ({"relative": {"links.lower_link.section.hight": 0.1}}, f"like it are {HEIGHT}, "),
        ({"relative": {"links.lower_link.elements": 0.1}}, "no number that can be uncertain"),
        ({"relative": {"response.band_hz.1": 0.1}}, "no number that can be uncertain"),
        ({"relative": {MASS: -0.1}}, "-0.1 is below 0"),
        ({"relative": {MASS: "10 %"}}, "is text, not a number"),
        ({"relative": {MASS: 10}}, "10 is above 1; 5 % of the number are 0.05"),
        ({"relative": {"ground.P1.0": 0.1}}, "the number is 0"),
        ({"relative": {MASS: 0.1}, "absolute": {MASS: 3.0}}, "also under relative"),
        ({"relative": {f"{MASS}, {INERTIA}": 0.1}}, "hold different numbers"),
        ({"relative": {"links.lower_link.count": 0.1}}, "no number that can be uncertain"),
        (
            {
                "relative": {
                    "links.lower_link.material.density": 0.1,
                    "links.lift_rod.material.density": 0.1,
                }
            },
            "are one number, perhaps by an alias",
        ),
        (correlated(1.01, (MASS, INERTIA)), "1.01 is above 1; it is between -1 and 1"),
        (correlated(1.0, (MASS, INERTIA)), "contradict one another"),
        (correlated(0.5, (MASS, "damping.ratio")), "damping.ratio has no standard deviation"),
        (correlated(0.5, (MASS, MASS)), "two paths that differ"),
        (correlated(0.5, (MASS, INERTIA), (INERTIA, MASS)), "have a correlation already"),
        (
            correlated(-0.6, (MASS, INERTIA), (INERTIA, HEIGHT), (MASS, HEIGHT)),
            "contradict one another",
        ),
        # In the contradiction of a and b, the third has a share of value^2 / 2 (perturbation).
        (correlated(1.0, (MASS, INERTIA), also=0.2), f"of {MASS}, {HEIGHT}, {INERTIA} contradict"),
        (correlated(1.0, (MASS, INERTIA), also=0.12), f"of {MASS}, {INERTIA} contradict"),
        ({"relative": {}, "margin": 1.0}, "not known here"),
    ],
)
def test_errors_name_the_key_and_the_remedy(mapping: Any, claims: Any, message: str) -> None:
    """Every error says what is wrong and where."""
    mapping["uncertainty"] = claims
    with pytest.raises(MechanismError, match=message) as caught:
        mechanism_from_mapping(mapping)
    assert caught.value.path.startswith("uncertainty")


@pytest.mark.parametrize("deviation", [0.0, 1e-6])
def test_a_number_at_its_limit_cannot_vary(mapping: Any, deviation: float) -> None:
    """A damping ratio of 1 is refused by its path, also beside others; one just below is not."""
    mapping["damping"] = {"rule": "modal_ratio", "ratio": 1.0}
    mapping["uncertainty"] = {
        "relative": {MASS: 0.1, INERTIA: 0.1},
        "absolute": {"damping.ratio": deviation},
    }
    with pytest.raises(MechanismError, match="cannot vary by 1e-06") as caught:
        mechanism_from_mapping(mapping)
    assert caught.value.path == "uncertainty.absolute.damping.ratio"
    mapping["damping"]["ratio"] = 0.999
    mechanism_from_mapping(mapping)


def test_errors_of_the_mechanism_come_first(mapping: Any) -> None:
    """A misspelt key is named itself, not by the first number that is uncertain."""
    mapping["uncertainty"] = {"relative": {MASS: 0.1}}
    mapping["dampping"] = mapping["damping"]
    with pytest.raises(MechanismError, match="did you mean damping") as caught:
        mechanism_from_mapping(mapping)
    assert caught.value.path == "dampping"
