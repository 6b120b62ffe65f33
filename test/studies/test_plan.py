# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A plan meets its tolerance, and the next cheaper settings do not."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import Mechanism, Rayleigh
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.studies.plan import (
    ELEMENTS,
    MODES,
    Plan,
    PlanError,
    Scene,
    plan,
    plan_report,
    write_planned,
)
from linkage_vibration.studies.unknowns import needed_tolerance
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
from linkage_vibration.table.tabulation import build_table

PLACES = (("E1", "z"), ("V1", "x"))
STROKE = (math.radians(90.0), math.radians(180.0))
LOW = (0.0, 200.0)


@dataclass(frozen=True)
class Job:
    """The plan for a scene, and an unreduced, finer model at other angles."""

    plan: Plan
    exact: dict[float, Solution]

    def share(self, elements: int, modes: int) -> float:
        """Return the largest error of a model, divided by the allowed one."""
        scene = self.plan.scene
        model = LinkageModel(scene.with_settings(elements, modes, 1))
        errors = [errors_of(scene, model.solve(at), exact) for at, exact in self.exact.items()]
        return float((np.max(errors, axis=0) / scene.allowed).max())


def errors_of(scene: Scene, solution: Solution, exact: Solution) -> list[float]:
    """Return the relative errors of frequencies in the band, of the peak and of FRFs."""
    wanted = exact.natural_frequencies
    wanted = wanted[(wanted > scene.band[0]) & (wanted <= scene.band[1])]
    frequencies = solution.natural_frequencies
    apart = [float(np.abs(frequencies / each - 1.0).min()) for each in wanted.tolist()]
    band = exact.model.mechanism.response.peak_band
    peak = solution.peak(band).magnitude / exact.peak(band).magnitude - 1.0
    if not scene.places:
        return [max(apart), abs(peak), 0.0]
    lines = np.linspace(max(scene.band[0], 1e-3), scene.band[1], 8_001)
    frfs, right = (each.frf(scene.places, scene.places).frf(lines) for each in (solution, exact))
    off = np.linalg.norm(frfs - right, axis=0) / np.linalg.norm(right, axis=0)
    return [max(apart), abs(peak), float(off.max())]


def finer(chosen: Plan) -> dict[float, Solution]:
    """Return solutions of an unreduced model at other angles than those of the plan."""
    low, high = chosen.scene.angles
    fractions = (0.5,) if low == high else (0.003, 0.13, 0.31, 0.56, 0.8, 0.997)
    elements = max(2 * chosen.elements, min(6 * chosen.elements, 96))
    model = LinkageModel(chosen.scene.with_settings(elements, 0, 1), reduced=False)
    return {at: model.solve(at) for at in (low + f * (high - low) for f in fractions)}


def heavier(mechanism: Mechanism) -> Mechanism:
    """Return the linkage with an implement that is half as heavy again."""
    implement = replace(mechanism.rigid_bodies[0], mass=1200.0, inertia=350.0)
    return replace(mechanism, rigid_bodies=(implement,))


def on_tractor() -> Mechanism:
    """Return the linkage on its tractor, with the oil that holds its crank."""
    return read_mechanism(config_file(DEFAULT_MECHANISM))


SCENES: dict[str, Callable[[Mechanism], Scene]] = {
    "up to 40 Hz": lambda m: Scene(m, (0.0, 40.0), PLACES, 8e-8, STROKE),
    "up to 200 Hz": lambda m: Scene(m, LOW, PLACES, 1e-3, STROKE),
    "up to 2 kHz": lambda m: Scene(
        m, (0.0, 2000.0), (("E1", "z"),), 1.5e-2, (math.radians(130.0), math.radians(150.0))
    ),
    "one angle": lambda m: Scene(m, LOW, PLACES, 1e-4, (math.radians(140.0),) * 2),
    "whole stroke": lambda m: Scene(m, LOW, PLACES, 2e-4, STROKE),
    "on the tractor": lambda m: Scene(on_tractor(), LOW, PLACES, 1e-3, (math.radians(150.0),) * 2),
    "heavier implement": lambda m: Scene(heavier(m), LOW, PLACES, 1e-4, STROKE),
}


