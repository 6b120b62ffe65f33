# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Do the intervals of `measure` hold? ``python -m benchmark measured_modes`` simulates recordings.

Each is five blows on an implement that is 25 % heavier than the model's, sampled at 400 Hz without
an anti-aliasing filter: every mode of the finite elements is in it, above 200 Hz folded.
"""

import logging
import math
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stderr
from dataclasses import dataclass

import numpy as np

from benchmark.report import machine, publish, table
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.mechanics.paths import with_numbers
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.studies.measurement import doubt_folds
from linkage_vibration.studies.ringdown import measure_modes
from linkage_vibration.support.resources import config_file
from test.support.in_plane import IN_PLANE, in_plane

SEEDS = 200
ANGLES = (95.0, 105.0, 115.0, 125.0, 135.0, 145.0, 155.0, 165.0, 175.0)  # deg
RATE, BLOWS, SECONDS = 400.0, 5, 8.0  # Hz, s from a blow to the next
IMPULSE, CONTACT, NOISE = 200.0, 4e-3, 0.05  # N s, s of half a sine, m/s2
PLACES = [("E1", "x"), ("E1", "z")]
HEAVIER = 1.25
INTERVAL = 1.96  # standard deviations
OTHER_SEEDS = 10  # recordings of each hitch for pyOMA2
SLOW, DECIMATED = 20.0, 8  # Hz below which pyOMA2 gets every eighth sample of a filtered recording
BLOCK_ROWS, ORDER, BLOCKS = 40, 24, 50
OURS, OTHER = "measure", "pyOMA2"
AXLES = ("front_axle", "rear_axle")
# The file, and what is changed: a tractor of 7 t with a harrow of 2200 kg on tyres with 7 %.
CASES: dict[str, tuple[str, dict[str, float]]] = {
    "linkage": ("three_point_linkage", {}),
    "tractor of 4.5 t": ("three_point_linkage_on_tractor", {}),
    "tractor of 7 t, tyres 7 %": (
        "three_point_linkage_on_tractor",
        {
            "base.mass": 7000.0,
            "base.inertia": 12000.0,
            "rigid_bodies.implement.mass": 2200.0 / HEAVIER,
            "rigid_bodies.implement.inertia": 500.0,
        }
        | {f"base.mounts.{axle}.stiffness.{i}": 520e3 for axle in AXLES for i in (0, 1)}
        | {
            f"base.mounts.{axle}.damping.{i}": 2.0 * 0.07 * 520e3 / (2.0 * math.pi * 1.9)
            for axle in AXLES
            for i in (0, 1)
        },
    ),
}


@dataclass(frozen=True)
class Estimate:
    """A mode that was found in a recording, and the nearest one of the simulation."""

    case: str
    program: str
    mode: int  # from 0
    true: tuple[float, float]  # Hz and damping ratio
    identified: tuple[float, float]
    stddevs: tuple[float, float]
    doubt: str = ""

    @property
    def exists(self) -> bool:
        """Whether the mode is in the band, and nearer than 2 % or its interval."""
        away = abs(self.identified[0] - self.true[0])
        near = away < max(0.02 * self.true[0], INTERVAL * self.stddevs[0])
        return near and self.true[0] < RATE / 2.0

    @property
    def holds(self) -> tuple[bool, bool]:
        """Whether the intervals of 95 % contain the true frequency and damping ratio."""
        frequency, ratio = (
            abs(each - true) <= INTERVAL * stddev
            for each, true, stddev in zip(self.identified, self.true, self.stddevs, strict=True)
        )
        return frequency, ratio


def models(case: str) -> tuple[LinkageModel, LinkageModel]:
    """Return the model that is compared, and the one that is simulated."""
    file, numbers = CASES[case]
    mapping = with_numbers(in_plane(load_yaml(config_file(f"{file}.yaml"))[0]), numbers.items())
    mass = mapping["rigid_bodies"]["implement"]["mass"]
    heavier = with_numbers(mapping, [("rigid_bodies.implement.mass", HEAVIER * mass)])
    compared, simulated = (LinkageModel(mechanism_from_mapping(m)) for m in (mapping, heavier))
    return compared, simulated


def poles_and_residues(model: LinkageModel, alpha3: float) -> tuple[ComplexArray, ComplexArray]:
    """Return all poles, (n,), and the residues of the receptances there, (2, 2, n)."""
    terms = model.solve(alpha3).frf(PLACES, PLACES)
    root = np.sqrt((terms.decay / 2.0) ** 2 - terms.stiffness.astype(complex))
    poles = np.concatenate([root, -root]) - np.tile(terms.decay / 2.0, 2)
    residues = np.tile(terms.residues, 2) + poles * np.tile(terms.rates, 2)
    return poles, residues / np.concatenate([2.0 * root, -2.0 * root])


def simulate(
    poles: ComplexArray, residues: ComplexArray, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Return times and accelerations, (n, 2), of blows in random directions, and noise."""
    random = np.random.default_rng(seed)
    count = int(RATE * SECONDS)
    times = np.arange(count) / RATE - 1.0 - random.uniform(0.0, 1.0 / RATE)
    turning, each = math.pi / CONTACT, poles[:, np.newaxis]
    during = (times >= 0.0) & (times < CONTACT)
    force = IMPULSE * turning / 2.0 * np.where(during, np.sin(turning * times), 0.0)
    driven = -each * np.sin(turning * times) - turning * np.cos(turning * times)
    late = turning * np.exp(each * np.maximum(times - CONTACT, 0.0))
    shape = turning * np.exp(each * np.maximum(times, 0.0)) + np.where(during, driven, late)
    scale = (times >= 0.0) * IMPULSE * turning / 2.0
    response = shape * scale / (each**2 + turning**2)
    blows = []
    for angle in random.uniform(0.0, math.pi, BLOWS):
        along = np.einsum("oip,i->op", residues, [math.cos(angle), math.sin(angle)])
        signal = (along * poles**2) @ response + np.outer((along * poles).sum(axis=1), force)
        blows.append(signal.real.T)
    signals = np.vstack(blows) + random.normal(0.0, NOISE, (BLOWS * count, 2)) + [0.0, 9.81]
    return np.arange(len(signals)) / RATE, signals


