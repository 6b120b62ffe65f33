# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The table of the angles of a linkage's bodies."""

import math

import pytest

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.studies.pose import angle_rows, cylinder_rows, force_rows
from test.mechanics.test_closure import four_bar_mapping
from test.mechanics.test_forces import CANTILEVER, model_of
from test.mechanics.test_springs import propped, thrusts


def test_the_table_of_angles(mechanism: Mechanism) -> None:
    """Its numbers are those of the kinematics."""
    lines = angle_rows(mechanism, Kinematics(mechanism), [math.radians(90.0)]).splitlines()
    assert lines[1].split()[:5] == ["90.00", "158.90", "141.14", "238.69", "87.80"]


def test_a_coupler_that_stays_horizontal() -> None:
    """In a parallelogram its angle is 0.00 in every row, and that of the rocker is alpha3."""
    mapping = four_bar_mapping(0.3, 1.0, 0.3)
    mapping["input"]["range_deg"] = [40.0, 140.0]
    mapping["assembly"]["angles_deg"] = {"coupler": 0.0, "rocker": 90.0}
    mechanism = mechanism_from_mapping(mapping)
    angles = [math.radians(degrees) for degrees in range(40, 141, 5)]
    rows = angle_rows(mechanism, Kinematics(mechanism), angles).splitlines()[1:]
    cells = [row.split()[:3] for row in rows]
    assert cells == [[f"{d}.00", "0.00", f"{d}.00"] for d in range(40, 141, 5)]


@pytest.mark.parametrize("off", [-1e-14, 0.0, 1e-14])
def test_zeros_have_no_sign(off: float) -> None:
    """A horizontal crank has 0.00 deg, and its end the height 0.000, on either side of zero."""
    mapping = four_bar_mapping(0.3, 0.9, 0.8)
    mapping["input"]["range_deg"] = [-10.0, 100.0]
    mapping["response"]["drive_point"] = "B"
    mechanism = mechanism_from_mapping(mapping)
    row = angle_rows(mechanism, Kinematics(mechanism), [off]).splitlines()[1].split()
    assert (row[0], *row[3:]) == ("0.00", "0.300", "0.000")


def test_the_table_of_forces() -> None:
    """A bar that is clamped at P carries all of its weight there, at each angle."""
    first, *rows = force_rows(model_of(CANTILEVER), [0.5, 1.0]).splitlines()
    assert first.split() == ["alpha3", "bar:P", "[kN]"]
    weight = 7800.0 * 6e-4 * 0.8 * 9.80665
    assert [row.split()[0] for row in rows] == ["28.65", "57.30"]
    assert [float(row.split()[1]) for row in rows] == pytest.approx([weight / 1e3] * 2, abs=0.005)


def test_forces_that_nothing_carries_are_not_numbers() -> None:
    """A bar that hangs freely has NaN, and a sentence why; one that is clamped has none."""
    bar = {key: value for key, value in CANTILEVER["links"]["bar"].items() if key != "clamped"}
    _, row, reason = force_rows(model_of(CANTILEVER, "links.bar", bar), [0.5]).splitlines()
    assert row.split()[-1] == "nan"
    assert reason.startswith("Nothing holds the linkage against its weight where forces are nan")
    assert "nan" not in force_rows(model_of(CANTILEVER), [0.5])


@pytest.mark.parametrize(("height", "rod"), [(-2.0, None), (2.0, 0.03)])
def test_the_table_of_cylinders(height: float, rod: float | None) -> None:
    """Length and lever are those of the triangle, the load that of moments, and p A is the load."""
    model = propped(500.0, height, **({} if rod is None else {"rod": rod}))
    expected = thrusts(500.0, height)
    angles = [math.radians(degrees) for *_, degrees in expected]
    title, _, *rows = cylinder_rows(model, angles).splitlines()
    assert title == "strut, one of 2:"
    area = math.pi * 0.025**2 - math.pi * (0.015**2 if height > 0.0 else 0.0)
    for row, (thrust, lever, degrees) in zip(rows, expected, strict=True):
        numbers = [float(cell) for cell in row.split()]
        assert numbers[0] == pytest.approx(degrees, abs=0.005)
        assert numbers[2] == pytest.approx(1e3 * lever, abs=0.05)
        assert numbers[3] == pytest.approx(thrust / 1e3, abs=0.006)
        assert numbers[4] == pytest.approx(abs(thrust) / area / 1e5, abs=0.06)
    assert float(rows[4].split()[1]) == pytest.approx(abs(height), abs=5e-5)  # at 0 deg


def test_a_hitch_without_a_cylinder_says_how_to_describe_it(mechanism: Mechanism) -> None:
    """A clamp has no lever and no oil; a pulling cylinder without oil there has no pressure."""
    text = cylinder_rows(LinkageModel(mechanism), [2.0])
    assert "are not known; describe the spring that holds the crank by a `cylinder`" in text
    assert cylinder_rows(propped(500.0, 2.0), [0.0]).split()[-1] == "nan"
