# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares predicted standard deviations with a Monte Carlo of whole models."""

import copy
import math
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmark.report import machine, publish, table
from linkage_vibration.drawing.palette import COLOURS, GREY, mode_colours
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Cylinder, Mechanism, Uncertainty
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.paths import split_paths, with_numbers
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.readers.targets import Target
from linkage_vibration.studies.calibration import CalibrationTask, calibrate, write_mechanism
from linkage_vibration.studies.unknowns import log_changes
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.tabulation import build_table
from test.support.in_plane import IN_PLANE, in_plane

FloatArray = NDArray[np.float64]

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "uncertainty.png"
NAMES = (
    "three_point_linkage.yaml",
    "three_point_linkage_as_printed.yaml",
    "three_point_linkage_on_tractor.yaml",
    *(f"starters/category_{i}.yaml" for i in (1, 2, 3, 4)),
)
OWN = "front loader", "orchard sprayer", "heavy plough", "calibrated starter"
DRAWN = NAMES[:3]  # in the picture
SAMPLES = 1000
ANGLES = 5
COARSE = {"elements": 8, "modes": 4}  # of links in samples; the effect on deviations is below 1 %
LIMIT = 0.15  # of a standard deviation: the difference that is accepted
BEYOND = 0.1  # of the stroke of a cylinder, by which a sample may be beyond it
SPRAYER = {  # numbers of the starter of category 1 that differ
    "base.mass": 2600.0,
    "base.inertia": 2300.0,
    "base.centre_of_gravity.0": 0.95,
    "rigid_bodies.implement.mass": 700.0,
    "rigid_bodies.implement.inertia": 110.0,
    "rigid_bodies.implement.centre_of_gravity.0": 0.35,
    "links.lower_link.section.height": 0.06,
    "springs.lift_cylinders.cylinder.bulk_modulus": 0.9e9,
    "damping.ratio": 0.03,
}
PLOUGH = {  # numbers of the starter of category 4 that differ
    "base.mass": 14500.0,
    "base.inertia": 42000.0,
    "rigid_bodies.implement.mass": 3200.0,
    "rigid_bodies.implement.inertia": 2600.0,
    "rigid_bodies.implement.centre_of_gravity.1": 1.5,
    "links.lower_link.section.height": 0.11,
    "links.lift_rod.section.diameter": 0.05,
    "springs.lift_cylinders.cylinder.bulk_modulus": 1.0e9,
}
MEASURED = Target(1, math.radians(140.0), 1.35, 0.001 / 1.35)  # of the starter of category 3
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


@dataclass(frozen=True)
class Scatter:
    """Modes of samples at some angles; NaN where a sample does not close.

    The last axes of the arrays are: natural frequency and damping ratio, and the modes.
    """

    alpha3: FloatArray  # (n_angles,), rad
    predicted: FloatArray  # (n_angles, 2, n_modes): deviations of ln(frequency) and of ratios
    sampled: FloatArray  # (n_samples, n_angles, 2, n_modes): ln(frequency) and ratios

    @property
    def spread(self) -> FloatArray:
        """Return the standard deviations of samples that close, (n_angles, 2, n_modes)."""
        return np.asarray(np.nanstd(self.sampled, axis=0))

    @property
    def ratio(self) -> FloatArray:
        """Return predicted over sampled standard deviations, (n_angles, 2, n_modes)."""
        return np.asarray(self.predicted / self.spread)

    @property
    def good(self) -> float:
        """Return the share of the numbers that are within the limit."""
        return float((np.abs(self.ratio - 1.0) <= LIMIT).mean())

    @property
    def worst(self) -> FloatArray:
        """Return the largest difference of the ratios from 1 where there is one, (2, n_modes)."""
        return np.asarray(np.nanmax(np.abs(self.ratio - 1.0), axis=0, initial=0.0))


