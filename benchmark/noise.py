# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the standard deviations of identified modes with the scatter over noise seeds."""

import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmark.report import machine, publish, table
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.fbs import component_frf
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import PAPER_MECHANISM, config_file

FloatArray = NDArray[np.float64]

LINES: FloatArray = np.linspace(0.2, 200.0, 1000)  # Hz
ALPHA3 = math.radians(140.0)
SEEDS = 200
BOOM = "boom"  # whose free link has a mode at 164 Hz, among its lines
BOOM_LINES: FloatArray = np.arange(10.0, 400.5)
CASES = (("lower_link", 1e-2), ("upper_link", 1e-2), (BOOM, 1e-2))
LOADER = """
name: loader
ground: {A: [0.0, 0.0], B: [0.0, 0.4], G: [0.3, -0.7]}
links:
  boom:
    points: {A: 0.0, C: 0.9, E: 1.8}
    section: {shape: rectangle, width: 0.06, height: 0.1}
    material: {youngs_modulus: 210.0e+9, density: 7800.0, poisson_ratio: 0.3}
rigid_bodies:
  upper:
    points: {B: [0.0, 0.0], F: [1.8, 0.0]}
    mass: 12.0
    inertia: 3.5
    centre_of_gravity: [0.9, 0.0]
  bucket:
    points: {E: [0.0, 0.0], F: [0.0, 0.4]}
    mass: 300.0
    inertia: 40.0
    centre_of_gravity: [0.5, 0.1]
springs: {cylinder: {between: [G, C], stiffness: 8.0e+6, damping: 4.0e+3}}
input: {link: boom, range_deg: [0.0, 50.0]}
assembly: {alpha3_deg: 20.0, angles_deg: {upper: 20.0, bucket: 0.0}}
damping: {rule: modal_ratio, ratio: 0.01}
response: {drive_point: E, direction: z, band_hz: [10.0, 400.0], modes: 3}
"""


@dataclass(frozen=True)
class Scatter:
    """Modes found with many seeds of noise; NaN where a seed was refused.

    The columns are natural frequencies, Hz, then damping ratios, 1.
    """

    exact: FloatArray  # (2 n_modes,)
    identified: FloatArray  # (n_seeds, 2 n_modes)
    deviations: FloatArray  # (n_seeds, 2 n_modes)
    spurious: int  # seeds with more modes than the assembly has

    @property
    def answered(self) -> int:
        """Seeds that were not refused."""
        return int(np.isfinite(self.identified[:, 0]).sum())

    def coverage(self) -> FloatArray:
        """Return the share of answers within 1.96 standard deviations of the truth, per column."""
        within = np.abs(self.identified - self.exact) <= 1.96 * self.deviations
        return np.asarray(within.sum(axis=0) / self.answered)


def scatter(
    link: str, share: float, seeds: Sequence[int], lines: FloatArray | None = None
) -> Scatter:
    """Identify the modes of the paper's linkage, or of a loader, with a noisy link, many times.

    Parameters
    ----------
    link, share, seeds, lines
        The link that is measured; its relative noise, 1; seeds of the noise; Hz.
    """
    if link == BOOM:
        mechanism, alpha3 = mechanism_from_mapping(yaml.safe_load(LOADER)), math.radians(20.0)
    else:
        mechanism, alpha3 = read_mechanism(config_file(PAPER_MECHANISM)), ALPHA3
    if lines is None:
        lines = BOOM_LINES if link == BOOM else LINES
    model, (low, high) = LinkageModel(mechanism), mechanism.response.band
    solution = model.solve(alpha3)
    hertz = solution.natural_frequencies
    inside = (hertz >= low) & (hertz < high)
    exact = np.concatenate([hertz[inside], solution.damping_ratios[inside]])
    rows = []
    for seed in seeds:
        mixed = with_noise(model, link, share, seed, lines)
        rows.append(_identify(mixed, alpha3, int(inside.sum())))
    result, deviations = np.array([row for row, _ in rows]).swapaxes(0, 1)
    return Scatter(exact, result, deviations, sum(spurious for _, spurious in rows))


