# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares how uncertain levels are with whole models whose numbers are drawn."""

import math
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmark.report import machine, publish, table
from benchmark.uncertainty import coarse, described, draws
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.paths import split_paths, with_numbers
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.loads import load_input
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table, table_bytes
from linkage_vibration.table.tabulation import build_table

FloatArray = NDArray[np.float64]

SAMPLES, PARTS = 1000, 4
SPEEDS = {
    Source.ENGINE: np.linspace(850.0, 2200.0, 10),
    Source.PTO: np.linspace(300.0, 1000.0, 10),
    Source.GROUND: np.linspace(1.0, 14.0, 10),
}
SHARES = 0.07, 0.37, 0.81  # of the stroke
QUANTILES = 0.0, 0.05, 0.5, 0.95, 1.0
LIMITS = 0.1, 0.3, 0.5, 0.7, 0.9  # probabilities of limits, among the samples
BARE = """
pto_shaft: {speed: pto, orders: [1, 2], force: [42.0, 20.0], at: E1.z, at_speed: 1000.0,
            exponent: 2}
cardan_joint: {speed: pto, orders: [2], moment: [64.0], at: implement, at_speed: 1000.0}
rotor: {speed: pto, ratio: 0.45, orders: [1, 2], force: [83.0, 200.0], at: E1.x, at_speed: 1000.0}
engine: {speed: engine, orders: [1, 3, 6], force: [50.0, 30.0, 10.0], at: E2.x, at_speed: 2000.0}
"""
LOADER = """
name: front_loader            # a bucket on a boom and a tilt link, on a tractor; all ASSUMED
ground: {A: [0.0, 0.0], B: [0.05, 0.32]}
base:
  mass: 4500.0
  inertia: 6000.0
  centre_of_gravity: [-1.2, -0.6]
  mounts:
    rear_axle: {at: [-2.2, -0.75], stiffness: [700.0e+3, 700.0e+3], damping: [4460.0, 4460.0]}
    front_axle: {at: [0.3, -0.75], stiffness: [600.0e+3, 600.0e+3], damping: [3820.0, 3820.0]}
links:
  boom:
    points: {A: 0.0, L: 1.1, C: 2.2}
    count: 2
    section: {shape: rectangle, width: 0.08, height: 0.14}
    material: &steel {youngs_modulus: 210.0e+9, density: 7800.0, poisson_ratio: 0.3}
    elements: 24
  tilt_link:
    points: {B: 0.0, D: 2.15}
    section: {shape: tube, outer_diameter: 0.07, inner_diameter: 0.05}
    material: *steel
    elements: 24
rigid_bodies:
  bucket: {points: {C: [0.0, 0.0], D: [0.0, 0.35]}, centre_of_gravity: [0.4, 0.1], mass: 500.0,
           inertia: 60.0}
springs:
  lift_cylinders:
    joint: A
    cylinder: {base_end: [0.1, -0.6], rod_end: [1.1, -0.05], count: 2, bore: 0.08, rod: 0.045,
               stroke: 0.9, closed_length: 0.75, hose_volume: 0.5e-3, bulk_modulus: 1.2e+9}
input: {link: boom, range_deg: [-20.0, 40.0]}
assembly: {alpha3_deg: 0.0, angles_deg: {tilt_link: 0.0, bucket: 0.0}}
damping: {ratio: 0.02, at_hz: [2.0, 100.0]}
response: {drive_point: C, direction: z, band_hz: [0.0, 120.0], modes: 6}
uncertainty:
  relative:
    links.boom.section.width: 0.05
    links.boom.section.height: 0.05
    links.tilt_link.section.outer_diameter: 0.05
    rigid_bodies.bucket.mass: 0.2
    rigid_bodies.bucket.inertia: 0.2
    base.mass: 0.1
    base.inertia: 0.2
    base.mounts.rear_axle.stiffness.0, base.mounts.rear_axle.stiffness.1: 0.2
    base.mounts.front_axle.stiffness.0, base.mounts.front_axle.stiffness.1: 0.2
    base.mounts.rear_axle.damping.0, base.mounts.rear_axle.damping.1: 0.3
    base.mounts.front_axle.damping.0, base.mounts.front_axle.damping.1: 0.3
    springs.lift_cylinders.cylinder.bulk_modulus: 0.2
    damping.ratio: 0.3
  absolute: {rigid_bodies.bucket.centre_of_gravity.0: 0.05, base.centre_of_gravity.0: 0.05,
             ground.B.1: 0.005}
"""
LOADED = """
engine: {speed: engine, orders: [0.5, 1.5, 3], moment: [2.7, 3.3, 190.0], at: base,
         at_speed: 2000.0, amplitude_stddev: 0.2}
crankshaft: {speed: engine, orders: [1], force: [340.0], at: front_axle.z, at_speed: 2200.0,
             exponent: 2, amplitude_stddev: 0.2}
bucket: {speed: pto, orders: [1, 2], force: [42.0, 20.0], at: C.z, at_speed: 1000.0, exponent: 2}
tyre_lugs: {speed: ground, rolling_radius: 0.8, orders: [1, 5], base_displacement: [1.4e-3, 0.1e-3],
            at: base:rear_axle.z, at_speed: 5.0, frequency_stddev: 0.02}
"""


