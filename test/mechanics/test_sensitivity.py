# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""First-order changes of modes are the differences of models that are built as a whole."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import with_numbers
from linkage_vibration.mechanics.sensitivity import ModeChanges, Sensitivity
from linkage_vibration.support.resources import config_file

ALPHA3 = 2.6
MODES = 3
IMPLEMENT = "rigid_bodies.implement"
DAMPER = {"joint": "E1", "bodies": ["lower_link", "implement"], "stiffness": 1e3, "damping": 300.0}
OIL = {**DAMPER, "loss_factor": {"factor": 0.4, "at_hz": 6.0}}
BETWEEN = {"between": ["V1", "E2"], "stiffness": 2e5, "damping": 2e3}
LOSSY = {"rule": "loss_factor", "factor": 0.3}
NUMBERS = (
    "links.lower_link.section.height",
    "links.lower_link.material.youngs_modulus",  # of every link, by an alias
    "links.upper_link.points.E2",
    "links.lower_link.points.V1",
    f"{IMPLEMENT}.mass",
    f"{IMPLEMENT}.inertia",
    f"{IMPLEMENT}.centre_of_gravity.E1",
    f"{IMPLEMENT}.points.E2.0",
    "ground.P3.1",
)


def described(mapping: Any, extra: dict[str, Any], numbers: tuple[str, ...]) -> Any:
    """Return a coarse description with other keys, some of whose numbers are uncertain."""
    for link in mapping["links"].values():
        link |= {"elements": 6, "modes": 30}  # every mode of the mesh
    mapping["uncertainty"] = {"relative": dict.fromkeys(numbers, 0.01)}
    for path, value in extra.items():
        *above, last = path.split(".")
        parent = mapping
        for key in above:
            parent = parent.setdefault(key, {})
        parent[last] = value
    return mapping


def values(mapping: Any, alpha3: float = ALPHA3) -> NDArray[np.float64]:
    """Return logarithms of frequencies, and damping ratios, (2, MODES)."""
    solution = LinkageModel(mechanism_from_mapping(mapping)).solve(alpha3)
    logs = np.log(solution.natural_frequencies[:MODES])
    return np.array([logs, solution.damping_ratios[:MODES]])


@pytest.mark.parametrize(
    ("extra", "more"),
    [
        ({}, ("damping.ratio", "damping.at_hz.0")),
        ({"damping": {"rule": "modal_ratio", "ratio": 0.03}}, ("damping.ratio",)),
        ({"damping": {"rule": "loss_factor", "factor": 0.03}}, ("damping.factor",)),
        ({"springs.s": DAMPER}, ("springs.s.damping", "springs.s.stiffness")),
        ({"springs.s": BETWEEN}, ("springs.s.damping", "springs.s.stiffness")),
        ({"springs.s": OIL}, ("springs.s.loss_factor.factor", "springs.s.loss_factor.at_hz")),
        (
            {"damping": {"rule": "loss_factor", "factor": 0.02}, "links.lift_rod.damping": LOSSY},
            ("damping.factor", "links.lift_rod.damping.factor"),
        ),
    ],
    ids=["rayleigh", "modal ratio", "loss", "damper", "damper between", "oil", "losses"],
)
def test_changes_are_differences(mapping: Any, extra: Any, more: tuple[str, ...]) -> None:
    """Every kind of number has its exact effect, whatever the damping."""
    mapping = described(mapping, extra, (*NUMBERS, *more))
    model = LinkageModel(mechanism_from_mapping(mapping))
    sensitivity = Sensitivity(model)
    changes = sensitivity.at(model.solve(ALPHA3), 300.0)
    exact = {key: value for key, value in mapping.items() if key != "uncertainty"}
    np.testing.assert_allclose(
        [np.log(changes.frequencies[:MODES]), changes.ratios[:MODES]], values(exact), rtol=1e-12
    )
    for i, number in enumerate(sensitivity.numbers):
        step = 1e-4 * number.value
        ends = [with_numbers(exact, [(number.path, number.value + s)]) for s in (-step, step)]
        low, high = map(values, ends)
        expected = (high - low) / (2.0 * step) * number.deviation
        actual = np.array([changes.log_frequencies[i], changes.ratio_changes[i]])[:, :MODES]
        room = 3e-4 * np.abs(expected).max(axis=1, keepdims=True) + 1e-9
        assert (np.abs(actual - expected) <= room).all(), number.path


def test_correlations_and_shares(mapping: Any) -> None:
    """Correlated numbers add as their sum does, and shares add up to one."""
    mapping = described(mapping, {}, NUMBERS[:2])
    pair = {"between": list(NUMBERS[:2]), "value": 0.8}
    mapping["uncertainty"]["correlations"] = [pair]
    model = LinkageModel(mechanism_from_mapping(mapping))
    changes = Sensitivity(model).at(model.solve(ALPHA3), 300.0)
    first, other = changes.log_frequencies
    expected = np.sqrt(first**2 + other**2 + 2.0 * 0.8 * first * other + changes.mixing[0])
    np.testing.assert_allclose(changes.stddev[0], expected, rtol=1e-12)
    assert changes.shares(0).sum() == pytest.approx(1.0)


def test_number_that_changes_a_mesh(mapping: Any) -> None:
    """A point in the middle of 25 elements is refused, since each move changes their number."""
    mapping["links"]["lower_link"]["points"]["V1"] = 0.405
    mapping["links"]["lower_link"]["elements"] = 25
    mapping["uncertainty"] = {"absolute": {"links.lower_link.points.V1": 1e-3}}
    with pytest.raises(ModelError, match=r"links\.lower_link.*give other `elements`"):
        Sensitivity(LinkageModel(mechanism_from_mapping(mapping)))


