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
from scipy.optimize import minimize_scalar

from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.bodies.matrices import Matrices
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.description import Mechanism, Rayleigh
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.studies.plan.choice import (
    ELEMENTS,
    MODES,
    Measured,
    Plan,
    measure,
    plan,
    plan_and_measure,
    plan_report,
    solve_reference,
    write_planned,
)
from linkage_vibration.studies.plan.question import PlanError, Result, Scene, result_at
from linkage_vibration.studies.plan.unknowns import unknowns
from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file

PLACES = (("E1", "z"), ("V1", "x"))
STROKE = (math.radians(90.0), math.radians(180.0))
LOW = (0.0, 200.0)
LIVE = 50e-6  # s; a lookup takes about 3 us, a solve 500 us


@dataclass(frozen=True)
class Job:
    """The plan for a scene, its reference, and its measurement."""

    plan: Plan
    against: list[Result]
    measured: Measured

    def share(self, **cheaper: object) -> float:
        """Return the measured error with other settings, divided by the allowed one."""
        other = measure(replace(self.plan, **cheaper), self.against)  # type: ignore[arg-type]
        return self.plan.scene.share(other.errors)


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
    "whole stroke, live": lambda m: Scene(m, LOW, PLACES, 2e-4, STROKE, LIVE),
    "on the tractor": lambda m: Scene(on_tractor(), LOW, PLACES, 1e-3, (math.radians(150.0),) * 2),
    "heavier implement": lambda m: Scene(heavier(m), LOW, PLACES, 1e-4, STROKE, LIVE),
}


@pytest.fixture(scope="module", params=SCENES)
def job(request: pytest.FixtureRequest, mechanism: Mechanism) -> Job:
    """Return the plan and the measurement of each scene."""
    chosen = plan(SCENES[request.param](mechanism))
    against = solve_reference(chosen)
    return Job(chosen, against, measure(chosen, against))


def test_plan_meets_its_tolerance(job: Job) -> None:
    """The error measured against a finer mesh is allowed, and within a tenth of the prediction."""
    scene = job.plan.scene
    share = scene.share(job.measured.errors)
    assert share <= 1.0
    assert share == pytest.approx(scene.share(job.plan.predicted), rel=0.1)


def test_fewer_elements_or_modes_do_not(job: Job) -> None:
    """One step fewer elements, or one step fewer modes, misses the tolerance."""
    fewer = ELEMENTS[ELEMENTS.index(job.plan.elements) - 1]
    assert job.share(elements=fewer) > 1.0
    fewer = MODES[MODES.index(job.plan.modes) - 1]
    assert job.share(modes=fewer) > 1.0


@pytest.mark.parametrize("job", ["whole stroke, live", "heavier implement"], indirect=True)
def test_fewer_points_do_not(job: Job) -> None:
    """A table with fewer points misses the tolerance."""
    assert job.plan.table_tolerance is not None
    looser, points = job.plan.table_tolerance, job.measured.points
    while points == job.measured.points:
        looser = 4.0 * looser
        other = measure(replace(job.plan, table_tolerance=looser), job.against)
        points = other.points
    assert points < job.measured.points
    assert job.plan.scene.share(other.errors) > 1.0


def test_what_each_scene_gets(mechanism: Mechanism, job: Job) -> None:
    """Only live scenes get a table, as large as predicted."""
    live = math.isfinite(job.plan.scene.seconds_per_prediction)
    assert (job.plan.table_tolerance is not None) == live
    choices = [choice for choice, _ in job.plan.reasons]
    assert (f"table of {job.measured.points} points" in choices) == live
    for link in job.plan.mechanism.links:
        assert isinstance(link.body, Beam)
        assert (link.body.elements, link.modes) == (job.plan.elements, job.plan.modes)
    text = plan_report(job.plan, job.measured)
    assert f"elements a link: {job.plan.elements}" in text
    assert f"{job.measured.errors[0]:.1e}" in text


def test_a_wider_band_or_a_tighter_tolerance_costs_more(mechanism: Mechanism) -> None:
    """From 40 Hz to 200 Hz, and to a tenth of the tolerance, elements and modes increase."""
    one = (STROKE[0], STROKE[0])
    plans = [
        plan(Scene(mechanism, band, PLACES, tolerance, one))
        for band, tolerance in (((0.0, 40.0), 1e-3), (LOW, 1e-3), (LOW, 1e-4))
    ]
    assert [(p.elements, p.modes) for p in plans] == sorted({(p.elements, p.modes) for p in plans})
    assert plans[0].elements < plans[1].elements < plans[2].elements
    assert plans[0].modes < plans[1].modes < plans[2].modes


def test_nothing_is_computed_that_is_not_asked_for(mechanism: Mechanism) -> None:
    """Without places there are no FRFs; with enough time or at one angle there is no table."""
    scene = Scene(mechanism, LOW, (), 1e-3, STROKE, 60.0)
    chosen = plan(scene)
    assert chosen.table_tolerance is None
    assert chosen.predicted[2] == 0.0
    measured = measure(chosen, solve_reference(chosen))
    assert measured.points == 0
    live = plan(replace(scene, angles=(STROKE[0], STROKE[0]), seconds_per_prediction=1e-6))
    assert live.table_tolerance is None