USUAL = "up to 40 Hz", "whole stroke", "on the tractor"
NIGHTLY = [pytest.param(name, marks=pytest.mark.nightly) for name in SCENES if name not in USUAL]


@pytest.fixture(scope="module", params=[*USUAL, *NIGHTLY])
def job(request: pytest.FixtureRequest, mechanism: Mechanism) -> Job:
    """Return the plan and the finer model of each scene."""
    chosen = plan(SCENES[request.param](mechanism))
    return Job(chosen, finer(chosen))


def test_plan_meets_its_tolerance(job: Job) -> None:
    """The error against an unreduced, finer mesh is allowed, and within a tenth of that stated."""
    share = job.share(job.plan.elements, job.plan.modes)
    assert share <= 1.0
    assert share == pytest.approx(job.plan.scene.share(job.plan.errors), rel=0.1)


def test_fewer_elements_or_modes_do_not(job: Job) -> None:
    """One step fewer elements, or one step fewer modes, misses the tolerance."""
    elements, modes = job.plan.elements, job.plan.modes
    assert job.share(ELEMENTS[ELEMENTS.index(elements) - 1], modes) > 1.0
    assert job.share(elements, MODES[MODES.index(modes) - 1]) > 1.0


def test_what_each_scene_gets(job: Job) -> None:
    """The planned mechanism has the settings of the plan, and the report shows them."""
    for link in job.plan.mechanism.links:
        assert isinstance(link.body, Beam)
        assert (link.body.elements, link.modes) == (job.plan.elements, job.plan.modes)
    text = plan_report(job.plan)
    assert f"elements a link: {job.plan.elements}" in text
    assert f"{job.plan.errors[0]:.1e}" in text


@pytest.mark.parametrize("job", ["whole stroke"], indirect=True)
def test_a_table_of_the_plan_meets_the_tolerance(job: Job) -> None:
    """Built to what the model leaves, a table is accurate enough against the finer model."""
    scene = job.plan.scene
    table = build_table(LinkageModel(job.plan.mechanism), job.plan.table_tolerance, ["E1", "V1"])
    bounds = np.array([table.interpolation_error.max(), table.peak_error, table.frf_error])
    assert scene.share(job.plan.errors + bounds) <= 1.0
    for alpha3, exact in job.exact.items():
        wanted = exact.natural_frequencies[: table.n_modes]
        values = np.sort(table.interpolate(alpha3)[0][: table.n_modes])
        assert values == pytest.approx(wanted, rel=scene.tolerance)


def test_a_wider_band_or_a_tighter_tolerance_costs_more(mechanism: Mechanism) -> None:
    """From 40 Hz to 200 Hz, and to a tenth of the tolerance, elements and modes increase."""
    first = (STROKE[0], STROKE[0])
    plans = [
        plan(Scene(mechanism, band, PLACES, tolerance, first))
        for band, tolerance in (((0.0, 40.0), 1e-3), (LOW, 1e-3), (LOW, 1e-4))
    ]
    assert [(p.elements, p.modes) for p in plans] == sorted({(p.elements, p.modes) for p in plans})
    assert plans[0].elements < plans[1].elements < plans[2].elements
    assert plans[0].modes < plans[1].modes < plans[2].modes


def test_frfs_that_are_not_asked_for(mechanism: Mechanism) -> None:
    """Without places there are no FRFs, and no error of any."""
    assert plan(Scene(mechanism, LOW, (), 1e-3, STROKE)).errors[2] == 0.0