@dataclass(frozen=True)
class Scene:
    """A mechanism and its excitations, and the levels that are compared: angles by speeds."""

    mapping: dict[str, Any]
    excitations: tuple[Excitation, ...]
    alpha3: FloatArray  # (n,), rad
    speeds: FloatArray  # (n_sources, n)
    band: float  # Hz, its end


def scene(mapping: dict[str, Any], orders: Any) -> Scene:
    """Return what is compared of a description with its ``uncertainty``, and of excitations."""
    low, high = (math.radians(x) for x in mapping["input"]["range_deg"])
    angles = low + (high - low) * np.array(SHARES)
    speeds = np.array([SPEEDS[source] for source in Source])
    excitations, band = excitations_from_mapping(orders), mapping["response"]["band_hz"][1]
    rows = angles.repeat(speeds.shape[1]), np.tile(speeds, len(angles))
    return Scene(mapping, excitations, *rows, band)


def scenes() -> dict[str, Scene]:
    """Return the tractor with uncertain and exact amplitudes, a loader, the paper's linkages."""
    orders, bare = load_yaml(config_file("excitations.yaml"))[0], yaml.safe_load(BARE)
    exact = {name: {**keys, "amplitude_stddev": 0.0} for name, keys in orders.items()}
    tractor = described("three_point_linkage_on_tractor.yaml")
    return {
        "tractor": scene(tractor, orders),
        "tractor, exact amplitudes": scene(tractor, exact),
        "loader": scene(yaml.safe_load(LOADER), yaml.safe_load(LOADED)),
        "three_point_linkage": scene(described("three_point_linkage.yaml"), bare),
        "three_point_linkage_as_printed": scene(
            described("three_point_linkage_as_printed.yaml"), bare
        ),
    }


def model_levels(
    model: LinkageModel, scene: Scene, built: Table, amplitudes: FloatArray, frequencies: FloatArray
) -> FloatArray:
    """Return velocities, then load ratios, of each excitation and of all, (2, m + 1, n).

    They come from all modes of the model; the table only names places. The factors of amplitudes
    and frequencies are (m,).
    """
    response, m = model.mechanism.response, len(scene.excitations)
    loads = [load_input(one, built, model.mechanism) for one in scene.excitations]
    inputs = list(dict.fromkeys(place for load in loads for place in load.places))
    outputs = [(response.point, response.direction), *model.forces.places]
    names = [name for name, _ in model.forces.places]
    first = [names.index(name) for name in dict.fromkeys(names)]
    levels = np.full((2, m + 1, len(scene.alpha3)), math.nan)
    for angle in np.unique(scene.alpha3).tolist():
        columns = np.flatnonzero(scene.alpha3 == angle)
        frf = model.solve(angle).frf(outputs, inputs)
        reference = model.reference_forces(angle)[:, np.newaxis]
        squares = np.zeros((1 + len(first), m, len(columns)))
        for i, (one, unit) in enumerate(zip(scene.excitations, loads, strict=True)):
            load = one.load
            assert load is not None
            speed = scene.speeds[list(Source).index(one.source), columns]
            lines = one.ratio * speed * frequencies[i]
            s = 2j * math.pi * lines
            w, v = unit.weights(angle)
            at = [inputs.index(place) for place in unit.places]
            force = w + s[:, np.newaxis, np.newaxis] * v
            size = load.amplitude / math.sqrt(2.0) * amplitudes[i]
            size = size * (speed / load.speed) ** load.exponent
            size = np.where(one.ratio * speed <= scene.band, size, math.nan)
            found = (frf.frf(lines)[:, :, at] * force).sum(axis=2).T * size
            squares[0, i] = np.abs(found[0] * s) ** 2
            squares[1:, i] = np.add.reduceat(np.abs(found[1:]) ** 2, first) / reference**2
        totals = np.nansum(squares, axis=1)
        levels[:, :m, columns] = np.sqrt([squares[0], squares[1:].max(axis=0)])
        levels[:, m, columns] = np.sqrt([totals[0], totals[1:].max(axis=0)])
    return levels


def sampled(scene: Scene, built: Table, count: int, seed: int) -> FloatArray:
    """Return the levels of whole models with other numbers, (count, 2, m + 1, n)."""
    mechanism = mechanism_of(scene.mapping, Path("description"))
    assert mechanism.uncertainty is not None
    exact = {key: value for key, value in scene.mapping.items() if key != "uncertainty"}
    relative, m = set(scene.mapping["uncertainty"].get("relative", {})), len(scene.excitations)
    numbers = draws(mechanism.uncertainty, relative, count, seed)
    normal = np.random.default_rng(seed + 1000).standard_normal((2, count, m))
    spread = [one.load.relative_stddev if one.load else 0.0 for one in scene.excitations]
    amplitudes = np.exp(spread * normal[0])
    frequencies = 1.0 + normal[1] * [one.relative_stddev for one in scene.excitations]
    found = np.full((count, 2, m + 1, len(scene.alpha3)), math.nan)
    for row, values, *own in zip(found, numbers, amplitudes, frequencies, strict=True):
        pairs = zip(mechanism.uncertainty.numbers, values.tolist(), strict=True)
        changed = [(path, value) for number, value in pairs for path in split_paths(number.path)]
        try:
            other = coarse(mechanism_of(with_numbers(exact, changed), Path("sample")))
            row[:] = model_levels(LinkageModel(other), scene, built, *own)
        except LinkageVibrationError:  # such as a cylinder that is too short
            continue
    return found