def measured(job: tuple[str, int]) -> list[Estimate]:
    """Return what `measure` and pyOMA2 find in a recording of a case with a seed."""
    case, seed = job
    compared, simulated = models(case)
    alpha3 = math.radians(ANGLES[seed % len(ANGLES)])
    poles, residues = poles_and_residues(simulated, alpha3)
    times, signals = simulate(poles, residues, seed)
    poles = np.sort_complex(poles[(poles.imag > 0.0) & (np.abs(poles) < math.pi * RATE)])
    poles = poles[np.argsort(np.abs(poles))]
    hertz, ratios = np.abs(poles) / (2.0 * math.pi), -poles.real / np.abs(poles)
    modes = doubt_folds(measure_modes(times, signals), compared, alpha3, RATE)
    estimates = []
    for mode in modes:
        i = int(np.abs(np.log(mode.frequency / hertz)).argmin())
        true, each = (float(hertz[i]), float(ratios[i])), (mode.frequency, mode.ratio)
        stddevs = (mode.frequency_stddev, mode.ratio_stddev)
        estimates.append(Estimate(case, OURS, i, true, each, stddevs, mode.doubt))
    if seed < OTHER_SEEDS:
        for i, each, stddevs in of_pyoma(signals, hertz):
            true = (float(hertz[i]), float(ratios[i]))
            estimates.append(Estimate(case, OTHER, i, true, each, stddevs))
    return estimates


def of_pyoma(
    signals: FloatArray, hertz: FloatArray
) -> Iterator[tuple[int, tuple[float, float], tuple[float, float]]]:
    """Yield each mode that SSI finds near a frequency: its number, values and deviations."""
    from pyoma2.algorithms import SSI
    from pyoma2.setup import SingleSetup

    logging.disable(logging.CRITICAL)
    for slow in (True, False):
        setup = SingleSetup(signals - signals.mean(axis=0), RATE)
        if slow:
            setup.decimate_data(q=DECIMATED)
        algorithm = SSI(
            name="ssi", method="cov", br=BLOCK_ROWS, ordmax=ORDER, calc_unc=True, nb=BLOCKS
        )
        setup.add_algorithms(algorithm)
        with open(os.devnull, "w", encoding="utf-8") as nothing, redirect_stderr(nothing):
            setup.run_all()
        for i in np.flatnonzero((hertz < SLOW) == slow).tolist():
            setup.mpe("ssi", sel_freq=[float(hertz[i])], order_in=ORDER)
            result = algorithm.result
            values = [result.Fn, result.Xi, result.Fn_std, result.Xi_std]
            if all(len(each) == 1 and np.isfinite(each[0]) for each in values):
                frequency, ratio, *stddevs = (float(each[0]) for each in values)
                yield i, (frequency, ratio), (stddevs[0], stddevs[1])


