# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares loads with those of unreduced bodies that are cut free: ``python -m benchmark.loads``.

Ten linkages are loaded by orders, and on a tractor by the ground. The references are solved line by
line with Lagrange multipliers, and integrated over time; neither uses modes or rows of forces.
"""

import copy
import math
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.linalg import null_space

from benchmark.ground import KMH, random_heights, standard_error
from benchmark.report import machine, publish, table
from linkage_vibration.drawing.palette import COLOURS, GREY, INK
from linkage_vibration.mechanics.description import Mechanism, coarser
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.ground import GroundTable, vertical_mounts
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.tabulation import build_table
from test.support.free_bodies import places_of, solve_cuts, static_forces_by_cuts, widened
from test.support.in_plane import IN_PLANE, plane_mechanism

Array = NDArray[np.float64]

PICTURE = Path(__file__).parent / "results" / "loads.png"
SHIPPED = "three_point_linkage three_point_linkage_as_printed four_bar stephenson_six_bar"
ON_TYRES = "three_point_linkage_on_tractor"
DRAWN = ("four_bar", *(f"starters/category_{i}" for i in (1, 2, 3, 4)))
SPEEDS = {Source.ENGINE: math.nan, Source.PTO: 540.0, Source.GROUND: 12.0 * KMH}
LINES = 800  # of the ground, even in their logarithm
STEP, WARM_UP, ALONE, ROLLING = 5e-4, 20.0, 10.0, 120.0  # s; the last two without and with ground
LEAST = 0.01  # of the largest load ratio; a smaller one is not compared
ELEMENTS = 8  # of each link in the integration
COLUMNS = ["linkage", "deg", "load", "Hz", "place", "package", "cut free", "difference", "elastic"]


@dataclass(frozen=True, eq=False)
class Load:
    """The velocity and the load ratios by one excitation, or by all together."""

    velocity: float  # of the response point, rms, m/s
    ratios: Array  # (n_names,): rms of the forces over those they are compared with
    elastic: Array  # (n_names,): the same, of displacements alone: no damper, no inertia at pins
    error: float = 0.0  # relative standard error of a simulation


@dataclass(frozen=True, eq=False)
class Case:
    """A linkage with its excitations at an angle."""

    name: str
    model: LinkageModel  # unreduced
    alpha3: float
    excitations: tuple[Excitation, ...]


def drawn(name: str, seed: int) -> Mechanism:
    """Return a shipped linkage with a coil-over, a mass at a pin, and other numbers."""
    rng, file = np.random.default_rng(seed), config_file(f"{name}.yaml")
    mapping: dict[str, Any] = copy.deepcopy(load_yaml(file)[0])
    mapping.pop("uncertainty", None)
    mapping["name"] = f"drawn {seed}"
    ends = ["A", "C"] if name == "four_bar" else ["P1", "E2"]
    stiffness, damping = 10.0 ** rng.uniform(4.3, 5.0), 10.0 ** rng.uniform(2.7, 3.5)
    strut = {"between": ends, "stiffness": stiffness, "damping": damping}
    mapping["springs"] = mapping.get("springs", {}) | {"strut": strut}
    first = next(iter(mapping["links"].values()))
    first["masses"] = {list(first["points"])[-1]: rng.uniform(1.0, 20.0)}
    mapping["damping"]["ratio"] = rng.uniform(0.01, 0.05)
    for body in mapping.get("rigid_bodies", {}).values():
        body["mass"] *= rng.uniform(0.7, 1.3)
    return mechanism_of(mapping, file)


def cases() -> list[Case]:
    """Return the ten cases, at one third of the stroke."""
    plain = [plane_mechanism(f"{name}.yaml") for name in (*SHIPPED.split(), ON_TYRES)]
    made = [replace(each, uncertainty=None) for each in plain]
    made += [drawn(name, seed) for seed, name in enumerate(DRAWN, 1)]
    result = []
    for mechanism in made:
        low, high = mechanism.stroke
        response, model = mechanism.response, LinkageModel(mechanism, reduced=False)
        place = f"{response.point}.{response.direction}"
        loads: dict[str, Any] = {
            "shaft": {"speed": "pto", "orders": [1, 2, 4], "force": [150.0, 80.0, 40.0]}
            | {"at": place, "at_speed": 540.0}
        }
        if mechanism.base is not None:
            wheel = {"speed": "ground", "rolling_radius": 0.8, "orders": [1]}
            wheel |= {"base_displacement": [1e-3], "at": "base:rear_axle.z", "at_speed": 5.0}
            field = {"speed": "ground", "terrain": {"class": "B"}, "raised": True, "track": 0.0}
            loads |= {"wheel": wheel, "ground": field}
        excitations = tuple(excitations_from_mapping(loads))
        result.append(Case(mechanism.name, model, low + (high - low) / 3.0, excitations))
    return result


def by_package(case: Case) -> tuple[list[Load], float]:
    """Return the loads of the package by the excitations and in total, and its total load ratio.

    The loads are those of FRFs of the table and of its ground; the total is that of levels.
    """
    model, alpha3 = (
        LinkageModel(case.model.mechanism, kinematics=case.model.kinematics),
        case.alpha3,
    )
    built, angle, found = build_table(model), np.array([case.alpha3]), list[Load]()
    levels = LevelTable(Predictor(built), model.mechanism, case.excitations)
    at = levels.at(angle, np.array([[SPEEDS[source]] for source in Source])).message(0)
    reference = built.reference_forces(angle)[: len(built.load_places), 0]
    mounts = {mount.name: mount for mount in vertical_mounts(model.mechanism)}
    orders = [each.load for each in case.excitations if each.load is not None]
    for load, (hertz, amplitude), velocity in zip(orders, sizes(case), at.velocities, strict=False):
        point, _, direction = load.place.rpartition(".")
        wheel = mounts.get(point.removeprefix("base:"))
        place = (point, direction) if wheel is None else (wheel.name, "z")
        size = amplitude / math.sqrt(2.0)
        if wheel is not None:
            size *= abs(wheel.stiffness[1] + 2j * math.pi * hertz * wheel.damping[1])
        forces = built.frf(alpha3, built.forces, [place]).frf(np.array([hertz]))[0]
        ratios = np.sqrt(squares(case, forces))[:, 0] * size / reference
        found.append(Load(float(velocity), ratios, ratios))
    terrain = next((each.terrain for each in case.excitations if each.terrain), None)
    if terrain is not None:
        ground = GroundTable(built, model.mechanism, terrain, built.forces)
        level = ground.at(angle, np.array([SPEEDS[Source.GROUND]]))
        ratios = np.sqrt(squares(case, np.sqrt(level.forces2)))[:, 0] / reference
        found.append(Load(float(level.velocity[0]), ratios, ratios))
    ratios = np.sqrt(sum(each.ratios**2 for each in found))
    return [*found, Load(float(at.total_velocity), ratios, ratios)], float(at.total_load_ratio)


def references(case: Case) -> Array:
    """Return what forces are compared with: at rest, at least a tenth of the largest."""
    static = np.sqrt(squares(case, static_forces_by_cuts(case.model, case.alpha3)[:, np.newaxis]))
    return np.asarray(np.maximum(static, 0.1 * static.max())[:, 0])


def squares(case: Case, forces: NDArray[Any]) -> Array:
    """Return squares of magnitudes at each name but tyres, (n_names, k), from (n_forces, k)."""
    names = [name for name, _ in case.model.forces.places]
    named = groupby(enumerate(names), lambda x: x[1])
    groups = [[i for i, _ in group] for name, group in named if not name.startswith("base:")]
    return np.array([(np.abs(forces[group]) ** 2).sum(axis=0) for group in groups])


def inputs(case: Case, s: complex) -> list[NDArray[Any]]:
    """Return the load of each order on the coordinates, (n,), and of each wheel on the ground."""
    model, configuration = case.model, case.model.kinematics.at(case.alpha3)
    mounts = {mount.name: mount for mount in vertical_mounts(model.mechanism)}

    def at(point: str, direction: str) -> Array:
        return np.asarray(widened(model, model.rows([(point, direction)], configuration))[0])

    wheels = [at(m.name, "z") * (m.stiffness[1] + s * m.damping[1]) for m in mounts.values()]
    columns: list[NDArray[Any]] = []
    for each in case.excitations:
        if each.load is not None:
            point, _, direction = each.load.place.rpartition(".")
            wheel = point.removeprefix("base:")
            columns.append(
                wheels[list(mounts).index(wheel)] if wheel in mounts else at(point, direction)
            )
    return [*columns, *wheels]


def sizes(case: Case) -> list[tuple[float, float]]:
    """Return frequency, Hz, and amplitude of each order."""
    loads = [(each, each.load) for each in case.excitations if each.load is not None]
    return [
        (e.ratio * SPEEDS[e.source], x.amplitude * (SPEEDS[e.source] / x.speed) ** x.exponent)
        for e, x in loads
    ]


def cut_free(case: Case) -> list[Load]:
    """Return the loads of bodies cut free, by the excitations, and in total."""
    model, reference, found = case.model, references(case), list[Load]()
    configuration = model.kinematics.at(case.alpha3)
    point = (model.mechanism.response.point, model.mechanism.response.direction)
    row = widened(model, model.rows([point], configuration))
    joining = model.interface.join(configuration)
    displaced = model.forces.rows(model.forces.places, configuration, joining)[0].real

    def responses(hertz: float, columns: NDArray[Any]) -> tuple[Any, Any, Any]:
        forces, moved = solve_cuts(model, case.alpha3, 2j * math.pi * hertz, columns)
        return 2.0 * math.pi * hertz * (row @ moved)[0], forces, displaced @ moved

    for i, (hertz, amplitude) in enumerate(sizes(case)):
        column = inputs(case, 2j * math.pi * hertz)[i][:, np.newaxis]
        velocity, *both = (part * amplitude / math.sqrt(2.0) for part in responses(hertz, column))
        ratios, elastic = (np.sqrt(squares(case, each))[:, 0] / reference for each in both)
        found.append(Load(float(abs(velocity[0])), ratios, elastic))
    terrain = next((each.terrain for each in case.excitations if each.terrain), None)
    if terrain is not None:
        mounts, speed = vertical_mounts(model.mechanism), SPEEDS[Source.GROUND]
        front, lines = max(m.at[0] for m in mounts), np.geomspace(*terrain.band, LINES)
        parts = []
        for hertz in lines.tolist():
            s = 2j * math.pi * hertz
            late = [np.exp(-s * (front - mount.at[0]) / speed) for mount in mounts]
            wheels = inputs(case, s)[-len(mounts) :]
            total = sum(wheel * delay for wheel, delay in zip(wheels, late, strict=True))
            velocity, *both = responses(hertz, np.asarray(total)[:, np.newaxis])
            parts.append([np.abs(velocity[:1]) ** 2, *(squares(case, x)[:, 0] for x in both)])
        height = terrain.roughness * (lines / speed / terrain.reference) ** -2.0 / speed
        density = [np.array(part) * height[:, np.newaxis] for part in zip(*parts, strict=True)]
        velocity2, *both2 = (trapezoid(part, lines, axis=0) for part in density)
        ratios, elastic = (np.sqrt(each) / reference for each in both2)
        worst = int(ratios.argmax())
        spread = standard_error(density[1][:, worst], lines, ROLLING)
        found.append(Load(math.sqrt(float(velocity2[0])), ratios, elastic, spread))
    ratios, elastic = (
        np.sqrt(sum(getattr(each, name) ** 2 for each in found)) for name in ("ratios", "elastic")
    )
    velocity = math.sqrt(sum(each.velocity**2 for each in found))
    return [*found, Load(velocity, ratios, elastic, found[-1].error)]


def integrated(case: Case, seed: int) -> Load:
    """Integrate the motion by all excitations with Newmark's rule; return the total load."""
    model = LinkageModel(coarser(case.model.mechanism, ELEMENTS, 10**6), reduced=False)
    own = replace(case, model=model)
    system, configuration = model.system, model.kinematics.at(case.alpha3)
    joining = model.interface.join(configuration)
    b, stretch = widened(model, joining.compatibility), widened(model, joining.elongation)
    laws = (joining.stiffness, joining.damping)
    springs = [stretch.T @ (law[:, np.newaxis] * stretch) for law in laws]
    k, c, m = system.stiffness + springs[0], system.damping + springs[1], system.mass
    basis = null_space(b)
    by_pulls, shares = places_of(model, case.alpha3)
    # B^T pulls = f - (K u + C v + M a), on forces; springs by their stretch.
    cut = by_pulls @ np.linalg.pinv(b.T)
    stretched = [shares @ (law[:, np.newaxis] * stretch) for law in laws]
    out = [(extra - cut @ each) @ basis for each, extra in zip((k, c), stretched, strict=True)]
    out.append(-cut @ m @ basis)
    moved = (widened(model, model.rows([_point(model)], configuration)) @ basis)[0]
    terrain = next((each.terrain for each in case.excitations if each.terrain), None)
    count = round((WARM_UP + (ROLLING if terrain else ALONE)) / STEP)
    times, n_orders = STEP * np.arange(count), len(sizes(case))
    columns, slopes = (np.array(inputs(own, s)) for s in (0.0, 1j))
    slopes = slopes.imag if np.iscomplexobj(slopes) else 0.0 * columns
    values, rates = np.zeros((2, count, len(columns)))
    for i, (hertz, amplitude) in enumerate(sizes(case)):
        w = 2.0 * math.pi * hertz
        values[:, i], rates[:, i] = amplitude * np.sin(w * times), amplitude * w * np.cos(w * times)
    if terrain is not None:
        mounts, speed = vertical_mounts(model.mechanism), SPEEDS[Source.GROUND]
        rng = np.random.default_rng(seed)
        height, rate = random_heights(terrain, speed, count, STEP, rng)
        for j, mount in enumerate(mounts):
            late = round((max(x.at[0] for x in mounts) - mount.at[0]) / speed / STEP)
            values[:, n_orders + j], rates[:, n_orders + j] = (
                np.roll(height, late),
                np.roll(rate, late),
            )
    loads = values @ columns.real + rates @ slopes
    into = loads @ basis
    mass, damping, stiffness = (basis.T @ each @ basis for each in (m, c, k))
    inverse = np.linalg.inv(mass + 0.5 * STEP * damping + 0.25 * STEP**2 * stiffness)
    pushed, from_q, from_v = into @ inverse.T, inverse @ stiffness, inverse @ damping
    forces, velocity = np.empty((count, len(cut))), np.empty(count)
    q, v, a = np.zeros((3, basis.shape[1]))
    for i in range(count):
        q, v = q + STEP * v + 0.25 * STEP**2 * a, v + 0.5 * STEP * a
        a = pushed[i] - from_q @ q - from_v @ v
        q, v = q + 0.25 * STEP**2 * a, v + 0.5 * STEP * a
        forces[i] = out[0] @ q + out[1] @ v + out[2] @ a
        velocity[i] = moved @ v
    kept = slice(round(WARM_UP / STEP), None)
    forces += loads @ cut.T
    mean = squares(own, forces[kept].T).mean(axis=1)
    speed = math.sqrt(float(np.mean(velocity[kept] ** 2)))
    return Load(speed, np.sqrt(mean) / references(case), np.zeros(0))


