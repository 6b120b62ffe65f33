# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures the error and the cost of every method: the points of the chart."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.speed.assembled import sparse_frequencies
from benchmark.speed.coupled import modal_frf
from benchmark.speed.method import Method, counted
from benchmark.speed.samples import Sampler, unpacked
from benchmark.speed.scene import MODES, Scene, frf_error, worst_frequency
from benchmark.speed.tables import errors, tables
from benchmark.speed.timing import Spread, spread, turns
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.table.table import Table

FloatArray = NDArray[np.float64]
Progress = Callable[[float], object]
"""Called with shares of the work, which sum up to 1."""

CONFIGURATION, FRFS, LIVE = "a configuration", "an FRF set", "a prediction"
INTERPOLATED = ("table: frequencies", "table: peak", "table: whole FRFs")
EXACT = "exact solution a message"
PACKAGE = "the package's table, to a tolerance"
CHOSEN = ", chosen points"
_AT_LEAST = 5e-3  # s, least time of a sample
_SLOW = 2.0  # s, a job that takes longer is timed only once


@dataclass(frozen=True, slots=True)
class Point:
    """One point of the chart: a method with one setting.

    Attributes
    ----------
    part : str
        The quantity that is computed.
    family, setting : str
        The line of the chart and the point on it.
    error : float
        Relative error; NaN if the method cannot compute the quantity.
    cost : Spread
        Cost in lookups of a table; for errors of tables, in solutions of the model.
    missing : str
        The reason if the quantity cannot be computed.
    """

    part: str
    family: str
    setting: str
    error: float
    cost: Spread
    missing: str = ""


_NONE = Spread(math.nan, math.nan, math.nan)


def measure(
    scene: Scene,
    methods: Sequence[Method],
    unit: Callable[[], object],
    rounds: int,
    progress: Progress,
) -> list[Point]:
    """Compare methods with the reference, for natural frequencies and for FRFs.

    Parameters
    ----------
    scene : Scene
        The linkage and its angles.
    methods : sequence of Method
        The methods.
    unit : callable
        A call whose time is the unit of costs.
    rounds : int
        Number of rounds in which each method is timed.
    progress : callable
        See `Progress`.
    """
    frequencies, frfs = scene.reference(scene.angles)
    points: list[Point] = []
    jobs: dict[tuple[str, str, str], Callable[[], object]] = {}
    parts: tuple[tuple[str, str, Callable[[Any, Any], float], Any], ...] = (
        (CONFIGURATION, "frequencies", worst_frequency, frequencies),
        (FRFS, "frf", frf_error, frfs),
    )
    for method in methods:
        for part, attribute, error, exact in parts:
            answer = getattr(method, attribute)
            if answer is None:
                points.append(
                    Point(part, method.family, method.setting, math.nan, _NONE, method.missing)
                )
                continue
            worst = max(
                error(answer(float(alpha3)), right)
                for alpha3, right in zip(scene.angles, exact, strict=True)
            )
            points.append(Point(part, method.family, method.setting, worst, _NONE))
            jobs[part, method.family, method.setting] = cycling(answer, scene.angles)
        progress(0.3 / len(methods))
    return _timed(points, jobs, unit, rounds, lambda share: progress(0.7 * share))


