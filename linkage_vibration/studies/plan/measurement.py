# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures a plan against an unreduced, finer model, and presents it in words and as a file."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.studies.plan.choice import Plan, plan
from linkage_vibration.studies.plan.question import (
    PlanError,
    Result,
    Scene,
    prediction_seconds,
    result_at,
    table_errors,
    worst_errors,
)
from linkage_vibration.studies.yaml_editing import edit_text
from linkage_vibration.support.atomic_files import write_text
from linkage_vibration.table.table import Table
from linkage_vibration.table.tabulation import build_table

_ANGLES = (0.003, 0.13, 0.31, 0.56, 0.8, 0.997)  # of the range; a plan is chosen at others
_TRIES, _TIGHTER = 4, 0.9  # plans that are measured, and the part of the tolerance that is aimed at
_CHECKED = 41  # angles at which tables are compared with their own model
_FINER = 6  # elements of the reference, in elements of the plan ...
_FINEST = 96  # ... up to this number a link; beyond it, twice the plan's


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """The measured errors of a plan, and its times in seconds."""

    errors: FloatArray  # (3,), of the model, plus those of the table against it
    setup: float  # from the mechanism to the first prediction: kinematics, components, table
    prediction: float  # median for natural frequencies, damping ratios and the peak at an angle
    points: int  # angles in the table; 0 without a table


def plan_and_measure(
    scene: Scene, solved: Callable[[], object] = lambda: None
) -> tuple[Plan, Measured]:
    """Choose the cheapest settings whose measured errors meet a scene's tolerance.

    While the measured errors of a plan are too large, another one is made for a smaller tolerance.
    """
    share, why = 1.0, ""
    for _ in range(_TRIES):
        chosen = plan(replace(scene, tolerance=share * scene.tolerance), solved)
        measured = measure(chosen, solve_reference(chosen, solved))
        worst = scene.share(measured.errors)
        if worst <= 1.0:
            reasons = (*chosen.reasons, ("planned to a part of it", why)) if why else chosen.reasons
            return replace(chosen, scene=scene, reasons=reasons), measured
        share *= _TIGHTER / worst
        why = f"{share:.2g} x the tolerance, as a plan measured {worst:.3g} x the tolerance"
    raise PlanError(
        f"No plan meets a tolerance of {scene.tolerance:g} up to {scene.band[1]:g} Hz: the last of "
        f"{_TRIES} measured {worst:.2g} times as much; give a larger tolerance, or a lower band."
    )


def solve_reference(plan: Plan, solved: Callable[[], object] = lambda: None) -> list[Result]:
    """Solve an unreduced, finer model at angles other than those at which the plan was chosen.

    Its mesh is six times as fine, so its own error is at most a 36th of the plan's; above 96
    elements a link it is four times or twice as fine. Its matrices are dense: an angle of four
    links takes 0.25 s with 48 elements a link, 2 s with 96, and about 10 s with 192.
    """
    scene = plan.scene
    elements = max(2 * plan.elements, min(_FINER * plan.elements, _FINEST))
    mechanism = scene.with_settings(elements, 0, plan.n_modes)
    model = LinkageModel(mechanism, reduced=False)
    results = []
    for alpha3 in scene.angles_at(_ANGLES):
        results.append(result_at(scene, model, alpha3))
        solved()
    return results


def measure(plan: Plan, against: Sequence[Result]) -> Measured:
    """Carry a plan out, and measure its errors against a reference, and its times."""
    scene, start = plan.scene, time.perf_counter()
    model = LinkageModel(plan.mechanism)
    source: LinkageModel | Table = model
    if plan.table_tolerance is not None:
        source = build_table(model, plan.table_tolerance, scene.points)
        source.interpolate(scene.angles[0])  # the first lookup also prepares the table
    setup = time.perf_counter() - start
    errors = worst_errors([result_at(scene, model, exact.alpha3) for exact in against], against)
    points = 0
    if isinstance(source, Table):
        angles = scene.angles_at(np.arange(0.5, _CHECKED) / _CHECKED)
        errors += table_errors(source, [result_at(scene, model, alpha3) for alpha3 in angles])
        points = len(source.alpha3)
    return Measured(errors, setup, prediction_seconds(scene, source), points)


def plan_report(plan: Plan, measured: Measured) -> str:
    """Return what was chosen and why, and what was predicted, measured and allowed."""
    scene = plan.scene
    low, high = (math.degrees(angle) for angle in scene.angles)
    where = f"{low:g} deg" if scene.one_angle else f"{low:g} to {high:g} deg"
    lines = [
        f"{scene.mechanism.name}: {scene.band[0]:g} to {scene.band[1]:g} Hz, {where}, "
        f"tolerance {scene.tolerance:g}",
        "",
        *(f"{choice:34}{reason}" for choice, reason in plan.reasons),
        "",
        f"{'relative error':26}{'predicted':>12}{'measured':>12}{'allowed':>12}",
    ]
    errors = zip(plan.predicted, measured.errors, scene.allowed, strict=True)
    names = ("natural frequencies", "highest peak", "worst FRF")
    rows = 3 if scene.places else 2
    for name, values in list(zip(names, errors, strict=True))[:rows]:
        lines.append(f"{name:26}" + "".join(f"{value:12.1e}" for value in values))
    limit = scene.seconds_per_prediction
    allowed = f"{1e3 * limit:12.4g}" if math.isfinite(limit) else ""
    lines += [
        "",
        f"{'time [ms]':26}{'measured':>12}{'allowed':>12}",
        f"{'set-up':26}{1e3 * measured.setup:12.4g}",
        f"{'a prediction':26}{1e3 * measured.prediction:12.4g}{allowed}",
    ]
    if measured.points:
        lines.append(f"{'points of the table':26}{measured.points:12}")
    return "\n".join(lines)


def write_planned(plan: Plan, text: str, path: Path) -> None:
    """Write the text of a mechanism's file with a plan's settings; its comments and its order stay.

    A `PlanError` is raised if an alias in it makes one number of two that differ in the plan.
    """
    mechanism = plan.mechanism
    numbers: dict[tuple[str, ...], Sequence[float]] = {
        ("response", "band_hz"): mechanism.response.band,
        ("response", "modes"): [mechanism.response.modes],
    }
    if plan.scene.mechanism.response.peak_part is not None:
        numbers["response", "peak_band_hz"] = mechanism.response.peak_band
    for link in mechanism.links:
        numbers["links", link.name, "modes"] = [link.modes]
        if link.body.elements is not None:
            numbers["links", link.name, "elements"] = [link.body.elements]
    if not plan.scene.one_angle:
        numbers["input", "range_deg"] = [math.degrees(angle) for angle in mechanism.stroke]
    words = [(keys, list(map(repr, values))) for keys, values in numbers.items()]
    write_text(path, edit_text(text, words, PlanError), PlanError)
