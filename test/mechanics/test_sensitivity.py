# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""First-order changes of frequencies are differences of models that are built as a whole."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from linkage_vibration.mechanics.model import LinkageModel, ModelError
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import with_numbers
from linkage_vibration.mechanics.sensitivity import Sensitivity

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
    """Return logarithms of natural frequencies, (MODES,)."""
    solution = LinkageModel(mechanism_from_mapping(mapping)).solve(alpha3)
    return np.asarray(np.log(solution.natural_frequencies[:MODES]))


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
    logs = np.log(changes.frequencies[:MODES])
    np.testing.assert_allclose(logs, values(exact), rtol=1e-12)
    for i, number in enumerate(sensitivity.numbers):
        step = 1e-4 * number.value
        ends = [with_numbers(exact, [(number.path, number.value + s)]) for s in (-step, step)]
        low, high = map(values, ends)
        expected = (high - low) / (2.0 * step) * number.deviation
        actual = changes.log_frequencies[i, :MODES]
        room = 3e-4 * np.abs(expected).max() + 1e-9
        assert (np.abs(actual - expected) <= room).all(), number.path


def test_correlations_and_shares(mapping: Any) -> None:
    """Correlated numbers add as their sum does, and shares add up to one."""
    mapping = described(mapping, {}, NUMBERS[:2])
    pair = {"between": list(NUMBERS[:2]), "value": 0.8}
    mapping["uncertainty"]["correlations"] = [pair]
    model = LinkageModel(mechanism_from_mapping(mapping))
    changes = Sensitivity(model).at(model.solve(ALPHA3), 300.0)
    first, other = changes.log_frequencies
    expected = np.sqrt(first**2 + other**2 + 2.0 * 0.8 * first * other)
    np.testing.assert_allclose(changes.stddev, expected, rtol=1e-12)
    assert changes.shares(0).sum() == pytest.approx(1.0)


def test_number_that_changes_a_mesh(mapping: Any) -> None:
    """A point in the middle of 25 elements is refused, since each move changes their number."""
    mapping["links"]["lower_link"]["points"]["V1"] = 0.405
    mapping["links"]["lower_link"]["elements"] = 25
    mapping["uncertainty"] = {"absolute": {"links.lower_link.points.V1": 1e-3}}
    with pytest.raises(ModelError, match=r"links\.lower_link.*give other `elements`"):
        Sensitivity(LinkageModel(mechanism_from_mapping(mapping)))
