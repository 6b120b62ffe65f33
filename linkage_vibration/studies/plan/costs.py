# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The time that predictions and FRFs of a model or a table take."""

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.studies.plan.results import Residual, shorten
from linkage_vibration.studies.plan.scene import Scene
from linkage_vibration.table.table import Table

FRF_LINES = 2001  # frequencies over the band at which FRFs are timed
_LOOKUPS = 1000  # that are timed; one takes microseconds


@dataclass(frozen=True, slots=True)
class Costs:
    """Times in seconds."""

    setup: float  # from the mechanism to the first prediction: kinematics, components, table
    prediction: float  # natural frequencies, damping ratios and the peak at one angle
    frfs: float  # the FRFs between all places at one angle, at `FRF_LINES` frequencies


def measure_costs(
    scene: Scene, source: LinkageModel | Table, residual: Residual, setup: float
) -> Costs:
    """Measure the median times of a prediction and of the FRFs; FRFs take 0 s without places.

    Parameters
    ----------
    scene : Scene
        The question.
    source : LinkageModel or Table
        What predicts.
    residual : str
        How FRFs of a model represent the modes above the band.
    setup : float
        The set-up's time, s, which is passed on.
    """
    if isinstance(source, Table):
        return Costs(setup, *_lookup_seconds(scene, source))
    return Costs(setup, *_solve_seconds(scene, source, residual))


def _lookup_seconds(scene: Scene, table: Table) -> tuple[float, float]:
    angles = itertools.cycle(np.linspace(*scene.angles, _LOOKUPS).tolist())
    table.interpolate(scene.angles[0])  # the first lookup also prepares the table
    prediction = _median(lambda: table.interpolate(next(angles)), _LOOKUPS)
    places = scene.places
    return prediction, _frf_seconds(scene, lambda: table.frf(next(angles), places, places))


def _solve_seconds(scene: Scene, model: LinkageModel, residual: Residual) -> tuple[float, float]:
    alpha3, places = scene.angles_at([0.5])[0], scene.places
    prediction = _median(lambda: _predict(scene, model, alpha3))
    solution = model.solve(alpha3)
    return prediction, _frf_seconds(
        scene, lambda: shorten(solution.frf(places, places), residual, scene.band)
    )


def _predict(scene: Scene, model: LinkageModel, alpha3: float) -> None:
    solution = model.solve(alpha3)
    _ = solution.damped, solution.peak(scene.band)  # both are computed when they are asked for


def _frf_seconds(scene: Scene, frfs: Callable[[], PoleResidue]) -> float:
    lines = np.linspace(*scene.band, FRF_LINES)
    return _median(lambda: frfs().frf(lines)) if scene.places else 0.0


def _median(run: Callable[[], object], times: int = 25) -> float:
    """Return the median time of a call, s."""
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))