def test_links_known_by_matrices_keep_them(mechanism: Mechanism) -> None:
    """A plan chooses their modes, but cannot change their mesh."""
    crank = next(link for link in mechanism.links if link.clamped)
    first = replace(crank, count=1)
    part = first.body.component(first, mechanism, reduced=False)
    assert isinstance(part, Component)
    given = replace(crank, body=Matrices(part.dofs, part.mass, part.stiffness))
    links = tuple(given if link is crank else link for link in mechanism.links)
    scene = Scene(replace(mechanism, links=links), LOW, (), 1e-3, (STROKE[0],) * 2)
    chosen = plan(scene)
    assert next(x for x in chosen.mechanism.links if x.name == crank.name).body == given.body
    assert Job(chosen, finer(chosen)).share(chosen.elements, chosen.modes) <= 1.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"band": (200.0, 0.0)}, "two frequencies that ascend"),
        ({"tolerance": 0.0}, "from 1e-9 to 1"),
        ({"tolerance": 1.0}, "from 1e-9 to 1"),
        ({"tolerance": 1e-9, "band": (0.0, 2e4), "angles": (2.0, 2.0)}, "give a larger tolerance"),
        ({"angles": (2.0, 1.0)}, "the smaller one first"),
    ],
)
def test_scenes_that_cannot_be(
    mechanism: Mechanism, changes: dict[str, object], words: str
) -> None:
    """The error says what is wrong with a scene and how to correct it."""
    scene = Scene(mechanism, (0.0, 40.0), PLACES, 1e-3, (2.0, 2.1))
    with pytest.raises(PlanError, match=words):
        plan(replace(scene, **changes))  # type: ignore[arg-type]


@pytest.mark.nightly(short="test_plan_meets_its_tolerance")
def test_six_bar_against_a_dense_measurement() -> None:
    """A plan of the Stephenson linkage meets its tolerance at a hundred angles."""
    mechanism = read_mechanism(config_file("stephenson_six_bar.yaml"))
    places = (("E", "x"), ("P", "z"))
    scene = Scene(mechanism, mechanism.response.band, places, 1e-4, mechanism.stroke)
    chosen = plan(scene)
    fine = LinkageModel(scene.with_settings(4 * chosen.elements, 4 * chosen.modes, 1))
    exact = {at: fine.solve(at) for at in np.linspace(*mechanism.stroke, 101).tolist()}
    assert Job(chosen, exact).share(chosen.elements, chosen.modes) <= 1.0


def test_links_that_cannot_be_planned(mechanism: Mechanism) -> None:
    """A link given by FRFs offers no choice, and undamped FRFs have no relative error."""
    frfs = Frfs((), np.zeros(0), np.zeros((0, 0, 0), dtype=complex))
    links = (replace(mechanism.links[0], body=frfs), *mechanism.links[1:])
    scene = Scene(replace(mechanism, links=links), LOW, PLACES, 1e-3, STROKE)
    with pytest.raises(PlanError, match=r"links\.lower_link is given by FRFs"):
        plan(scene)
    with pytest.raises(PlanError, match="give its links damping"):
        plan(replace(scene, mechanism=replace(mechanism, damping=Rayleigh(0.0, 0.0))))


@pytest.mark.parametrize("name", ["three_point_linkage.yaml", "four_bar.yaml"])
def test_written_mechanism_is_the_planned_one(tmp_path: Path, name: str) -> None:
    """Numbers are replaced, or added if the file lacks them; comments stay."""
    source = config_file(name)
    mechanism = read_mechanism(source)
    low = mechanism.stroke[0]
    chosen = plan(Scene(mechanism, (1.0, 300.0), (), 1e-2, (low + 0.1, low + 0.5)))
    target = tmp_path / "planned.yaml"
    write_planned(chosen, source.read_text(), target)
    assert read_mechanism(target).model_hash == chosen.mechanism.model_hash
    before = [line for line in source.read_text().splitlines() if line.startswith("#")]
    assert [x for x in target.read_text().splitlines() if x.startswith("#")] == before