def measure_live(
    scene: Scene,
    exact_modes: Sequence[int],
    points_of_tables: Sequence[int],
    unit: Callable[[], object],
    rounds: int,
    progress: Progress,
) -> list[Point]:
    """Compare predictions by tables and by exact solutions with the reference.

    The tables contain the shipped linkage, reduced. Their interpolation errors are separate points,
    in the parts `INTERPOLATED`.
    """
    model = scene.model()
    fine = scene.model(elements=scene.fine, reduced=False)
    exact = np.array([sparse_frequencies(fine, float(a)) for a in scene.live_angles])
    points, jobs = [], {}
    for n in exact_modes:
        answer = partial(solved, scene.model(modes=n))
        values = np.array([answer(float(a))[:MODES] for a in scene.live_angles])
        setting = counted(n, "mode")
        points.append(Point(LIVE, EXACT, setting, worst_frequency(values, exact), _NONE))
        jobs[LIVE, EXACT, setting] = cycling(answer, scene.live_angles)
    sampler = Sampler(model)
    some = scene.live_angles[: max(1, len(scene.live_angles) // 10)]
    whole = [modal_frf(model, float(alpha3), scene.lines) for alpha3 in some]
    omega = 2.0 * math.pi * scene.lines
    for n in points_of_tables:
        built = tables(sampler, model.mechanism.stroke, n)
        for (name, is_chosen), (live, terms) in built.items():
            family, setting = name + CHOSEN * is_chosen, counted(n, "point")
            missed = [
                *errors(live, lambda alpha3: sampler.at(alpha3).live, scene.live_angles),
                max(
                    frf_error(unpacked(terms(float(alpha3)), omega), right)
                    for alpha3, right in zip(some, whole, strict=True)
                ),
            ]
            solves = spread([float(n)])
            points += [
                Point(part, family, setting, error, solves)
                for part, error in zip(INTERPOLATED, missed, strict=True)
            ]
            values = np.array([live(float(a))[:MODES] for a in scene.live_angles])
            points.append(Point(LIVE, family, setting, worst_frequency(values, exact), _NONE))
            jobs[LIVE, family, setting] = cycling(live, scene.live_angles)
        progress(0.6 * n / sum(points_of_tables))
    return _timed(points, jobs, unit, rounds, lambda share: progress(0.4 * share))


def measure_package(
    scene: Scene, built: Sequence[tuple[Table, int]], unit: Callable[[], object], rounds: int
) -> list[Point]:
    """Compare the package's own tables; each comes with the number of solutions that it needed."""
    model = scene.model()
    fine = scene.model(elements=scene.fine, reduced=False)
    exact = np.array([sparse_frequencies(fine, float(a)) for a in scene.live_angles])
    solutions = [model.solve(float(alpha3)) for alpha3 in scene.live_angles]
    own = np.array([solution.natural_frequencies[:MODES] for solution in solutions])
    peaks = [solution.peak(model.mechanism.response.peak_band) for solution in solutions]
    points, jobs = [], {}
    for table, solves in built:
        values = table.evaluate(scene.live_angles)
        setting = counted(len(table.alpha3), "point")
        peak = [[p.frequency, p.magnitude] for p in peaks]
        frf = max(
            frf_error(
                table.frf(s.configuration.alpha3, table.places, table.places[:1])
                .frf(scene.lines)
                .reshape(len(scene.lines), -1),
                s.frf(table.places, table.places[:1])
                .frf(scene.lines)
                .reshape(len(scene.lines), -1),
            )
            for s in solutions[: max(1, len(solutions) // 10)]
        )
        missed = (
            worst_frequency(values[:, :MODES], own),
            worst_frequency(values[:, -2:], np.array(peak)),
            frf,
        )
        points += [
            Point(part, PACKAGE, setting, error, spread([float(solves)]))
            for part, error in zip(INTERPOLATED, missed, strict=True)
        ]
        error = worst_frequency(values[:, :MODES], exact)
        points.append(Point(LIVE, PACKAGE, setting, error, _NONE))
        jobs[LIVE, PACKAGE, setting] = cycling(table.interpolate, scene.live_angles)
    return _timed(points, jobs, unit, rounds, lambda share: None)


def solved(model: LinkageModel, alpha3: float) -> FloatArray:
    """Return the values of a prediction from the model, (8,), as in `samples.Sample.live`."""
    solution = model.solve(alpha3)
    peak = solution.peak(model.mechanism.response.peak_band)
    return np.array(
        [
            *solution.natural_frequencies[:MODES],
            *solution.damping_ratios[:MODES],
            peak.frequency,
            math.log(peak.magnitude),
        ]
    )


def cycling(answer: Callable[[float], object], angles: FloatArray) -> Callable[[], object]:
    """Return a call that gives the answer at one angle after the other."""
    turn = cycle(angles.tolist())
    return lambda: answer(next(turn))


def _timed(
    points: Sequence[Point],
    jobs: dict[tuple[str, str, str], Callable[[], object]],
    unit: Callable[[], object],
    rounds: int,
    progress: Progress,
) -> list[Point]:
    """Return the points with their costs, in the unit of the same round."""
    names = {" / ".join(key): key for key in jobs}
    todo = {"": unit, **{name: jobs[key] for name, key in names.items()}}
    share = 1.0 / (rounds * len(todo))
    samples = turns(todo, rounds, at_least=_AT_LEAST, slow=_SLOW, step=lambda: progress(share))
    own = samples[""]
    costs = {
        key: spread([taken / each for taken, each in zip(samples[name], own, strict=False)])
        for name, key in names.items()
    }
    return [
        Point(
            p.part,
            p.family,
            p.setting,
            p.error,
            costs.get((p.part, p.family, p.setting), p.cost),
            p.missing,
        )
        for p in points
    ]
