# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares rules for warnings with a time integration of the modal equations."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmark.report import machine, publish, table
from linkage_vibration.drawing.palette import GREY, INK, mode_colours
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.batch import predict_many
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import (
    ReportedSpeed,
    ResonanceMonitor,
    ResonanceState,
    WarningLimits,
)
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table
from test.support.drive import engine_and_pto_speed, hitch_duty_cycle

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "warnings.png"
NAME = "three_point_linkage_on_tractor"
LIMIT = 5e-3  # m/s rms: what a warning is about
CLEARLY = 1.5  # times the limit: what a rule must not miss
STEP, EVERY = 5e-4, 40  # s of the integration; a reading after so many steps, 50 Hz
CASES, DURATION = 120, 10.0  # random working points, s each
WINDOW = 0.5  # s, over which the velocity is averaged
BANDS = 2.0  # half-power half-widths within which one of the rules warns
RULES = (
    "margin 10 %",
    f"margin {BANDS:g} half-power half-widths",
    "probability",
    "level",
    "level with run-up rule",
)


@dataclass(frozen=True)
class Run:
    """Working points over the same times; arrays are (n_cases, n_steps) with steps of `STEP`."""

    alpha3: FloatArray  # rad
    engine: FloatArray  # rpm
    pto: FloatArray  # rpm


def working_points(seed: int) -> Run:
    """Return random angles, with engine speeds that stay or change once, and a PTO that is on."""
    rng, n = np.random.default_rng(seed), round(DURATION / STEP)
    times = np.arange(n) * STEP
    alpha3 = np.repeat(rng.uniform(1.65, 3.05, (CASES, 1)), n, axis=1)
    first, last = rng.uniform(800.0, 2200.0, (2, CASES, 1))
    last = np.where(rng.random((CASES, 1)) < 0.5, first, last)
    begin, length = rng.uniform(2.0, 4.0, (CASES, 1)), rng.uniform(0.5, 5.0, (CASES, 1))
    engine = first + (last - first) * np.clip((times - begin) / length, 0.0, 1.0)
    return Run(alpha3, engine, engine * 0.27 * (rng.random((CASES, 1)) < 0.8))


def drive() -> Run:
    """Return the shipped drive."""
    times, alpha3 = hitch_duty_cycle()
    speed_times, engine, pto = engine_and_pto_speed()
    steps = np.arange(0.0, times[-1], STEP)
    columns = (times, alpha3), (speed_times, engine), (speed_times, pto)
    return Run(*(np.interp(steps, at, values)[np.newaxis] for at, values in columns))


def integrated(
    levels: LevelTable, excitations: Sequence[Excitation], run: Run, size: FloatArray
) -> FloatArray:
    """Integrate the modal equations; return the velocity of the response point, m/s.

    Each term (a + s b) / (k + c s + s^2) has two poles p with z' = p z + f. The force is linear in
    a step, in which z is then exact. Angles, and so poles, change every `EVERY` steps.

    Parameters
    ----------
    levels, excitations, run
        Poles and residues, what excites, and when.
    size : ndarray, (n_cases, n_modes)
        Factors of the natural frequencies.
    """
    cases, steps = run.alpha3.shape
    loads = _loads(levels, excitations, run)
    z = np.zeros((*loads.shape[:2], 1), complex)
    velocity = np.zeros((cases, steps))
    for start in range(0, steps - 1, EVERY):
        p, residues = _poles(levels, run.alpha3[:, start], size)
        h = p * STEP
        grown = np.exp(h)
        second = (grown - 1.0 - h) / h**2 * STEP
        first = (grown - 1.0) / h * STEP - second
        p, grown = p[:, np.newaxis], grown[:, np.newaxis]
        first, second = first[:, np.newaxis], second[:, np.newaxis]
        direct = residues.sum(axis=2)
        for i in range(start + 1, min(start + EVERY, steps - 1) + 1):
            before, now = loads[..., i - 1, np.newaxis], loads[..., i, np.newaxis]
            z = grown * z + first * before + second * now
            moved = (residues * (p * z)).sum(axis=2) + direct * loads[..., i]
            velocity[:, i] = moved.real.sum(axis=1)
    return velocity


def _loads(levels: LevelTable, excitations: Sequence[Excitation], run: Run) -> FloatArray:
    """Return the sum of the loads on each input, (n_cases, n_inputs, n_steps)."""
    inputs = levels.terms(run.alpha3[0, :1])[2]
    loads = np.zeros((len(run.alpha3), int(inputs.max()) + 1, run.alpha3.shape[1]))
    for one, which in zip(excitations, inputs.tolist(), strict=True):
        speed = {Source.ENGINE: run.engine, Source.PTO: run.pto}.get(one.source)
        if speed is not None and one.load is not None:
            amplitude = one.load.amplitude * (speed / one.load.speed) ** one.load.exponent
            phase = 2.0 * math.pi * one.ratio * np.cumsum(speed, axis=1) * STEP
            loads[:, which] += amplitude * np.sin(phase)
    return loads


