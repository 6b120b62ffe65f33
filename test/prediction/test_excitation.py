# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions of excitations, valid and invalid."""

import math
from typing import Any

import pytest

from linkage_vibration.prediction.excitation import Source, excitations_from_mapping
from linkage_vibration.prediction.loads import FORCE, ExcitationError, Load


def test_orders_of_shafts_and_tyres() -> None:
    """Orders count turns; a rotor turns faster by its ratio; lugs pass at orders * v / (2 pi r)."""
    actual = excitations_from_mapping(
        {
            "engine": {"speed": "engine", "orders": [0.5, 2]},
            "rotor": {"speed": "pto", "ratio": 3.0, "orders": [1]},
            "lugs": {"speed": "ground", "rolling_radius": 0.8, "orders": [22]},
        }
    )
    assert [each.name for each in actual] == ["engine 0.5", "engine 2", "rotor 1", "lugs 22"]
    at = {Source.ENGINE: 2100.0, Source.PTO: 540.0, Source.GROUND: 3.0}
    frequencies = [each.ratio * at[each.source] for each in actual]
    assert frequencies == pytest.approx([17.5, 70.0, 27.0, 22 * 3.0 / (2 * math.pi * 0.8)])


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({}, "excitations: there is no excitation"),
        ([1], "excitations: .* is not a mapping"),
        ({"a": 1}, "excitations.a: 1 is not a mapping"),
        ({"a": {"speed": "wheel", "orders": [1]}}, "excitations.a.speed: 'wheel' is not one of"),
        ({"a": {"speed": "pto"}}, "excitations.a.orders"),
        ({"a": {"speed": "pto", "orders": "1"}}, "excitations.a.orders"),
        ({"a": {"speed": "pto", "orders": [1, 0]}}, r"excitations.a.orders\[1\]"),
        ({"a": {"speed": "pto", "orders": [math.nan]}}, r"excitations.a.orders\[0\]"),
        ({"a": {"speed": "pto", "orders": [2e6]}}, r"excitations.a.orders\[0\].* to 1e\+06"),
        ({"a\0": {"speed": "pto", "orders": [1]}}, r"'a\\x00' cannot be read in a sentence"),
        ({" ": {"speed": "pto", "orders": [1]}}, "' ' cannot be read in a sentence; give another"),
        ({None: {"speed": "pto", "orders": [1]}}, "excitations: the key None is not text"),
        ({"a": {"speed": "pto", "orders": [True]}}, r"excitations.a.orders\[0\]"),
        ({"a": {"speed": "pto", "orders": [1], "ratio": -1}}, "excitations.a.ratio"),
        ({"a": {"speed": "pto", "orders": [1], "gear": 2}}, "a.gear: this key is not known"),
        ({"a": {"speed": "ground", "orders": [1]}}, "excitations.a.rolling_radius"),
        (
            {"a": {"speed": "ground", "orders": [1], "rolling_radius": 800}},
            "rolling_radius: 800 is above 10; give 0.01 to 10 m",
        ),
        ({"a": {"speed": "pto", "orders": [1, 2, 1]}}, "a.orders: 'a 1' occurs twice"),
        (
            {"a": {"speed": "pto", "orders": [1], "rolling_radius": 1}},
            "radius: this key is not known",
        ),
    ],
)
def test_invalid_descriptions(mapping: Any, words: str) -> None:
    """The error names the path of the invalid key."""
    with pytest.raises(ExcitationError, match=words):
        excitations_from_mapping(mapping)


LOAD = {"speed": "pto", "orders": [1, 2], "force": [3.0, 4.0], "at": "E1.z", "at_speed": 540.0}


def test_amplitudes_of_each_order() -> None:
    """Every order has its own amplitude, and all share place, speed and growth."""
    given = {**LOAD, "exponent": 2, "amplitude_stddev": 0.5, "no_warning": [2]}
    first, two = excitations_from_mapping({"rotor": {**given, "frequency_stddev": 0.01}})
    assert first.load == Load(FORCE, "E1.z", 3.0, 540.0, 2.0, 0.5)
    assert two.load is not None
    assert (two.load.amplitude, two.relative_stddev) == (4.0, 0.01)
    assert (first.warns, two.warns) == (True, False)