def share(part: int, whole: int) -> str:
    """Return a share in percent, with the number of which it is one."""
    return f"{100.0 * part / whole:.0f} %" if whole else "-"


def rows(estimates: Iterable[Estimate], recordings: int) -> list[list[str]]:
    """Return a row for each mode of each hitch that was reported."""
    chosen = [each for each in estimates if each.exists and not each.doubt]
    lines = []
    for case, mode in sorted({(each.case, each.mode) for each in chosen}):
        group = [each for each in chosen if (each.case, each.mode) == (case, mode)]
        hertz = [each.true[0] for each in group]
        errors = [abs(each.identified[0] / each.true[0] - 1.0) for each in group]
        deviation = np.median([each.stddevs[0] / each.true[0] for each in group])
        holds = np.sum([each.holds for each in group], axis=0).tolist()
        low, high = min(hertz), max(hertz)
        lines.append([
            f"{case}, mode {mode + 1}",
            f"{low:.3g} to {high:.3g}",
            share(len(group), recordings),
            f"{100.0 * float(np.median(errors)):.2g} %",
            f"{100.0 * deviation:.2g} %",
            *(share(count, len(group)) for count in holds),
        ])  # fmt: skip
    return lines


COLUMNS = ("hitch and mode", "Hz", "reported", "median error", "median deviation")
INTERVALS = ("frequency in interval", "ratio in interval")


def main() -> None:
    """Simulate, measure, and write the page."""
    jobs = [(case, seed) for seed in range(SEEDS) for case in CASES]
    with ProcessPoolExecutor() as pool:
        estimates = [each for item in pool.map(measured, jobs, chunksize=3) for each in item]
    ours = [each for each in estimates if each.program == OURS]
    sure = [each for each in ours if not each.doubt]
    false = [each for each in sure if not each.exists]
    folded = [each for each in ours if "folded" in each.doubt]
    right = [each for each in folded if not each.exists]
    lines = [f"{each.case}: {each.identified[0]:.2f} Hz +- {each.stddevs[0]:.2g}" for each in false]
    others = [each for each in estimates if each.program == OTHER]
    intro = (
        "`measure` reports modes whose intervals of 95 % hold, or says why it does not. "
        f"{SEEDS} recordings of each of {len(CASES)} hitches were simulated at {len(ANGLES)} "
        f"crank angles: {BLOWS} blows in random directions, contact {1e3 * CONTACT:g} ms, "
        f"{RATE:g} Hz without an anti-aliasing filter, noise {NOISE:g} m/s2. The model that is "
        f"compared has an implement that is {HEAVIER:g} times too light. A mode that is hardly "
        "excited is not reported."
    )
    doubts = (
        f"Of {len(sure)} modes that were reported as sure, {len(false)} do not exist"
        f"{': ' + '; '.join(lines) if lines else ''}. {len(folded)} modes were reported as "
        f"possibly folded; {len(right)} of them are folded, or do not exist."
    )
    peer = (
        f"pyOMA2 (SSI-cov with uncertainties, {BLOCK_ROWS} block rows, order {ORDER}) had the "
        f"first {OTHER_SEEDS} recordings of each hitch, below {SLOW:g} Hz filtered and decimated "
        f"by {DECIMATED}. It was given the true frequencies, near which it takes a pole; `measure` "
        "was not. Its method is meant for vibration that noise excites, not for blows."
    )
    heading = (*COLUMNS, *INTERVALS)
    publish(
        "measured_modes",
        "Measured modes: do their intervals hold?",
        [
            intro,
            IN_PLANE,
            table(heading, rows(ours, SEEDS)),
            doubts,
            "## The same recordings in pyOMA2",
            peer,
            table(heading, rows(others, OTHER_SEEDS)),
        ],
        machine("pyOMA-2"),
    )


if __name__ == "__main__":
    main()
