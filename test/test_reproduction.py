# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers and figures of the paper beside ours."""

import csv
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from benchmark.freed_dimensions import (
    FreedFit,
    draw,
    draw_mast_and_inertia,
    generalised_inertia,
    scan_freed_dimensions,
)
from benchmark.paper.figures import draw_figures
from benchmark.paper.numbers import GEOMETRY, printed_numbers
from benchmark.reproduce import CORRECTED, FILES, PRINTED, _sweep, _write_numbers, geometry
from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Kinematics
from linkage_vibration.mechanics.model import Solution
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.support.resources import config_file

REFERENCE = Path(__file__).parents[2] / "shared/reference/published_numbers.yaml"
SWEEPS = tuple[dict[str, list[Solution]], dict[str, dict[str, float]]]


def coarse(mechanism: Mechanism) -> Mechanism:
    """Return a linkage with few elements and modes."""
    links = []
    for link in mechanism.links:
        assert isinstance(link.body, Beam)
        links.append(replace(link, body=replace(link.body, elements=6), modes=3))
    return replace(mechanism, links=tuple(links))


@pytest.fixture(scope="module")
def sweeps(mechanism: Mechanism, printed: Mechanism) -> SWEEPS:
    """Return seven coarse solutions of both geometries, and our numbers."""
    solutions, numbers = {}, {}
    for label, each in ((CORRECTED, mechanism), (PRINTED, printed)):
        solutions[label], actual = _sweep(coarse(each), np.radians(np.linspace(90.0, 180.0, 7)))
        numbers[label] = {**geometry(load_yaml(config_file(FILES[label]))[0]), **actual}
    return solutions, numbers


def flat(value: Any, path: str = "") -> dict[str, float]:
    """Return the numbers of nested mappings and lists by their joined keys."""
    if isinstance(value, Mapping):
        pairs = [(str(key), each) for key, each in value.items()]
    elif isinstance(value, list):
        pairs = [(str(i), each) for i, each in enumerate(value)]
    else:
        return {path: float(value)} if isinstance(value, int | float) else {}
    return {k: v for key, each in pairs for k, v in flat(each, f"{path}.{key}".strip(".")).items()}


@pytest.mark.skipif(not REFERENCE.exists(), reason=f"{REFERENCE} is missing")
def test_every_published_number_is_held() -> None:
    """The package has exactly the numbers of the reference."""
    reference = yaml.safe_load(REFERENCE.read_text())
    reference["reduction"] = {
        name: {"physical": pair[0], "modal": pair[1]}
        for name, pair in reference["reduction"].items()
    }
    for point in ("P1", "P2", "P3"):
        reference["geometry"][point] = dict(zip("xz", reference["geometry"][point], strict=True))
    fixed = reference["natural_frequencies_hz"]["at_140_deg"]
    for name in fixed:
        fixed[name] = {str(mode): value for mode, value in enumerate(fixed[name], 1)}
    assert {number.key: number.value for number in printed_numbers()} == flat(reference)


def test_table_has_every_number(tmp_path: Path, sweeps: SWEEPS) -> None:
    """Each printed number has a row with our number and the relative difference."""
    _write_numbers(tmp_path, sweeps[1])
    with (tmp_path / "numbers.csv").open() as file:
        rows = {row["key"]: row for row in csv.DictReader(file)}
    assert list(rows) == [number.key for number in printed_numbers()]
    for number in printed_numbers():
        row = rows[number.key]
        assert float(row["printed"]) == number.value
        for label in (CORRECTED, PRINTED):
            if row[label] and number.value:
                difference = float(row[f"relative difference, {label}"])
                expected = float(row[label]) / number.value - 1.0
                assert difference == pytest.approx(expected, rel=1e-5, abs=1e-8)
            elif not row[label]:
                assert number.key.startswith(("timing_s.full_fe", "timing_s.speed_up"))
    text = (tmp_path / "numbers.md").read_text()
    assert all(number.quantity in text for number in printed_numbers())


