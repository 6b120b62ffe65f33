# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Poles that a table is built from also give FRFs with every mode."""

import math
from typing import Any

import numpy as np
import pytest

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.coupling import assembled_frf
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.table.tabulation.sampling import Sampler
from linkage_vibration.table.tabulation.subspaces import _viscous, check_lines

ANGLE = 2.6
DAMPER = {"joint": "E1", "bodies": ["lower_link", "implement"], "stiffness": 1e3}
BASE = {
    "mass": 4500.0,
    "inertia": 6000.0,
    "centre_of_gravity": [1.6, 0.1],
    "mounts": {
        "rear": {"at": [0.6, -0.05], "stiffness": [7e5, 7e5], "damping": [4e3, 4e3]},
        "front": {"at": [3.1, -0.05], "stiffness": [6e5, 6e5], "damping": [4e3, 4e3]},
    },
}
STIFFER = {"rule": "rayleigh", "ratio": 0.05, "at_hz": [4.0, 180.0]}
LOSSY = {"rule": "loss_factor", "factor": 0.1}
LOSS = {"rule": "loss_factor", "factor": 0.02}


def sampled(mapping: Any, changes: dict[str, Any]) -> tuple[LinkageModel, Sampler, float]:
    """Return a coarse linkage with changes, its sampler, and a stroke variable."""
    for link in mapping["links"].values():
        link |= {"elements": 6, "modes": 4}
    mapping["uncertainty"] = {
        "relative": {"links.lower_link.section.height": 0.05, "rigid_bodies.implement.mass": 0.1},
        "absolute": {"ground.P3.1": 0.002, "rigid_bodies.implement.centre_of_gravity.E1": 0.05},
    }
    mapping["input"]["range_deg"] = [math.degrees(ANGLE), math.degrees(ANGLE) + 10.0]
    for path, value in changes.items():
        *above, last = path.split(".")
        parent = mapping
        for key in above:
            parent = parent.setdefault(key, {})
        parent[last] = value
    model = LinkageModel(mechanism_from_mapping(mapping))
    sampler = Sampler(model, None, lambda finished: None)
    return model, sampler, sampler.ends[0]


CASES = {
    "damper": {"springs.damper": DAMPER | {"damping": 300.0}},
    "nearly rigid damper": {"springs.damper": DAMPER | {"damping": 1e7}},
    "base": {"base": BASE},
    "one link": {"links.lift_rod.damping": STIFFER},
    "two links": {f"links.{link}.damping": STIFFER for link in ("lift_rod", "upper_link")},
    "modal ratio": {
        "damping": {"rule": "modal_ratio", "ratio": 0.03},
        "springs.damper": DAMPER | {"damping": 300.0},
    },
    "loss": {"damping": LOSS, "links.lift_rod.damping": LOSSY},
}


@pytest.mark.parametrize("name", CASES)
def test_frfs_with_every_mode(mapping: Any, name: str) -> None:
    """All modes together give the FRFs of the assembly, solved line by line."""
    model, sampler, variable = sampled(mapping, CASES[name])
    sample = sampler.at(variable)
    solution = sampler.solution(sample.alpha3)
    band, response = model.mechanism.response.band, model.mechanism.response
    drive = (response.point, response.direction)
    places = (drive, *(place for place in sampler.places if place != drive))
    lines = check_lines(band, free=False) / (2.0 * math.pi)
    coupled, configuration = solution.coupled, solution.configuration
    rows = model.rows(places, configuration)
    upper = np.triu_indices(len(places))
    displacements = assembled_frf(coupled, lines, rows, rows)[:, upper[0], upper[1]]
    into = coupled.restrict(rows).T
    forces = []
    for w in 2.0 * math.pi * lines:
        dynamic = (
            coupled.stiffness - w**2 * coupled.mass + 1j * (coupled.loss + w * coupled.damping)
        )
        moved = coupled.expand(np.linalg.solve(dynamic, into))
        rows = model.output_rows(sampler.forces, configuration)
        forces.append(sum((1j * w) ** i * row @ moved for i, row in enumerate(rows)).ravel())
    exact = np.hstack([displacements, forces])
    off = np.linalg.norm(sample.totals - exact, axis=0) / np.linalg.norm(exact, axis=0)
    assert off.max() < 1e-9