def compared(name: str, scene: Scene) -> tuple[list[str], list[str]]:
    """Return the rows of both tables of the page for a scene."""
    mechanism = mechanism_of(scene.mapping, Path("description"))
    model = LinkageModel(mechanism)
    begin = time.process_time()
    built = build_table(model)
    seconds = time.process_time() - begin
    exact = {key: value for key, value in scene.mapping.items() if key != "uncertainty"}
    begin = time.process_time()
    plain = build_table(LinkageModel(mechanism_of(exact, Path("description"))))
    without = time.process_time() - begin
    grown = len(table_bytes(built)) - len(table_bytes(plain))
    levels = LevelTable(Predictor(built), mechanism, scene.excitations)
    with ProcessPoolExecutor() as pool:
        count = SAMPLES // PARTS
        waiting = [pool.submit(sampled, scene, built, count, seed) for seed in range(PARTS)]
        true = np.concatenate([one.result() for one in waiting])
    begin = time.process_time()
    found = levels.factors(scene.alpha3, scene.speeds, 1.0)
    lookup = (time.process_time() - begin) / len(scene.alpha3)
    names = ("velocity", "load_ratio")
    stated = [
        np.vstack([found[f"{each}_factors"].T, found[f"total_{each}_factor"]]) for each in names
    ]
    with np.errstate(all="ignore"):
        deviations = np.nanstd(np.log(true), axis=0)
        ratio = np.log(np.array(stated, float)) / np.where(deviations > 0.0, deviations, math.nan)
    off = []
    for share in LIMITS:
        limits = np.nanquantile(true[:, 1, -1], 1.0 - share, axis=0)
        for i, limit in enumerate(limits.tolist()):
            at = scene.alpha3[[i]], scene.speeds[:, [i]]
            off.append(float(levels.factors(*at, limit)["warning_probability"][0]) - share)
    expected = np.isfinite(deviations) & (deviations > 0.0)
    known = np.isfinite(ratio)[expected].mean()

    def quantiles(values: FloatArray) -> str:
        return ", ".join(f"{x:.2f}" for x in np.nanquantile(values, QUANTILES))

    probabilities = np.array(off)
    first = [name, str(len(mechanism.uncertainty.numbers) if mechanism.uncertainty else 0)]
    first += [f"{100.0 * known:.0f} % of {expected.sum()}", f"{np.nanmedian(deviations):.2f}"]
    first += [quantiles(ratio[0, :-1]), quantiles(ratio[1, :-1]), quantiles(ratio[:, -1])]
    first += [
        f"{np.sqrt(np.nanmean(probabilities**2)):.3f}, {np.nanmax(np.abs(probabilities)):.2f}"
    ]
    nodes = str(len(built.ensemble_alpha3))
    second = [name, nodes, f"{without:.1f}", f"{seconds:.1f}", f"{grown / 1e6:.2f}"]
    return first, [*second, f"{1e3 * lookup:.2f}"]


def main() -> None:
    """Compare all scenes, and publish the page."""
    rows = [compared(name, each) for name, each in scenes().items()]
    publish(
        "ensemble",
        "How uncertain levels are",
        [
            "This page compares the factors of levels, exp of the standard deviation of their "
            f"logarithms, by the ensemble in a table with {SAMPLES} whole models, whose uncertain "
            "numbers are drawn at random, and which are described, closed, reduced and solved "
            "without a table. There are three angles and ten speeds for each excitation. Numbers "
            "are the reported standard deviation of the logarithm over the sampled one: least, "
            f"5 %, median, 95 % and largest of all levels; {SAMPLES} models leave an error of "
            "2 to 4 % themselves. The last column compares `warning_probability` with the share of "
            "the models at limits that 10, 30, 50, 70 and 90 % of them exceed: root mean square of "
            "the difference, and the largest. The excitations are in `config/excitations.yaml`, "
            "or others in `benchmark/ensemble.py`.",
            table(
                [
                    "description",
                    "numbers",
                    "known levels",
                    "sd of ln level",
                    "velocities",
                    "load ratios",
                    "totals",
                    "probability",
                ],
                [first for first, _ in rows],
            ),
            "The cost on one core: to build the table without and with `uncertainty` (s of CPU "
            "time), by how much its file grows (MB), and to evaluate all factors once (ms), which "
            "happens five times a second.",
            table(
                ["description", "angles", "without", "with", "larger by", "evaluation"],
                [second for _, second in rows],
            ),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