def described(name: str) -> dict[str, Any]:
    """Return one of `NAMES` or `OWN`; those of the paper get what a tape measure leaves open."""
    if name == "front loader":
        return dict(yaml.safe_load(LOADER))
    if name == "orchard sprayer":
        return with_numbers(described(NAMES[3]), SPRAYER.items())
    if name == "heavy plough":
        return with_numbers(described(NAMES[6]), PLOUGH.items())
    if name == "calibrated starter":
        mapping = described(NAMES[5])
        task = CalibrationTask(mapping, yaml.safe_dump(mapping, sort_keys=False), (), (MEASURED,))
        with TemporaryDirectory() as folder:
            path = Path(folder) / "calibrated.yaml"
            write_mechanism(task, calibrate(task, 1), path)
            return dict(yaml.safe_load(path.read_text()))
    mapping = dict(in_plane(load_yaml(config_file(name))[0]))
    if "uncertainty" in mapping:
        return mapping
    mechanism = mechanism_of(mapping, config_file(name))
    implement = mechanism.rigid_bodies[0]
    mapping = copy.deepcopy(mapping)
    body = mapping["rigid_bodies"][implement.name]
    body["centre_of_gravity"] = list(implement.centre_of_gravity)
    sections = [
        f"links.{link}.section.{key}"
        for link, keys in mapping["links"].items()
        for key in keys["section"]
        if key != "shape"
    ]
    relative = dict.fromkeys(sections, 0.05)
    relative["links.lower_link.material.youngs_modulus"] = 0.03
    relative |= {f"rigid_bodies.{implement.name}.mass": 0.1}
    relative |= {f"rigid_bodies.{implement.name}.inertia": 0.2, "damping.ratio": 0.3}
    places = [f"rigid_bodies.{implement.name}.centre_of_gravity.{i}" for i in (0, 1)]
    absolute = dict.fromkeys(places, 0.05)
    pins = [f"ground.{point}.{i}" for point in ("P2", "P3") for i in (0, 1)]
    pins += [f"rigid_bodies.{implement.name}.points.E2.0"]
    for link, keys in mapping["links"].items():
        pins += [f"links.{link}.points.{point}" for point, at in keys["points"].items() if at]
    absolute |= dict.fromkeys(pins, 0.002)
    mapping["uncertainty"] = {"relative": relative, "absolute": absolute}
    return mapping


def draws(uncertainty: Uncertainty, relative: set[str], count: int, seed: int) -> FloatArray:
    """Return samples of the uncertain numbers, (count, n_numbers).

    Those with relative deviations are normal in their logarithms, so that none becomes negative;
    the others are normal.

    Parameters
    ----------
    uncertainty, relative, count, seed
        What is uncertain; the paths under ``relative``; how many samples; the seed.
    """
    numbers, n = uncertainty.numbers, len(uncertainty.numbers)
    root = np.linalg.cholesky(np.array(uncertainty.correlation).reshape(n, n))
    normal = np.random.default_rng(seed).standard_normal((count, n)) @ root.T
    values = np.array([x.value for x in numbers])
    shift = normal * [x.deviation for x in numbers]
    logarithmic = [x.path in relative for x in numbers]
    shares = np.divide(shift, values, out=np.zeros_like(shift), where=np.array(logarithmic))
    return np.where(logarithmic, values * np.exp(shares), values + shift)


