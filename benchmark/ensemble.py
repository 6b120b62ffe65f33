# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares how uncertain levels are with whole models whose numbers are drawn."""

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.integrate import trapezoid
from scipy.special import k1
from tqdm import tqdm

from benchmark.report import machine, publish, table
from benchmark.uncertainty import LOADER, described, draws
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Mount, Uncertainty
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.paths import split_paths, with_numbers
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.prediction.ensemble import load_factors as member_factors
from linkage_vibration.prediction.excitation import Excitation, Source, excitations_from_mapping
from linkage_vibration.prediction.ground import Terrain, vertical_mounts
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.loads import load_input
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import Table, table_bytes
from linkage_vibration.table.tabulation import build_table
from test.support.in_plane import IN_PLANE
from test.support.level_factors import level_factors

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SAMPLES, PARTS = 1000, 20
SPEEDS = {
    Source.ENGINE: np.linspace(850.0, 2200.0, 10),
    Source.PTO: np.linspace(300.0, 1000.0, 10),
    Source.GROUND: np.linspace(1.0, 14.0, 10),
}
SHARES = 0.07, 0.37, 0.81  # of the stroke
QUANTILES = 0.0, 0.05, 0.5, 0.95, 1.0
NEAR, WORST = 0.15, 4  # what is asked of ratios, and how many of the worst are listed
LIMITS = 0.1, 0.3, 0.5, 0.7, 0.9  # probabilities of limits, among the samples
BARE = """
pto_shaft: {speed: pto, orders: [1, 2], force: [42.0, 20.0], at: E1.z, at_speed: 1000.0,
            exponent: 2}
cardan_joint: {speed: pto, orders: [2], moment: [64.0], at: implement, at_speed: 1000.0}
rotor: {speed: pto, ratio: 0.45, orders: [1, 2], force: [83.0, 200.0], at: E1.x, at_speed: 1000.0}
engine: {speed: engine, orders: [1, 3, 6], force: [50.0, 30.0, 10.0], at: E2.x, at_speed: 2000.0}
"""
LOADED = """
engine: {speed: engine, orders: [0.5, 1.5, 3], moment: [2.7, 3.3, 190.0], at: base,
         at_speed: 2000.0, amplitude_stddev: 0.2}
crankshaft: {speed: engine, orders: [1], force: [340.0], at: front_axle.z, at_speed: 2200.0,
             exponent: 2, amplitude_stddev: 0.2}
bucket: {speed: pto, orders: [1, 2], force: [42.0, 20.0], at: C.z, at_speed: 1000.0, exponent: 2}
tyre_lugs: {speed: ground, rolling_radius: 0.8, orders: [1, 5], base_displacement: [1.4e-3, 0.1e-3],
            at: base:rear_axle.z, at_speed: 5.0, frequency_stddev: 0.02}
ground: {speed: ground, terrain: {class: C}, raised: true, lugs: 20, rolling_radius: 0.8}
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


def model_squares(
    model: LinkageModel, scene: Scene, built: Table, amplitudes: FloatArray, frequencies: FloatArray
) -> FloatArray:
    """Return squares of velocities, then of load ratios of each pin, (1 + n_pins, m, n).

    They come from all modes of the model; the table only names places. The factors of amplitudes
    and frequencies are (m,). Without a speed or beyond the band of the table they are NaN.
    """
    response, m = model.mechanism.response, len(scene.excitations)
    loads = [load_input(each.load, each.name, built, model.mechanism) for each in scene.excitations]
    mounts = vertical_mounts(model.mechanism)
    inputs = list(dict.fromkeys(place for load in loads for place in load.places))
    # Tyres, which are behind pins and cylinders, have a limit of their own, and no load ratio.
    forces = [place for place in model.forces.places if place[0] in built.load_places]
    outputs = [(response.point, response.direction), *forces]
    names = [name for name, _ in forces]
    first = [names.index(name) for name in dict.fromkeys(names)]
    squares = np.full((1 + len(first), m, len(scene.alpha3)), math.nan)
    for angle in np.unique(scene.alpha3).tolist():
        columns = np.flatnonzero(scene.alpha3 == angle)
        solution = model.solve(angle)
        frf = solution.frf(outputs, inputs)
        references = model.reference_forces(angle)[: len(first), np.newaxis]
        for i, (each, unit) in enumerate(zip(scene.excitations, loads, strict=True)):
            speed = scene.speeds[list(Source).index(each.source), columns]
            if each.terrain is not None:
                receptance = solution.frf(outputs, [(mount.name, "z") for mount in mounts])
                sizes = ground_squares(receptance, each.terrain, mounts, speed)
                sizes *= amplitudes[i] ** 2
            else:
                load = each.load
                assert load is not None
                lines = each.ratio * speed * frequencies[i]
                s = 2j * math.pi * lines
                w, v = unit.weights(angle)
                force = w + s[:, np.newaxis, np.newaxis] * v
                size = load.amplitude / math.sqrt(2.0) * amplitudes[i]
                size = size * (speed / load.speed) ** load.exponent
                size = np.where(each.ratio * speed <= scene.band, size, math.nan)
                at = [inputs.index(place) for place in unit.places]
                responses = frf.frf(np.nan_to_num(lines))[:, :, at]  # the size is NaN then
                sizes = np.abs((responses * force).sum(axis=2).T * size) ** 2
                sizes[0] *= np.abs(s) ** 2
            squares[0, i, columns] = sizes[0]
            squares[1:, i, columns] = np.add.reduceat(sizes[1:], first) / references**2
    return squares


def ground_squares(
    frf: PoleResidue, terrain: Terrain, mounts: Sequence[Mount], speeds: FloatArray
) -> FloatArray:
    """Return mean squares by the ground at speeds, of the velocity, then of forces, (n_out, n).

    They are integrals over 256 frequencies of the response to the mean of two tracks, which arrives
    later at mounts behind, times its density on an isotropic plane, by ISO 8608. Only wavelengths
    above two lugs count, because a tyre does not follow shorter ones.
    """
    f = np.geomspace(*terrain.band, 256)
    s, step = 2j * math.pi * f, math.log(f[1] / f[0])
    transfer = frf.frf(f).transpose(1, 2, 0)
    transfer *= np.array([mount.stiffness[1] + s * mount.damping[1] for mount in mounts])
    transfer[0] *= s
    behind = np.array([mount.at[0] for mount in mounts])
    behind = behind.max() - behind
    shortest = 0.0 if terrain.lug_pitch is None else 2.0 * terrain.lug_pitch
    [track] = {mount.track for mount in mounts}
    values = np.full((len(transfer), len(speeds)), math.nan)
    for speed in np.unique(speeds).tolist():
        delayed = np.exp(-s * behind[:, np.newaxis] / speed)
        density = terrain.roughness * (f / speed / terrain.reference) ** -terrain.exponent / speed
        x = 2.0 * math.pi * track * f / speed
        density *= 0.5 + 0.5 * np.where(x > 0.0, x * k1(np.maximum(x, 1e-9)), 1.0)
        density *= np.clip(0.5 - np.log(f * max(shortest, 1e-9) / speed) / step, 0.0, 1.0)
        power = np.abs((transfer * delayed).sum(axis=1)) ** 2
        mean = trapezoid(power * density * f, dx=step)
        values[:, speeds == speed] = mean[:, np.newaxis]
    return values


def models(
    scene: Scene, count: int, seed: int
) -> Iterator[tuple[LinkageModel, FloatArray, FloatArray] | None]:
    """Yield whole models with other numbers, and factors of amplitudes and frequencies, (m,).

    One that is not possible, such as a cylinder that is too short, is None.
    """
    mechanism = mechanism_of(scene.mapping, Path("description"))
    assert mechanism.uncertainty is not None
    relative, m = set(scene.mapping["uncertainty"].get("relative", {})), len(scene.excitations)
    numbers = draws(mechanism.uncertainty, relative, count, seed)
    normal = np.random.default_rng(seed + 1000).standard_normal((2, count, m))
    spread = [
        getattr(each.load or each.terrain, "relative_stddev", 0.0) for each in scene.excitations
    ]
    amplitudes = np.exp(spread * normal[0])
    frequencies = 1.0 + normal[1] * [each.relative_stddev for each in scene.excitations]
    for values, *factors in zip(numbers, amplitudes, frequencies, strict=True):
        model = with_values(scene, mechanism.uncertainty, values)
        yield None if model is None else (model, factors[0], factors[1])


def with_values(scene: Scene, uncertainty: Uncertainty, values: FloatArray) -> LinkageModel | None:
    """Return the model with other values of its uncertain numbers; None if it is not possible."""
    exact = {key: value for key, value in scene.mapping.items() if key != "uncertainty"}
    pairs = zip(uncertainty.numbers, values.tolist(), strict=True)
    changed = [(path, value) for number, value in pairs for path in split_paths(number.path)]
    try:
        return LinkageModel(mechanism_of(with_numbers(exact, changed), Path("sample")))
    except LinkageVibrationError:
        return None


def levels_of(
    given: Iterable[tuple[LinkageModel, FloatArray, FloatArray] | None],
    scene: Scene,
    built: Table,
    refused: BoolArray,
) -> FloatArray:
    """Return the levels of models, (count, 2, m + 1, n); NaN if one is not possible.

    They are velocities, then load ratios, of each excitation and of all. Where the table refuses
    the level of the ground, (n,), they are without it.
    """
    rows = []
    for item in given:
        row = np.full((2, len(scene.excitations) + 1, len(scene.alpha3)), math.nan)
        rows.append(row)
        if item is None:
            continue
        try:
            squares = model_squares(item[0], scene, built, *item[1:])
        except LinkageVibrationError:
            continue
        for i, each in enumerate(scene.excitations):
            squares[:, i, refused & (each.terrain is not None)] = math.nan
        squares = np.concatenate([squares, np.nansum(squares, axis=1, keepdims=True)], axis=1)
        row[:] = np.sqrt([squares[0], squares[1:].max(axis=0)])
    return np.array(rows)


def sampled(scene: Scene, built: Table, refused: BoolArray, count: int, seed: int) -> FloatArray:
    """Return the levels of whole models with other numbers, as `levels_of` does."""
    return levels_of(models(scene, count, seed), scene, built, refused)


def members(scene: Scene, built: Table, refused: BoolArray) -> FloatArray:
    """Return the levels of the members of an ensemble, each solved as a whole at every angle."""
    uncertainty = mechanism_of(scene.mapping, Path("description")).uncertainty
    assert uncertainty is not None
    numbers = uncertainty.draw(built.ensemble_coordinates.astype(float))
    amplitudes, frequencies = member_factors(scene.excitations, built.ensemble_coordinates)
    result = (with_values(scene, uncertainty, row) for row in numbers)
    given = [
        None if model is None else (model, amplitudes[:, k], frequencies[:, k])
        for k, model in enumerate(result)
    ]
    return levels_of(given, scene, built, refused)


@dataclass(frozen=True)
class Comparison:
    """How uncertain levels are, by whole models, by the table, and by its members in full.

    Levels are velocities, then load ratios, (2, m + 1, n), of each excitation and of all.
    """

    deviations: FloatArray  # standard deviations of ln(level) of the models; NaN without a level
    errors: FloatArray  # standard errors of these, as a share
    stated: FloatArray  # by the table, over them
    solved: FloatArray  # by its members, if each is solved at these angles, over them
    probabilities: FloatArray  # stated minus true ones


def compare(scene: Scene, levels: LevelTable, true: FloatArray, solved: FloatArray) -> Comparison:
    """Compare the levels of whole models, and of members solved as a whole, with a table's."""
    result = level_factors(levels, scene.alpha3, scene.speeds, 1.0)
    stated = [
        np.vstack([result[f"{each}_factors"].T, result[f"total_{each}_factor"]])
        for each in ("velocity", "load_ratio")
    ]
    with np.errstate(all="ignore"):
        logs = np.log(true)
        deviations = np.nanstd(logs, axis=0)
        deviations = np.where(deviations > 0.0, deviations, math.nan)
        kurtosis = np.nanmean((logs - np.nanmean(logs, axis=0)) ** 4, axis=0) / deviations**4
        errors = np.sqrt((kurtosis - 1.0) / np.isfinite(logs).sum(axis=0)) / 2.0
        known = np.log(np.array(stated, float)) / deviations
        own = np.nanstd(np.log(solved), axis=0) / deviations
    off = []
    for share in LIMITS:
        limits = np.nanquantile(true[:, 1, -1], 1.0 - share, axis=0)
        for i, limit in enumerate(limits.tolist()):
            at = scene.alpha3[[i]], scene.speeds[:, [i]]
            off.append(float(level_factors(levels, *at, limit)["warning_probability"][0]) - share)
    return Comparison(deviations, errors, known, own, np.array(off))


