# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Presents a plan: in words, and as the mechanism's file with the plan's settings."""

import math
from collections.abc import Sequence
from pathlib import Path

from linkage_vibration.studies.plan.choice import Plan
from linkage_vibration.studies.plan.measurement import Measured
from linkage_vibration.studies.plan.results import FRF_LINES
from linkage_vibration.studies.plan.scene import PlanError
from linkage_vibration.studies.yaml_editing import edit_text
from linkage_vibration.support.atomic_files import write_text


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
    allowed = "" if limit is None else f"{1e3 * limit:12.4g}"
    lines += [
        "",
        f"{'time [ms]':26}{'measured':>12}{'allowed':>12}",
        f"{'set-up':26}{1e3 * measured.setup:12.4g}",
        f"{'a prediction':26}{1e3 * measured.prediction:12.4g}{allowed}",
    ]
    if scene.places:
        lines.append(f"{f'FRFs, {FRF_LINES} lines':26}{1e3 * measured.frfs:12.4g}")
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