def sampled(mapping: dict[str, Any], alpha3: FloatArray, count: int, seed: int) -> FloatArray:
    """Solve models with other numbers, (count, n_angles, 2, n_modes).

    Each is parsed, closed, reduced and solved as a whole, with fewer elements than the original.
    Its modes are those of the original by rank, so that two that change places are not followed.
    A model that does not close at each of the angles is NaN.

    Parameters
    ----------
    mapping, alpha3
        The description with its ``uncertainty``; angles, rad, (n_angles,).
    count, seed
        As `draws` takes them.
    """
    mechanism = mechanism_of(mapping, Path("description"))
    assert mechanism.uncertainty is not None
    exact = {key: value for key, value in mapping.items() if key != "uncertainty"}
    n, relative = mechanism.response.modes, set(mapping["uncertainty"]["relative"])
    result = np.full((count, len(alpha3), 2, n), math.nan)
    for row, values in zip(
        result, draws(mechanism.uncertainty, relative, count, seed), strict=True
    ):
        pairs = zip(mechanism.uncertainty.numbers, values.tolist(), strict=True)
        numbers = [(path, value) for number, value in pairs for path in split_paths(number.path)]
        try:
            other = mechanism_of(with_numbers(exact, numbers), Path("sample"))
            model = LinkageModel(coarse(other))
            row[:] = [modes_of(model.solve(angle), n) for angle in alpha3.tolist()]
        except (
            LinkageVibrationError
        ):  # a negative number, loops that do not close, a short cylinder
            continue
    return result


def modes_of(solution: Solution, n: int) -> FloatArray:
    """Return logarithms of natural frequencies, and damping ratios, (2, n)."""
    return np.array([np.log(solution.natural_frequencies[:n]), solution.damping_ratios[:n]])