def with_noise(
    model: LinkageModel, link: str, share: float, seed: int, lines: FloatArray = LINES
) -> LinkageModel:
    """Return a model one of whose links is known by its FRFs, with noise.

    Parameters
    ----------
    model, link, share, seed, lines
        As `scatter` takes them; the model has matrices.
    """
    at = next(i for i, body in enumerate(model.mechanism.links) if body.name == link)
    part, body = model.components[at], model.mechanism.links[at]
    assert isinstance(part, Component)
    n = len(part.dofs)
    matrices = part.mass, part.stiffness, part.damping
    frf = body.count * component_frf(*matrices, n, lines, part.loss_factor)
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(frf.shape) + 1j * rng.standard_normal(frf.shape)
    frf = frf * (1.0 + share * noise / math.sqrt(2.0))
    links = list(model.mechanism.links)
    links[at] = replace(body, body=Frfs(part.dofs, lines, frf))
    mechanism = replace(model.mechanism, links=tuple(links))
    return LinkageModel(mechanism, kinematics=model.kinematics)


def _identify(mixed: LinkageModel, alpha3: float, count: int) -> tuple[FloatArray, bool]:
    """Return modes and standard deviations, (2, 2 count), and whether there are spurious modes."""
    try:
        modes = mixed.identify(alpha3)
    except LinkageVibrationError:
        return np.full((2, 2 * count), math.nan), False
    if len(modes.natural_frequencies) != count:
        return np.full((2, 2 * count), math.nan), len(modes.natural_frequencies) > count
    values = [modes.natural_frequencies, modes.damping_ratios]
    deviations = [modes.frequency_stddev, modes.damping_ratio_stddev]
    return np.array([np.concatenate(values), np.concatenate(deviations)]), False


def _rows(link: str, share: float, result: Scatter) -> list[list[str]]:
    """Return a row of the page for each mode."""
    rows = []
    n = len(result.exact) // 2
    off = result.identified - result.exact
    coverage = result.coverage()
    for mode in range(n):
        row = [f"{link}, {100.0 * share:g} %", str(mode + 1)]
        for column in (mode, n + mode):
            exact = result.exact[column]
            numbers = (
                np.nanmean(off[:, column]) / exact,
                np.nanstd(off[:, column]) / exact,
                np.nanmedian(result.deviations[:, column]) / exact,
            )
            row += [f"{100.0 * number:.2g} %" for number in numbers]
            row.append(f"{100.0 * coverage[column]:.1f} %")
        rows.append(row)
    return rows


def main() -> None:
    """Identify the modes with every seed, and publish their scatter."""
    with ProcessPoolExecutor(2) as pool:
        waiting = [pool.submit(scatter, *case, range(SEEDS)) for case in CASES]
        computed = [each.result() for each in waiting]
    columns = ["link, noise", "mode"]
    for name in ("f", "ratio"):
        columns += [f"{name}: bias", "scatter", "predicted", "within 95 %"]
    rows = [row for case, each in zip(CASES, computed, strict=True) for row in _rows(*case, each)]
    counts = [
        [f"{link}, {100.0 * share:g} %", str(SEEDS), str(SEEDS - each.answered), str(each.spurious)]
        for (link, share), each in zip(CASES, computed, strict=True)
    ]
    publish(
        "noise",
        "Noise in measured links",
        [
            f"This page shows the modes of the paper's linkage at {math.degrees(ALPHA3):g} deg, "
            f"with one link measured at {len(LINES)} lines up to {LINES[-1]:g} Hz with relative "
            f"noise, and of a loader at 20 deg, whose boom has a mode of its own at 164 Hz among "
            f"its {len(BOOM_LINES)} lines up to {BOOM_LINES[-1]:g} Hz, for {SEEDS} seeds of the "
            "noise. Bias and scatter are relative to the truth. "
            "The predicted standard deviation is the median. The last column of each group is the "
            "share of the answers within 1.96 of their own predicted standard deviations.",
            table(columns, rows),
            "A seed is refused if a mode is missing, or if a mode that noise makes dominates an "
            "FRF:",
            table(["link, noise", "seeds", "refused", "with a spurious mode"], counts),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