def test_links_known_by_matrices_keep_them(mechanism: Mechanism) -> None:
    """A plan chooses their modes, but cannot change their mesh."""
    crank = next(link for link in mechanism.links if link.clamped)
    one = replace(crank, count=1)
    part = one.body.component(one, mechanism, reduced=False)
    assert isinstance(part, Component)
    given = replace(crank, body=Matrices(part.dofs, part.mass, part.stiffness))
    links = tuple(given if link is crank else link for link in mechanism.links)
    scene = Scene(replace(mechanism, links=links), LOW, (), 1e-3, (STROKE[0],) * 2)
    chosen = plan(scene)
    assert next(x for x in chosen.mechanism.links if x.name == crank.name).body == given.body
    assert scene.share(measure(chosen, solve_reference(chosen)).errors) <= 1.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"band": (200.0, 0.0)}, "two frequencies that ascend"),
        ({"tolerance": 0.0}, "from 1e-9 to 1"),
        ({"tolerance": 1e-9, "band": (0.0, 2e4), "angles": (2.0, 2.0)}, "give a larger tolerance"),
        ({"angles": (2.0, 1.0)}, "the smaller one first"),
        ({"seconds_per_prediction": 0.0}, "time limit of 0 microseconds.*positive"),
        ({"seconds_per_prediction": math.nan}, "time limit of nan microseconds.*positive"),
        ({"tolerance": 1e-7, "seconds_per_prediction": 1e-6}, "give a tolerance of 2e-07 or more"),
    ],
)
def test_scenes_that_cannot_be(
    mechanism: Mechanism, changes: dict[str, object], words: str
) -> None:
    """The error says what is wrong with a scene and how to correct it."""
    scene = Scene(mechanism, (0.0, 40.0), PLACES, 1e-3, (2.0, 2.1))
    with pytest.raises(PlanError, match=words):
        plan(replace(scene, **changes))  # type: ignore[arg-type]


def test_what_is_accepted_was_measured(mechanism: Mechanism) -> None:
    """The measured errors of a plan that is accepted meet the tolerance that was asked for."""
    scene = Scene(mechanism, LOW, PLACES, 1e-3, (STROKE[0],) * 2)
    chosen, measured = plan_and_measure(scene)
    assert chosen.scene == scene
    assert scene.share(measured.errors) <= 1.0


def test_plan_that_its_measurement_rejects(printed: Mechanism) -> None:
    """A mode that enters the band between the angles of a plan shows in its measurement alone."""
    model = LinkageModel(printed)

    def below(alpha3: float) -> float:
        return -float(model.solve(alpha3).natural_frequencies[0])

    found = minimize_scalar(below, bounds=(2.93, 2.98), method="bounded")
    highest, top, width = float(found.x), -float(found.fun), math.radians(20.0)
    stroke = highest - 0.56 * width, highest + 0.44 * width  # it is measured at 0.56
    scene = Scene(printed, (0.999 * top, 12.0), (), 1e-6, stroke)
    first = plan(scene)
    assert scene.share(first.predicted) <= 1.0
    assert scene.share(measure(first, solve_reference(first)).errors) > 1.0
    chosen, measured = plan_and_measure(scene)
    assert scene.share(measured.errors) <= 1.0
    assert chosen.modes > first.modes
    assert chosen.reasons[-1][0] == "planned to a part of it"


@pytest.mark.nightly
def test_six_bar_against_a_dense_measurement() -> None:
    """A plan of the Stephenson linkage meets its tolerance at a hundred angles."""
    mechanism = read_mechanism(config_file("stephenson_six_bar.yaml"))
    places = (("E", "x"), ("P", "z"))
    scene = Scene(mechanism, mechanism.response.band, places, 1e-4, mechanism.stroke)
    chosen, _ = plan_and_measure(scene)
    model = LinkageModel(chosen.mechanism)
    fine = LinkageModel(scene.with_settings(4 * chosen.elements, 4 * chosen.modes, chosen.n_modes))
    errors = []
    for angle in np.linspace(*mechanism.stroke, 101).tolist():
        errors.append(result_at(scene, model, angle).errors(result_at(scene, fine, angle)))
    assert scene.share(np.max(errors, axis=0)) <= 1.0


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
    assert chosen.n_modes != chosen.modes
    with pytest.raises(PlanError, match="one number in the file"):
        write_planned(chosen, shared.replace("  modes: 3", "  modes: *kept"), target)


def test_numbers_that_are_not_known_limit_the_accuracy(mapping: Any) -> None:
    """Every frequency grows with the root of the modulus, so its deviation is half of that."""
    modulus, mass = "links.lower_link.material.youngs_modulus", "rigid_bodies.implement.mass"
    mapping["uncertainty"] = {"relative": {mass: 1e-4, modulus: 0.1}}
    mechanism = mechanism_from_mapping(mapping)
    found = unknowns(mechanism, (0.0, 200.0), [2.0, 2.5])
    assert found is not None
    assert found.path == modulus
    assert found.share == pytest.approx(1.0, abs=1e-4)
    assert found.tolerance == pytest.approx(0.005, rel=1e-3)
    assert f"Measure next: {modulus}, which causes 100 % of the variance" in str(found)
    del mapping["uncertainty"]
    assert unknowns(mechanism_from_mapping(mapping), (0.0, 200.0), [2.0]) is None


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
    found = unknowns(mechanism_from_mapping(mapping), (0.0, 400.0), [1.0, 1.5])
    assert found is not None
    assert found.path == f"springs.{names[path == 'second']}.stiffness"
    assert found.share == pytest.approx(0.5, abs=1e-6)