def test_physical_dofs_are_those_in_the_plane(sweeps: SWEEPS) -> None:
    """Table 2 has three for each pin, of which we have two, and the rotation of the crank at P3."""
    for name, printed in (("lower_links", 9), ("upper_link", 6), ("lift_rods", 6)):
        assert sweeps[1][CORRECTED][f"reduction.{name}.physical"] == printed * 2 / 3
    assert sweeps[1][CORRECTED]["reduction.input_cranks.physical"] == 6 * 2 / 3 + 1
    assert sweeps[1][CORRECTED]["reduction.implement.physical"] == 3  # x, z and the rotation


def test_our_geometry_is_the_printed_one(sweeps: SWEEPS) -> None:
    """The printed geometry has every dimension of Table 1; the other differs in one only."""
    for number in printed_numbers(GEOMETRY):
        assert sweeps[1][PRINTED][number.key] == pytest.approx(number.value, rel=1e-12)
        if number.key != "geometry.P2_E2":
            assert sweeps[1][CORRECTED][number.key] == pytest.approx(number.value, rel=1e-12)
    assert sweeps[1][CORRECTED]["geometry.P2_E2"] == 0.520


def test_printed_length_contradicts_the_printed_curve(sweeps: SWEEPS) -> None:
    """With 0.420 m mode 1 rises and falls again; with 0.520 m it rises over the whole stroke."""
    first = {
        label: [solution.natural_frequencies[0] for solution in solutions]
        for label, solutions in sweeps[0].items()
    }
    assert np.all(np.diff(first[CORRECTED]) > 0.0)
    assert first[PRINTED][-1] < 0.6 * max(first[PRINTED])


def test_generalised_inertia_is_that_of_moving_places(mechanism: Mechanism) -> None:
    """J agrees with finite differences of the implement's place and angle over alpha3."""
    kinematics = Kinematics(mechanism)
    [body] = mechanism.rigid_bodies
    step = 1e-5
    before, after = (kinematics.at(2.0 + sign * step) for sign in (-1, 1))
    moved = after.place(body.name, body.centre_of_gravity) - before.place(
        body.name, body.centre_of_gravity
    )
    turned = after.angle(body.name) - before.angle(body.name)
    expected = (body.mass * float(moved @ moved) + body.inertia * turned**2) / (2.0 * step) ** 2
    assert generalised_inertia(mechanism, kinematics.at(2.0)) == pytest.approx(expected, rel=1e-7)


@pytest.mark.nightly(short="test_table_has_every_number")
def test_figures_are_written(tmp_path: Path, sweeps: SWEEPS) -> None:
    """Figures 3 to 9 and the evidence are written, and no temporary file."""
    fits = [FreedFit("", math.nan, 0.2, 0.4, 0.3), FreedFit("geometry.P2_E2", 0.5, 0.01, 0.1, 0.1)]
    draw_figures(tmp_path, sweeps[0])
    draw(fits).savefig(tmp_path / "freed_dimensions.png")
    draw_mast_and_inertia(sweeps[0]).savefig(tmp_path / "mast_and_inertia.png")
    pictures = {path.name: path.stat().st_size for path in tmp_path.iterdir()}
    assert {name[:4] for name in pictures if name.startswith("fig")} == {
        f"fig{i}" for i in range(3, 10)
    }
    assert {"mast_and_inertia.png", "freed_dimensions.png"} <= pictures.keys()
    assert len(pictures) == 9


@pytest.mark.nightly(alone="four steps of least squares take minutes")
def test_freeing_the_upper_link_fits_better() -> None:
    """With its length free, a few steps of least squares meet the frequencies better."""
    none, upper = scan_freed_dimensions(["geometry.P2_E2"], evaluations=4)
    assert none.key == ""
    assert math.isnan(none.value)
    assert upper.cost < 0.5 * none.cost
    assert upper.value > 0.45
    assert math.degrees(none.lean) == pytest.approx(90.0 - 72.23, abs=0.01)