def compared(name: str, scene: Scene) -> tuple[list[str], list[str], list[list[str]]]:
    """Return the rows of the tables of the page for a scene."""
    mechanism = mechanism_of(scene.mapping, Path("description"))
    begin = time.process_time()
    built = build_table(LinkageModel(mechanism))
    seconds = time.process_time() - begin
    exact = {key: value for key, value in scene.mapping.items() if key != "uncertainty"}
    begin = time.process_time()
    plain = build_table(LinkageModel(mechanism_of(exact, Path("description"))))
    without = time.process_time() - begin
    grown = len(table_bytes(built)) - len(table_bytes(plain))
    levels = LevelTable(Predictor(built), mechanism, scene.excitations)
    refused = levels.at(scene.alpha3, scene.speeds).ground_unknown != ""
    count = SAMPLES // PARTS
    with ProcessPoolExecutor() as pool, tqdm(desc=name, total=SAMPLES) as bar:
        parts = [(scene, built, refused, count, seed) for seed in range(PARTS)]
        waiting = [pool.submit(sampled, *part) for part in parts]
        for _ in as_completed(waiting):
            bar.update(count)
        true = np.concatenate([each.result() for each in waiting])
    comparison = compare(scene, levels, true, members(scene, built, refused))
    begin = time.process_time()
    level_factors(levels, scene.alpha3, scene.speeds, 1.0)
    lookup = (time.process_time() - begin) / len(scene.alpha3)
    known = np.isfinite(comparison.deviations)

    def quantiles(values: FloatArray) -> str:
        return ", ".join(f"{x:.2f}" for x in np.nanquantile(values, QUANTILES))

    def outside(ratio: FloatArray) -> str:
        return f"{(np.abs(ratio[known] - 1.0) > NEAR).sum()}"

    share = np.isfinite(comparison.stated[known]).mean()
    first = [name, str(len(mechanism.uncertainty.numbers) if mechanism.uncertainty else 0)]
    first += [
        f"{100.0 * share:.0f} % of {known.sum()}",
        f"{np.nanmedian(comparison.deviations):.2f}",
    ]
    first += [quantiles(comparison.stated[i, :-1]) for i in (0, 1)] + [
        quantiles(comparison.stated[:, -1])
    ]
    first += [outside(comparison.stated), outside(comparison.solved)]
    off = comparison.probabilities
    first += [f"{np.sqrt(np.nanmean(off**2)):.3f}, {np.nanmax(np.abs(off)):.2f}"]
    second = [name, str(len(built.ensemble_alpha3)), f"{without:.1f}", f"{seconds:.1f}"]
    second += [f"{grown / 1e6:.2f}", f"{1e3 * lookup:.2f}"]
    return first, second, worst(name, scene, comparison)