def _poles(
    levels: LevelTable, alpha3: FloatArray, size: FloatArray
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return poles and residues, (n_cases, n_roots) and (n_cases, n_inputs, n_roots).

    The modes have other natural frequencies by the factors in `size`.
    """
    poles, residues, _ = levels.terms(alpha3)
    k, c = poles[0].T + 1j * poles[1].T, poles[2].T.copy()
    n = size.shape[1]
    k[:, :n] *= size**2
    c[:, :n] *= size
    a = (residues[0] + 1j * residues[1]).transpose(2, 1, 0)
    b = residues[2].transpose(2, 1, 0)
    root = np.sqrt(c**2 / 4.0 - k)
    one, other = -c / 2.0 + root, -c / 2.0 - root
    upper = (a + b * one[:, np.newaxis]) / (2.0 * root[:, np.newaxis])
    lower = -(a + b * other[:, np.newaxis]) / (2.0 * root[:, np.newaxis])
    return np.hstack([one, other]), np.concatenate([upper, lower], axis=2)


def running_rms(velocity: FloatArray) -> FloatArray:
    """Return root mean squares over the window that ends at each reading, (n_cases, n_readings)."""
    n = round(WINDOW / STEP)
    sums = np.cumsum(np.pad(velocity**2, ((0, 0), (n, 0))), axis=1)
    return np.sqrt((sums[:, n:] - sums[:, :-n]) / n)[:, ::EVERY]


def warned(
    rule: str,
    predictor: Predictor,
    levels: LevelTable,
    excitations: Sequence[Excitation],
    run: Run,
) -> BoolArray:
    """Return whether a rule warns at each reading, (n_cases, n_readings)."""
    found = []
    for alpha3, engine, pto in zip(
        *(x[:, ::EVERY] for x in (run.alpha3, run.engine, run.pto)), strict=True
    ):
        n = len(alpha3)
        predictions = predict_many(predictor, alpha3, np.zeros(n))
        if rule == RULES[1]:
            found.append(_in_bands(predictions, excitations, engine, pto))
            continue
        monitor = ResonanceMonitor(excitations, WarningLimits(level=LIMIT), levels=levels)
        if rule == RULES[0]:
            monitor.levels = None
        time = np.arange(n) * round(1e9 * STEP * EVERY)
        speeds = [
            ReportedSpeed(i, source, float(values[i]), int(time[i]))
            for i in range(0, n, 5)  # 10 Hz
            for source, values in ((Source.ENGINE, engine), (Source.PTO, pto))
        ]
        velocity = np.gradient(alpha3, STEP * EVERY)
        states = monitor.assess_many(predictions, velocity, time, speeds, np.zeros(n)).state
        notes = rule != RULES[4]
        found.append((states == ResonanceState.WARNING) | ((states == ResonanceState.NOTE) & notes))
    return np.array(found)


def _in_bands(
    predictions: MessageColumns,
    excitations: Sequence[Excitation],
    engine: FloatArray,
    pto: FloatArray,
) -> BoolArray:
    """Return where an excitation is near a mode, in half-power half-widths."""
    near = np.zeros(len(engine), bool)
    natural, zeta = predictions.natural_frequencies, predictions.damping_ratios
    for one in excitations:
        speed = {Source.ENGINE: engine, Source.PTO: pto}.get(one.source)
        if speed is not None:
            apart = np.abs(one.ratio * speed[:, np.newaxis] - natural)
            near |= (apart < BANDS * zeta * natural).any(axis=1)
    return near


@dataclass(frozen=True)
class Score:
    """How a rule does, as shares of time."""

    warned: float  # of all time
    missed: float  # of the time clearly above the limit: no warning within a second of it
    needless: float  # of the warned time: below half the limit within a second around


def score(warns: BoolArray, rms: FloatArray) -> Score:
    """Compare warnings with the velocity, both (n_cases, n_readings)."""
    second = round(1.0 / (STEP * EVERY))

    def widened(flags: BoolArray) -> BoolArray:
        padded = np.pad(flags, ((0, 0), (second, second)))
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * second + 1, axis=1)
        return np.asarray(windows.any(axis=2))

    above, near = rms > CLEARLY * LIMIT, widened(rms > LIMIT / 2.0)
    missed = (above & ~widened(warns)).sum() / max(above.sum(), 1)
    needless = (warns & ~near).sum() / max(warns.sum(), 1)
    return Score(float(warns.mean()), float(missed), float(needless))


def draw(
    rms: FloatArray, warnings: dict[str, BoolArray], scores: dict[str, Score], picture: Path
) -> None:
    """Draw the drive with its warnings, and how the rules do at the random working points."""
    figure = Figure(figsize=(11.0, 6.0), dpi=110, layout="constrained")
    upper, lower = figure.subplots(2, 1, height_ratios=[1.3, 1.0])
    times = np.arange(len(rms)) * STEP * EVERY
    upper.plot(times, 1e3 * rms, color=INK, label=f"velocity, rms over {WINDOW:g} s, integrated")
    upper.axhline(1e3 * LIMIT, color=GREY, ls="--", label="limit")
    top = 1.15e3 * float(rms.max())
    for k, (rule, colour) in enumerate(zip(RULES, mode_colours(len(RULES)), strict=True)):
        low, high = -(k + 0.2) * 0.09 * top, -(k + 0.8) * 0.09 * top
        upper.fill_between(times, low, high, where=warnings[rule][0], color=colour, lw=0)
        upper.annotate(rule, (times[-1], (low + high) / 2.0), va="center", fontsize=8)
    upper.set(title="The shipped drive, and when each rule warns", xlabel="time [s]")
    upper.set(ylabel="velocity [mm/s]", xlim=(0.0, 1.25 * times[-1]), ylim=(-0.5 * top, top))
    upper.set_yticks(np.arange(0.0, top, 10.0))
    upper.legend(loc="upper center", fontsize=8)
    at, width = np.arange(len(RULES)), 0.27
    for i, (name, label) in enumerate(
        (
            ("warned", "warned, of all time"),
            ("missed", f"missed, of the time above {CLEARLY:g} limits"),
            ("needless", "needless, of the warned time"),
        )
    ):
        values = [100.0 * getattr(scores[rule], name) for rule in RULES]
        bars = lower.bar(at + (i - 1) * width, values, width, label=label, color=mode_colours(3)[i])
        lower.bar_label(bars, fmt="%.0f", fontsize=8)
    lower.set_xticks(at, RULES, fontsize=9)
    lower.set(title=f"{CASES} random working points, each with modes as uncertain as stated")
    lower.set(ylabel="share of time [%]", ylim=(0.0, 115.0))
    lower.legend(fontsize=8, ncols=3)
    figure.savefig(picture)


def main() -> None:
    """Integrate, let every rule warn, and publish how often each warns and what it misses."""
    mechanism = read_mechanism(config_file(f"{NAME}.yaml"))
    predictor = Predictor(load_table(config_file(f"tables/{NAME}.npz")))
    loaded = read_excitations(config_file("excitations_on_tractor.yaml"))
    plain = [replace(one, load=None) for one in loaded]
    tables = [LevelTable(predictor, mechanism, some) for some in (plain, loaded)]
    rng, n = np.random.default_rng(7), predictor.table.n_modes
    points, shipped = working_points(1), drive()
    found = predict_many(predictor, points.alpha3[:, 0], np.zeros(CASES))
    deviation = found.frequency_stddev / found.natural_frequencies
    sizes = [np.exp(deviation * rng.standard_normal((CASES, n))), np.ones((1, n))]
    rows, scores, warnings, last = [], {}, {}, np.empty(0)
    for where, run, size in zip(("random", "drive"), (points, shipped), sizes, strict=True):
        rms = running_rms(integrated(tables[1], loaded, run, size))
        for rule in RULES:
            with_loads = rule in RULES[3:]
            own, levels = (loaded, tables[1]) if with_loads else (plain, tables[0])
            warns = warned(rule, predictor, levels, own, run)
            one = score(warns, rms)
            cells = [f"{100.0 * x:.1f} %" for x in (one.warned, one.missed, one.needless)]
            rows.append([where, rule, *cells])
            if where == "random":
                scores[rule] = one
            else:
                warnings[rule], last = warns, rms[0]
        for factor in (0.5, 1.0, CLEARLY):
            above = 100.0 * float((rms > factor * LIMIT).mean())
            rows.append([where, f"(above {1e3 * factor * LIMIT:g} mm/s)", f"{above:.1f} %", "", ""])
    draw(last, warnings, scores, PICTURE)
    publish(
        "warnings",
        "Rules for warnings",
        [
            "This page compares rules for warnings with a time integration of the modal equations "
            "of the linkage on a tractor, excited as `config/excitations_on_tractor.yaml` assumes. "
            "A rule should warn where the velocity of the response point, rms over "
            f"{WINDOW:g} s, is above {1e3 * LIMIT:g} mm/s. {CASES} random working points of "
            f"{DURATION:g} s each have random angles, and engine speeds of which half change once, "
            "within 0.5 to 5 s. Their modes deviate from those of the table at random, as far as "
            "the table states. The shipped drive has the modes of the table. A time at which the "
            f"velocity is above {CLEARLY:g} times the limit is missed if the rule does not warn "
            "within a second of it. A warning is needless if the velocity does not reach half the "
            "limit within a second of it.",
            table(["runs", "rule", "warned", "missed", "needless"], rows),
            "Everything depends on the assumed amplitudes.",
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
