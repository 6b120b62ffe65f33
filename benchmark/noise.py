# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the standard deviations of identified modes with the scatter over noise seeds."""

import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmark.report import machine, publish, table
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.fbs import component_frf
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import PAPER_MECHANISM, config_file

FloatArray = NDArray[np.float64]

LINES: FloatArray = np.linspace(0.2, 200.0, 1000)  # Hz
ALPHA3 = math.radians(140.0)
SEEDS = 200
CASES = (("lower_link", 1e-2), ("upper_link", 1e-2))


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


def scatter(link: str, share: float, seeds: Sequence[int], lines: FloatArray = LINES) -> Scatter:
    """Identify the modes of the paper's linkage with a noisy link, with many seeds.

    Parameters
    ----------
    link, share, seeds, lines
        The link that is measured; its relative noise, 1; seeds of the noise; Hz.
    """
    model = LinkageModel(read_mechanism(config_file(PAPER_MECHANISM)))
    solution = model.solve(ALPHA3)
    inside = solution.natural_frequencies < model.mechanism.response.band[1]
    exact = np.concatenate([solution.natural_frequencies[inside], solution.damping_ratios[inside]])
    rows = []
    for seed in seeds:
        mixed = with_noise(model, link, share, seed, lines)
        rows.append(_identify(mixed, int(inside.sum())))
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


def _identify(mixed: LinkageModel, count: int) -> tuple[FloatArray, bool]:
    """Return modes and standard deviations, (2, 2 count), and whether there are spurious modes."""
    try:
        modes = mixed.identify(ALPHA3)
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
            f"noise, for {SEEDS} seeds of the noise. Bias and scatter are relative to the truth. "
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