def worst(name: str, scene: Scene, result: Comparison) -> list[list[str]]:
    """Return the levels with the largest errors, the largest first."""
    size = np.nan_to_num(np.abs(np.log(result.stated)))
    rows = []
    for place in np.argsort(-size, axis=None, kind="stable")[:WORST].tolist():
        what, i, k = np.unravel_index(place, size.shape)
        speeds = scene.speeds[:, k]
        where = f"all, engine {speeds[list(Source).index(Source.ENGINE)]:.0f} rpm"
        if i < len(scene.excitations):
            first = scene.excitations[i]
            speed = speeds[list(Source).index(first.source)]
            where = f"{first.name}, {first.ratio * speed:.1f} Hz"
            if first.terrain is not None:
                where = f"{first.name}, {speed:.1f} m/s"
        row = [name, ("velocity", "load ratio")[what], where]
        row += [f"{math.degrees(scene.alpha3[k]):.0f}", f"{result.deviations[what, i, k]:.2f}"]
        ratios = result.stated, result.solved
        rows.append([*row, *(f"{each[what, i, k]:.2f}" for each in ratios)])
        rows[-1].append(f"{result.errors[what, i, k]:.2f}")
    return rows


def main() -> None:
    """Compare all scenes, and publish the page."""
    rows = [compared(name, each) for name, each in scenes().items()]
    limits = f"{1.0 - NEAR:.2f} to {1.0 + NEAR:.2f}"
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
            "2 to 4 % themselves, and more where few of them decide. `outside` counts levels whose "
            f"number is not {limits}; `solved`, those of the same members without a table, each of "
            "which is described and solved at these angles. The last column compares "
            "`warning_probability` with the share of the models at limits that 10, 30, 50, 70 and "
            "90 % of them exceed: root mean square of the difference, and the largest. The "
            "excitations are in `config/excitations.yaml`, or others in `benchmark/ensemble.py`.",
            IN_PLANE,
            table(
                [
                    "description",
                    "numbers",
                    "known levels",
                    "sd of ln level",
                    "velocities",
                    "load ratios",
                    "totals",
                    "outside",
                    "solved",
                    "probability",
                ],
                [first for first, _, _ in rows],
            ),
            "The levels that are furthest off: their angle (deg), the standard deviation of their "
            "logarithm by the models, that of the table over it, that of the same members without "
            "a table over it, and the standard error of the models' own, as a share. Where members "
            "without a table are as far off, no table would help: they are too few for this level.",
            table(
                ["description", "level", "excitation", "angle", "sd", "table", "solved", "error"],
                [row for _, _, each in rows for row in each],
            ),
            "The cost on one core: to build the table without and with `uncertainty` (s of CPU "
            "time), by how much its file grows (MB), and to evaluate all factors once (ms), which "
            "happens five times a second.",
            table(
                ["description", "angles", "without", "with", "larger by", "evaluation"],
                [second for _, second, _ in rows],
            ),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