def test_poles_where_all_modes_are_far(mapping: Any) -> None:
    """With all modes far above the limit, more poles than those of the response are found."""
    response = mechanism_from_mapping(mapping).response
    omega = np.geomspace(1e4, 1e6, 2 * response.modes)
    damping = np.diag(0.02 * omega) + 1.0
    q, v, _ = _viscous(omega, damping, 100.0, response)
    rates = np.vstack([v, -(omega[:, np.newaxis] ** 2) * q - damping @ v])
    found = np.linalg.eigvals(np.linalg.lstsq(np.vstack([q, v]), rates, rcond=None)[0])
    lowest = np.sort(np.abs(found))[::2][: response.modes + 1]
    assert lowest == pytest.approx(omega[: response.modes + 1], rel=1e-4)


@pytest.mark.parametrize(
    ("dashpot", "near"), [(0.0, 0.0), (11.0, 0.0), (13.0, 0.0), (80.0, 0.0), (0.0, 1e6)]
)
def test_poles_beside_far_modes(mapping: Any, dashpot: float, near: float) -> None:
    """Poles up to a limit are those of the whole matrix of q'' + D q' + W^2 q, to 1e-9 of decay.

    A dashpot on far modes is absent, is weak enough, too strong, or makes a pole below the limit.
    One on a near mode makes a pole that is faster than all far modes.
    """
    random, limit = np.random.default_rng(4), 900.0
    omega = np.geomspace(20.0, 3e5, 40)
    coupling = random.standard_normal((40, 3)) * np.where(omega < 5e3, 0.5, 3.0)[:, np.newaxis]
    damping = coupling @ coupling.T + np.diag(0.02 * omega)
    damping[-5:, -5:] += dashpot * 1e5 * np.ones((5, 5))
    damping[3, 3] += near
    response = mechanism_from_mapping(mapping).response
    q, v, others = _viscous(omega, damping, limit, response)
    matrix = np.block([[np.zeros((40, 40)), np.diag(omega)], [-np.diag(omega), -damping]])
    exact = np.linalg.eigvals(matrix)
    exact = exact[np.abs(exact) < limit]
    assert (np.isreal(exact).any()) == (dashpot > 20.0 or near > 0.0)
    rates = np.vstack([v, -(omega[:, np.newaxis] ** 2) * q - damping @ v])
    moved = np.linalg.lstsq(np.vstack([q, v]), rates, rcond=None)[0]
    found = np.linalg.eigvals(moved)
    assert len(found) == len(exact)
    rounding = 10.0 * np.finfo(float).eps * np.linalg.norm(damping)
    for pole in exact:
        assert np.abs(found - pole).min() < 1e-9 * abs(pole.real) + rounding
    assert np.abs(others).min() > limit


@pytest.mark.parametrize("stacks", [True, False])
def test_points_solved_together(
    mapping: Any, monkeypatch: pytest.MonkeyPatch, stacks: bool
) -> None:
    """They have the poles and FRFs of points solved alone, which those that fail together are."""
    _, together, variable = sampled(mapping, CASES["loss"])
    _, alone, _ = sampled(mapping, CASES["loss"])
    variables = [variable, variable + 0.01, variable + 0.02]
    if not stacks:
        monkeypatch.setattr(LinkageModel, "stack", _fail)
    together.prepare(variables)
    assert len(together._powers) == (3 if stacks else 0)
    for x in variables:
        one, other = together.at(x), alone.at(x)
        assert one.poles == pytest.approx(other.poles, rel=1e-10)
        np.testing.assert_allclose(one.totals, other.totals, rtol=1e-8)


def _fail(*_: object) -> None:
    raise LinkageVibrationError("One of the angles has no solution.")
