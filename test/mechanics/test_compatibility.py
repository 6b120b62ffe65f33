# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The compatibility matrix against the paper's equation and the linkage's own motion."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.mechanics.compatibility import CouplingError, row_space
from linkage_vibration.mechanics.description import MechanismError
from linkage_vibration.mechanics.kinematics import rotation
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping

SPRINGS = {
    "oil": {"joint": "P3", "stiffness": 1e5, "damping": 20.0},
    "stay": {"between": ["P2", "V1"], "stiffness": 3e5},
    "mast": {"between": ["V2", "E2"], "stiffness": 2e5},
}


@pytest.fixture
def sprung(mapping: Any) -> LinkageModel:
    """Return the paper's linkage with springs and without its clamp."""
    del mapping["links"]["input_crank"]["clamped"]
    mapping["springs"] = SPRINGS
    return LinkageModel(mechanism_from_mapping(mapping))


def test_pin_rows_are_equation_22(model: LinkageModel) -> None:
    """A pin's two rows hold the rotations of the two links, the second with a minus."""
    configuration = model.kinematics.at(math.radians(117.0))
    rows = model.interface.join(configuration)
    at = [i for i, label in enumerate(rows.labels) if "pin V1" in label]
    r, s = configuration.angle("lower_link"), configuration.angle("lift_rod")
    expected = np.array(
        [
            [math.cos(r), -math.sin(r), -math.cos(s), math.sin(s)],
            [math.sin(r), math.cos(r), -math.sin(s), -math.cos(s)],
        ]
    )
    block = rows.compatibility[at]
    np.testing.assert_allclose(block[:, np.abs(block).sum(axis=0) > 0.0], expected, rtol=1e-14)


@pytest.mark.parametrize("alpha3_deg", [90.0, 133.0, 180.0])
def test_the_linkages_own_motion_is_compatible(model: LinkageModel, alpha3_deg: float) -> None:
    """What the kinematics say of every point's motion opens no pin.

    Only the rotation that holds the crank is violated, by the crank's own unit rotation.
    """
    configuration = model.kinematics.at(math.radians(alpha3_deg))
    violation = model.interface.join(configuration).compatibility @ motion(model, alpha3_deg)
    np.testing.assert_allclose(violation[:-1], 0.0, atol=1e-13)
    assert violation[-1] == pytest.approx(1.0)


def motion(model: LinkageModel, alpha3_deg: float) -> np.ndarray:
    """Return the interface DoFs' rates with alpha3, from the kinematics alone."""
    configuration = model.kinematics.at(math.radians(alpha3_deg))
    actual: list[float] = []
    for component in model.components:
        points = model.mechanism.local_points(component.name)
        for dof in component.dofs:
            rate = configuration.velocity_ratio(component.name)
            if dof.direction != "theta":
                body = next(b for b in model.mechanism.bodies if b.name == component.name)
                local = points.get(dof.point) or body.centre_of_gravity  # type: ignore[union-attr]
                turn = rotation(configuration.angle(component.name)) if dof.point in points else 1.0
                moved = np.eye(2) @ configuration.place_rate(component.name, local)
                if not isinstance(turn, float):
                    moved = turn.T @ moved
                rate = moved["xz".index(dof.direction)]
            actual.append(float(rate))
    return np.array(actual)


@pytest.mark.parametrize("alpha3_deg", [95.0, 140.0, 175.0])
def test_springs_stretch_as_the_linkage_moves(sprung: LinkageModel, alpha3_deg: float) -> None:
    """A spring's row on the linkage's own motion is the derivative of its length or angle."""
    h = 1e-6
    here, before, after = (sprung.kinematics.at(math.radians(alpha3_deg) + d) for d in (0.0, -h, h))
    stretch = sprung.interface.join(here).elongation @ motion(sprung, alpha3_deg)
    rates = [1.0]
    for spring in sprung.mechanism.springs[1:]:
        lengths = []
        for configuration in (before, after):
            ends = [
                configuration.place(body, sprung.mechanism.local_points(body)[point])
                for body, point in zip(spring.bodies, spring.points, strict=True)
            ]
            lengths.append(math.dist(*ends))
        rates.append((lengths[1] - lengths[0]) / (2 * h))
    np.testing.assert_allclose(stretch, rates, atol=1e-8)


def test_spring_without_a_direction_is_refused(mapping: Any) -> None:
    """A spring between two points that meet is named in the error."""
    mapping["ground"]["S"] = [-0.5, 0.0]
    mapping["links"]["lower_link"]["points"] = {"P1": 0.0, "V1": 0.366, "Q": 0.5, "E1": 0.81}
    mapping["springs"] = {"stay": {"between": ["S", "Q"], "stiffness": 1.0}}
    model = LinkageModel(mechanism_from_mapping(mapping))

    def gap(alpha3: float) -> float:
        return float(model.kinematics.at(alpha3).place("lower_link", (0.5, 0.0))[1])

    low, high = math.radians(100.0), math.radians(170.0)
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if gap(low) * gap(middle) > 0 else (low, middle)
    with pytest.raises(MechanismError, match=r"springs\.stay: .*meet at"):
        model.solve(low)


@given(st.integers(0, 2**32 - 1), st.integers(0, 6), st.integers(0, 5))
def test_rows_that_repeat_are_left_out(seed: int, rank: int, extra: int) -> None:
    """Combinations of rows are found, however many, and what is left spans the same."""
    rng = np.random.default_rng(seed)
    rows = np.linalg.qr(rng.normal(size=(9, 9)))[0][:rank]
    matrix = np.vstack([rows, rng.integers(-2, 3, (extra, rank)) @ rows])
    basis, null_space = row_space(matrix, [""] * len(matrix))
    assert basis.shape == (rank, 9)
    both = np.vstack([basis, null_space.T])
    np.testing.assert_allclose(both @ both.T, np.eye(9), atol=1e-12)
    np.testing.assert_allclose(matrix @ null_space, 0.0, atol=1e-12)
    np.testing.assert_allclose(matrix @ basis.T @ basis, matrix, atol=1e-12)


def test_cut_off_has_a_clear_side() -> None:
    """A row 1e-13 beside another repeats it, one 1e-5 beside it does not; between, an error."""

    def beside(apart: float) -> int:
        rows = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, apart, 0.0]])
        return len(row_space(rows, ["first", "other", "second"])[0])

    assert beside(0.0) == beside(1e-13) == 2
    assert beside(1e-5) == 3
    with pytest.raises(CouplingError, match=r"7\.1e-08 of the largest .*: first; second\."):
        beside(1e-7 * 2**0.5)


def test_a_joint_of_a_body_with_itself(model: LinkageModel) -> None:
    """Between a point and itself it says nothing, of a rigid body and of a link alike."""
    configuration = model.kinematics.at(math.radians(117.0))
    rows = [
        model.interface.displacement(body, point, configuration)[i]
        - model.interface.displacement(body, point, configuration)[i]
        for body, point in (("implement", "E2"), ("lower_link", "V1"))
        for i in (0, 1)
    ]
    joining = model.interface.join(configuration)
    matrix = np.vstack([joining.compatibility, *rows])
    n = len(joining.labels)
    assert len(row_space(matrix, [""] * len(matrix))[0]) == n