def coarse(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose links have fewer elements and modes, and cylinders more room."""
    springs = tuple(
        replace(s, stiffness=replace(s.stiffness, margin=BEYOND * s.stiffness.stroke))
        if isinstance(s.stiffness, Cylinder)
        else s
        for s in mechanism.springs
    )
    links = [
        replace(link, body=link.body.with_elements(COARSE["elements"]), modes=COARSE["modes"])
        for link in mechanism.links
    ]
    return replace(mechanism, links=tuple(links), springs=springs)


def scatter(mapping: dict[str, Any], count: int, angles: int = ANGLES) -> Scatter:
    """Compare the deviations of a table with samples over the stroke, on all processors.

    Parameters
    ----------
    mapping, count, angles
        The description with its ``uncertainty``; numbers of samples and of angles.
    """
    model = LinkageModel(mechanism_of(mapping, Path("description")))
    predictor = Predictor(build_table(model))
    alpha3 = np.linspace(*predictor.table.alpha3_range, angles)
    predicted = np.array([predictor.shares(angle).parameters for angle in alpha3.tolist()])
    frequencies = predictor.table.evaluate(alpha3)[:, : predictor.table.n_modes]
    predicted[:, 0] /= frequencies
    ascending = np.argsort(frequencies, axis=1)[:, np.newaxis].repeat(2, axis=1)
    predicted = np.take_along_axis(predicted, ascending, axis=2)
    parts = 4
    with ProcessPoolExecutor() as pool:
        waiting = [pool.submit(sampled, mapping, alpha3, count // parts, i) for i in range(parts)]
        values = np.concatenate([each.result() for each in waiting])
    return Scatter(alpha3, predicted, values)


def largest_shares(mapping: dict[str, Any], alpha3: float, mode: int, count: int = 3) -> str:
    """Return the numbers with the largest shares in the variance of a frequency.

    Parameters
    ----------
    mapping, alpha3, mode, count
        The description; rad; index of the mode; how many numbers.
    """
    model = LinkageModel(mechanism_of(mapping, Path("description")))
    uncertainty, solution = model.mechanism.uncertainty, model.solve(alpha3)
    assert uncertainty is not None
    highest = 1.01 * float(solution.natural_frequencies[mode])
    changes = log_changes(model, [alpha3], highest)[0][:, mode]
    parts = changes * (np.array(uncertainty.correlation) @ changes)
    shares = parts / parts.sum()
    best = np.argsort(shares)[::-1][:count].tolist()
    return ", ".join(f"{uncertainty.numbers[i].path} {100.0 * shares[i]:.0f} %" for i in best)


def draw(result: dict[str, Scatter], picture: Path) -> None:
    """Draw both kinds of standard deviations over the stroke, predicted and sampled.

    Parameters
    ----------
    found, picture
        For each description; the file to write.
    """
    figure = Figure(figsize=(4.2 * len(result), 7.4), dpi=110, layout="constrained")
    axes = figure.subplots(2, len(result), sharex="col")
    for column, (name, each) in zip(axes.T, result.items(), strict=True):
        degrees, spread = np.degrees(each.alpha3), 100.0 * np.nanstd(each.sampled, axis=0)
        for panel, sampled_spread, predicted in zip(
            column, spread.swapaxes(0, 1), 100.0 * each.predicted.swapaxes(0, 1), strict=True
        ):
            for mode, colour in enumerate(mode_colours(spread.shape[2])):
                marker = "os"[mode // len(COLOURS)]
                panel.plot(degrees, predicted[:, mode], color=colour)
                label = f"mode {mode + 1}"
                panel.plot(degrees, sampled_spread[:, mode], marker, color=colour, label=label)
            panel.set_ylim(0.0, None)
            panel.grid(color=GREY, alpha=0.2)
        column[0].set_title(name.removesuffix(".yaml"), fontsize=10)
        column[1].set_xlabel("α3 [deg]")
    axes[0, 0].set_ylabel("standard deviation of f [%]")
    axes[1, 0].set_ylabel("standard deviation of ζ [percentage points]")
    title = f"lines: predicted; points: {SAMPLES} samples"
    axes[0, -1].legend(title=title, fontsize=8, ncols=2)
    figure.savefig(picture)


def main() -> None:
    """Sample the shipped descriptions, and publish how predicted deviations compare."""
    mappings = {name: described(name) for name in (*NAMES, *OWN)}
    result = {name: scatter(mapping, SAMPLES) for name, mapping in mappings.items()}
    draw({name: result[name] for name in DRAWN}, PICTURE)
    columns = [
        "description",
        "mode",
        "deviation of f",
        "predicted",
        "worst",
        "damping: worst",
        "known",
    ]
    rows, shares = [], []
    for name, each in result.items():
        spread = np.nanstd(each.sampled[:, :, 0], axis=0)
        for mode in range(spread.shape[1]):
            limits = [f"{100.0 * f(spread[:, mode]):.1f}" for f in (np.min, np.max)]
            known = each.predicted[:, 0, mode]
            own = [f"{100.0 * f(known):.1f}" for f in (np.nanmin, np.nanmax)]
            worst = [f"{100.0 * value:.1f} %" for value in each.worst[:, mode]]
            share = f"{100.0 * np.isfinite(each.predicted[:, :, mode]).all(axis=1).mean():.0f} %"
            rows.append([name, str(mode + 1), " to ".join(limits), " to ".join(own), *worst, share])
            middle = float(np.mean(each.alpha3[[0, -1]]))
            shares.append([name, str(mode + 1), largest_shares(mappings[name], middle, mode)])
    publish(
        "uncertainty",
        "Uncertain numbers of a mechanism",
        [
            f"This page compares the standard deviations that a table predicts with those "
            f"of {SAMPLES} whole models whose numbers are drawn at random, at {ANGLES} angles over "
            "the stroke. Models that do not close at each of these are left out; a cylinder may be "
            "a tenth of its stroke beyond its ends. Modes are counted by rank. Deviations of "
            "natural frequencies are in per cent. The columns with "
            "`worst` are the largest relative differences between predicted and sampled "
            "deviations, of natural frequencies and of damping ratios; sampling alone explains "
            f"about {100.0 * 2.5 / math.sqrt(2.0 * SAMPLES):.0f} %, and twice as much of damping "
            "ratios whose damping deviates by half. Where the table says that it "
            "does not know a deviation, there is no difference; the last column is the share of "
            "the angles at which it knows both.",
            IN_PLANE,
            table(columns, rows),
            "The numbers with the largest shares in the variance of a natural frequency, in the "
            "middle of the stroke:",
            table(["description", "mode", "share"], shares),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