def _point(model: LinkageModel) -> tuple[str, str]:
    return model.mechanism.response.point, model.mechanism.response.direction


def draw(names: list[str], worst: Array) -> None:
    """Draw ratios to bodies cut free, (n_cases, 3), with the error of the second in the fourth."""
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    axes, rows = figure.subplots(), np.arange(len(names), 0, -1)
    labels = ("elastic parts alone, at worst", "integration over time", "package")
    for i, (label, marker, column) in enumerate(zip(labels, "Dso", (2, 1, 0), strict=True)):
        at = rows + 0.18 * (i - 1)
        axes.plot(worst[:, column], at, marker, color=COLOURS[i], label=label, markersize=6)
    axes.errorbar(worst[:, 1], rows, xerr=worst[:, 3], fmt="none", color=COLOURS[1], linewidth=1.0)
    axes.axvline(1.0, color=INK, linewidth=1.0)
    axes.set_yticks(rows, names)
    axes.set(xlabel="load ratio / that of bodies cut free")
    axes.set_title("Loads of ten linkages", loc="left", color=INK)
    axes.grid(axis="x", color=GREY, linewidth=0.3)
    axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(PICTURE, dpi=120)


def main() -> None:
    """Compare the loads of ten linkages, and publish the page with its picture."""
    rows, names, worst, off = list[list[str]](), list[str](), list[list[float]](), list[float]()
    for seed, case in enumerate(cases()):
        (ours, published), exact = by_package(case), cut_free(case)
        simulated, total = integrated(case, seed), exact[-1]
        heads = [*(each.name for each in case.excitations), "together"]
        lines = [f"{hertz:.3g}" for hertz, _ in sizes(case)]
        lines += [""] * (len(heads) - len(lines))
        places = [n for n in case.model.force_places if not n.startswith("base:")]
        off.append(published / float(total.ratios.max()) - 1.0)
        farthest = 0.0
        for head, hertz, a, b in zip(heads, lines, ours, exact, strict=True):
            counts = b.ratios > LEAST * b.ratios.max()
            errors = np.where(counts, a.ratios / b.ratios - 1.0, 0.0)
            old = np.where(counts, np.log(b.elastic / b.ratios), 0.0)
            top, far = int(b.ratios.argmax()), int(np.abs(old).argmax())
            error = float(errors[np.abs(errors).argmax()])
            off += [error, a.velocity / b.velocity - 1.0]
            farthest = max(farthest, float(old[far]), key=abs)
            numbers = f"{a.ratios[top]:.4f}", f"{b.ratios[top]:.4f}", f"{error:.1e}"
            elastic = f"{math.exp(old[far]):.3f} in {places[far]}"
            degrees = f"{math.degrees(case.alpha3):.0f}"
            rows.append([case.name, degrees, head, hertz, places[top], *numbers, elastic])
        at = int(total.ratios.argmax())
        by_time = float(simulated.ratios[at] / total.ratios[at])
        rows[-1].append(f"{by_time:.4f}" + (f" +- {total.error:.3f}" if total.error else ""))
        ratio = float(ours[-1].ratios[at] / total.ratios[at])
        worst.append([ratio, by_time, math.exp(farthest), total.error])
        names.append(case.name.replace("_", " "))
        print(rows[-1], flush=True)
    draw(names, np.array(worst))
    publish(
        "loads",
        "Loads of ten linkages",
        [
            "This page compares load ratios with those of unreduced bodies that are cut free: five "
            "shipped linkages, and five that are drawn, with a coil-over between two points and a "
            "mass at a pin. They are loaded by a shaft of 540 rpm and, on a tractor, by an axle "
            "out of round and by the ground (class B) at 12 km/h.",
            IN_PLANE,
            "The references do not use modes, tables or rows of forces: `test/support/"
            "free_bodies.py` solves line by line for the forces of the pins (Lagrange "
            f"multipliers), and Newmark's rule integrates them over {ALONE:g} s, or {ROLLING:g} s "
            "with the ground, with the standard error of such a time. Package and cut free are the "
            "largest load ratios, and the difference is the largest of all places. Elastic is the "
            "ratio that displacements alone would give, without the force of a damper and without "
            "inertia beside a pin, to that of bodies cut free, where it is farthest from 1. Places "
            f"with less than {LEAST:g} of the largest load ratio are left out. The last column is "
            "the integration over bodies cut free, for all loads together.",
            "The largest difference of the package, of load ratios and velocities, is "
            f"{np.abs(off).max():.1e}.",
            table([*COLUMNS, "integrated"], [[*row, *[""] * (10 - len(row))] for row in rows]),
            "![Ratios of loads](loads.png)",
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