def test_numbers_tied_by_an_alias_are_refused(tmp_path: Path, mechanism: Mechanism) -> None:
    """Two settings that an alias makes one number cannot differ, but can change together."""
    chosen = plan(Scene(mechanism, LOW, (), 1e-2, (STROKE[0],) * 2))
    text = config_file("three_point_linkage.yaml").read_text()
    shared = text.replace("modes: 20 ", "modes: &kept 20 ", 1).replace(
        "modes: 20\n", "modes: *kept\n"
    )
    target = tmp_path / "planned.yaml"
    write_planned(chosen, shared, target)
    assert read_mechanism(target).model_hash == chosen.mechanism.model_hash
    assert chosen.mechanism.response.modes != chosen.modes
    with pytest.raises(PlanError, match="one number in the file"):
        write_planned(chosen, shared.replace("  modes: 3", "  modes: *kept"), target)


def test_numbers_that_are_not_known_limit_the_accuracy(mapping: Any) -> None:
    """Every frequency grows with the root of the modulus, so its deviation is half of that."""
    modulus, mass = "links.lower_link.material.youngs_modulus", "rigid_bodies.implement.mass"
    mapping["uncertainty"] = {"relative": {mass: 1e-4, modulus: 0.1}}
    mechanism = mechanism_from_mapping(mapping)
    tolerance, reason = needed_tolerance(mechanism, (0.0, 200.0), [2.0, 2.5])
    assert tolerance == pytest.approx(0.005, rel=1e-3)
    assert f"Measure next: {modulus}, which causes 100 % of the variance" in reason
    del mapping["uncertainty"]
    exact = mechanism_from_mapping(mapping)
    mapping["uncertainty"] = {"relative": {"damping.ratio": 0.3}}  # it moves no frequency
    for same in (exact, mechanism_from_mapping(mapping)):
        assert needed_tolerance(same, (0.0, 200.0), [2.0]) == (1e-4, "")


@pytest.mark.parametrize(
    ("deviation", "path"), [(0.2, "first"), (0.2 + 1.8e-7, "first"), (0.2 + 2.2e-7, "second")]
)
@pytest.mark.parametrize("names", [("first", "second"), ("second", "first")])
def test_the_first_of_equal_unknowns_is_named(
    names: tuple[str, str], deviation: float, path: str
) -> None:
    """Of two identical springs, that is named which the file has first, unless it matters less.

    The shares of deviations s and s (1 + d) differ by d; less than 1e-6 does not count.
    """
    text = config_file("stephenson_six_bar.yaml").read_text()
    mapping = yaml.safe_load(text)
    stay = mapping["springs"].pop("stay")
    mapping["springs"] |= {names[0]: stay, names[1]: dict(stay)}
    claims = {f"springs.{names[0]}.stiffness": 0.2, f"springs.{names[1]}.stiffness": deviation}
    mapping["uncertainty"] = {"relative": claims}
    _, reason = needed_tolerance(mechanism_from_mapping(mapping), (0.0, 400.0), [1.0, 1.5])
    named = f"springs.{names[path == 'second']}.stiffness"
    assert f"Measure next: {named}, which causes 50 % of the variance." in reason


def test_correlated_numbers_add_up() -> None:
    """Two equal springs whose numbers have the correlation 0.8 cause sqrt(1.8) times as much."""
    mapping = yaml.safe_load(config_file("stephenson_six_bar.yaml").read_text())
    mapping["springs"]["other"] = dict(mapping["springs"]["stay"])
    names = [f"springs.{name}.stiffness" for name in ("stay", "other")]
    tolerances = []
    for value in (0.0, 0.8):
        claims: dict[str, Any] = {"relative": dict.fromkeys(names, 0.2)}
        claims["correlations"] = [{"between": names, "value": value}]
        described = mechanism_from_mapping({**mapping, "uncertainty": claims})
        tolerances.append(needed_tolerance(described, (0.0, 400.0), [1.0])[0])
    assert tolerances[1] / tolerances[0] == pytest.approx(1.8**0.5, rel=1e-9)