def test_deviations_of_each_order() -> None:
    """A list has one deviation for each order."""
    orders = excitations_from_mapping({"rotor": {**LOAD, "amplitude_stddev": [0.1, 1.0]}})
    assert [each.load.relative_stddev for each in orders if each.load] == [0.1, 1.0]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"force": [3.0]}, r"rotor.force: give one number for each of the 2 orders"),
        ({"force": [3.0, -1.0]}, r"rotor.force: give one number .* none below zero"),
        ({"moment": [1.0, 2.0]}, r"rotor.moment: force is given too; describe each under a name"),
        ({"exponent": 9}, r"rotor.exponent: 9 is above 4; give -4 to 4"),
        ({"amplitude_stddev": [0.5]}, r"rotor.amplitude_stddev: give one number, or one for each"),
        ({"amplitude_stddev": [0.5, 1.1]}, r"one for each of the 2 orders, 0 to 1"),
        ({"amplitude_stddev": 50}, r"rotor.amplitude_stddev: 50 is above 1; give 0 to 1"),
        ({"no_warning": [3]}, r"rotor.no_warning: 3 is not one of the orders; remove it"),
        ({"at": None}, r"rotor.at: this key is missing"),
        ({"force": None}, r"rotor.at: this key is not known here"),
    ],
)
def test_amplitudes_that_are_refused(changes: dict[str, object], words: str) -> None:
    """The error names the key and what to do."""
    given = {key: value for key, value in ({**LOAD, **changes}).items() if value is not None}
    with pytest.raises(ExcitationError, match=words):
        excitations_from_mapping({"rotor": given})


SHAFT = {"speed": "pto", "orders": [1, 2]}
WHEEL = {"speed": "ground", "orders": [1], "rolling_radius": 1.0}


@pytest.mark.parametrize(
    ("given", "key", "allowed", "refused"),
    [
        (SHAFT, "ratio", (1e-6, 1e6), (0.99e-6, 1.01e6)),
        (LOAD, "at_speed", (1e-6, 1e6), (0.99e-6, 1.01e6)),
        (WHEEL, "rolling_radius", (0.01, 10.0), (0.0099, 10.1)),
        (LOAD, "exponent", (-4.0, 4.0), (-4.01, 4.01)),
        (LOAD, "amplitude_stddev", (0.0, 1.0), (-0.001, 1.001)),
        (SHAFT, "frequency_stddev", (0.0, 1.0), (-0.001, 1.001)),
        (SHAFT, "orders", ([1e-6, 1e6],), ([1.0, 0.99e-6], [1.01e6])),
        (LOAD, "force", ([0.0, 0.0],), ([0.0, -1e-9], [1.0], [1.0, 2.0, 3.0])),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_limits_of_descriptions(
    given: dict[str, Any], key: str, allowed: tuple[Any, ...], refused: tuple[Any, ...]
) -> None:
    """The limits themselves are allowed, and what is beyond them is refused with the key."""
    for value in allowed:
        assert excitations_from_mapping({"rotor": {**given, key: value}})
    for value in refused:
        with pytest.raises(ExcitationError, match=rf"rotor\.{key}"):
            excitations_from_mapping({"rotor": {**given, key: value}})


def test_what_is_not_described() -> None:
    """Without them, a ratio is 1, a load grows with no power, and nothing deviates or is silent."""
    single, two = excitations_from_mapping({"rotor": SHAFT})
    assert (single.ratio, two.ratio) == (pytest.approx(1.0 / 60.0), pytest.approx(2.0 / 60.0))
    assert (single.load, single.relative_stddev, single.warns) == (None, 0.0, True)
    first, _ = excitations_from_mapping({"rotor": LOAD})
    assert first.load == Load(FORCE, "E1.z", 3.0, 540.0, 0.0, 0.0)