@pytest.mark.parametrize("correlation", [0.0, 0.8, -0.6])
def test_deviation_of_a_toggle(correlation: float) -> None:
    """It is that of the angle at which the coupler and the rocker of a four-bar are in line.

    Then (b + c)^2 = a^2 + d^2 - 2 a d cos(alpha), so that a change of b or of c moves the angle by
    (b + c) / (a d sin(alpha)) times itself.
    """
    a, b, c, d, deviation = 0.45, 0.30, 0.35, 0.50, (2e-4, 3e-4)
    toggle = math.acos((a * a + d * d - (b + c) ** 2) / (2.0 * a * d))
    mapping = yaml.safe_load(config_file("four_bar.yaml").read_text())
    mapping["input"]["range_deg"] = [60.0, math.degrees(toggle) - 1e-6]
    mapping["assembly"]["alpha3_deg"] = 60.0
    mapping["assembly"]["angles_deg"] = {"coupler": -30.0, "rocker": 100.0}
    paths = "links.coupler.points.C", "links.rocker.points.C"
    for link, point, length in (("crank", "B", a), ("coupler", "C", b), ("rocker", "C", c)):
        mapping["links"][link]["points"][point] = length
    mapping["uncertainty"] = {
        "absolute": dict(zip(paths, deviation, strict=True)),
        "correlations": [{"between": list(paths), "value": correlation}],
    }
    model = LinkageModel(mechanism_from_mapping(mapping))
    actual = Sensitivity(model).at(model.solve(toggle - 2e-4), 300.0).toggle_stddev
    first, other = (b + c) / (a * d * math.sin(toggle)) * np.array(deviation)
    expected = math.sqrt(first**2 + other**2 + 2.0 * correlation * first * other)
    assert actual == pytest.approx(expected, rel=0.005)


def changes_of(log_frequencies: Any, mixing: Any) -> ModeChanges:
    """Return changes of one mode with two numbers, whose correlation is 0.5."""
    return ModeChanges(
        frequencies=np.array([10.0]),
        ratios=np.array([0.02]),
        log_frequencies=np.array(log_frequencies)[:, np.newaxis],
        ratio_changes=np.array([[1e-3], [2e-3]]),
        correlation=np.array([[1.0, 0.5], [0.5, 1.0]]),
        spreads=np.array([1.0, 1.5]),
        mixing=np.array(mixing)[:, np.newaxis],
        approach=np.zeros((1, 1)),
        toggle_stddev=0.0,
    )


@pytest.mark.parametrize(("share", "left"), [(0.2, 1.2), (-0.89, 0.11), (-0.95, 0.1)])
def test_mixing_takes_away_nine_tenths_at_most(share: float, left: float) -> None:
    """Variances are a^2 + b^2 + a b at a correlation of 0.5, and what mixing adds or takes away."""
    frequency, ratio = 7e-4, 1e-6 * (1.0 + 9.0 + 3.0)  # with the spread, 1e-3 and 3e-3
    changes = changes_of([0.01, 0.02], [share * frequency, share * ratio])
    np.testing.assert_allclose(changes.stddev[:, 0] ** 2, [left * frequency, left * ratio])
    np.testing.assert_allclose(changes.excess[:, 0], [share, share])
    # The first number has a^2 + a b / 2 of the variance.
    np.testing.assert_allclose(changes.shares(0), [2.0 / 7.0, 5.0 / 7.0])


def test_excess_of_small_deviations() -> None:
    """It is a share of at least 1e-4 of a frequency and of 1e-3 of a damping ratio, squared."""
    changes = changes_of([0.5e-4, 0.0], [1e-9, 1e-9])
    assert changes.excess[0, 0] == pytest.approx(1e-9 / 1e-8)
    changes = changes_of([1.5e-4, 0.0], [1e-9, 1e-9])
    assert changes.excess[0, 0] == pytest.approx(1e-9 / 2.25e-8)
    small = replace(changes, ratio_changes=np.array([[1e-5], [0.0]]))
    assert small.excess[1, 0] == pytest.approx(1e-9 / (1e-3 * 0.02) ** 2)
    large = replace(changes, ratio_changes=np.array([[3e-5], [0.0]]))
    assert large.excess[1, 0] == pytest.approx(1e-9 / 9e-10)


def test_spread_of_a_damping(mapping: Any) -> None:
    """A damping that is lognormal deviates by more than its first order; other numbers do not.

    Of 400,000 samples whose logarithm deviates by 0.5, the deviation is compared.
    """
    mapping["damping"] = {"rule": "modal_ratio", "ratio": 0.03}
    paths = "damping.ratio", "rigid_bodies.implement.mass"
    mapping["uncertainty"] = {"relative": dict.fromkeys(paths, 0.5)}
    model = LinkageModel(mechanism_from_mapping(mapping))
    spreads = Sensitivity(model).at(model.solve(ALPHA3), 300.0).spreads
    sample = np.exp(0.5 * np.random.default_rng(0).standard_normal(400_000))
    assert spreads.tolist() == [pytest.approx(sample.std() / 0.5, rel=0.01), 1.0]
    mapping["damping"] = {"ratio": 0.03, "at_hz": [2.0, 20.0]}
    mapping["uncertainty"] = {"relative": {"damping.at_hz.0": 0.5}, "absolute": {}}
    model = LinkageModel(mechanism_from_mapping(mapping))
    assert Sensitivity(model).at(model.solve(ALPHA3), 300.0).spreads.tolist() == [1.0]
