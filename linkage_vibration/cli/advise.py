# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Advise at which height and ground speed the linkage would be loaded less than now."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from linkage_vibration.cli.arguments import (
    add_implement_mass,
    add_mechanism,
    read_levels,
    read_settings,
)

if TYPE_CHECKING:
    from linkage_vibration.prediction.advice import Advice

_PLACES = "now", "quietest height", "quietest speed", "quietest both"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add = parser.add_argument
    add("angle_deg", type=float, help="present crank angle alpha3 in degrees")
    add("speed_kmh", type=float, help="present ground speed in km/h")
    ends: dict[str, Any] = {"nargs": 2, "type": float, "metavar": ("LOW", "HIGH")}
    add("--angles-deg", **ends, help="permitted crank angles (default: all of the table)")
    add("--speeds-kmh", **ends, help="permitted ground speeds (default: the present one alone)")
    for name in ("engine", "pto"):
        text = f"present {name} speed in rpm, which stays as it is (default: not known)"
        add(f"--{name}-rpm", type=float, default=math.nan, help=text)
    add_mechanism(parser)
    add_implement_mass(parser)
    add("--excitations", type=Path, help="YAML file (default: the shipped excitations)")
    add("--csv", type=Path, help="CSV file of the map to write")


def run(options: argparse.Namespace) -> int:
    """Print the advice, and write the map; return 1 if the present load is not known."""
    import numpy as np

    from linkage_vibration.prediction.advice import NOW, Question, advise
    from linkage_vibration.prediction.doubts import load_ratio_doubt
    from linkage_vibration.prediction.excitation import KMH, Source
    from linkage_vibration.prediction.worst_levels import WorstLevels
    from linkage_vibration.studies.crossings import crossing_table, crossing_text, find_crossings
    from linkage_vibration.support.atomic_files import OutputError, check_output, write_text

    check_output(options.csv, ".csv", list(filter(None, (options.mechanism, options.excitations))))
    settings = read_settings(options, excitation_file=options.excitations)
    _, excitations, every = read_levels(settings, options.implement_mass)
    levels, limit = WorstLevels(every), settings.warning_limits().warning
    angles, speeds = options.angles_deg, options.speeds_kmh
    question = Question(
        math.radians(options.angle_deg),
        np.array([options.engine_rpm, options.pto_rpm, abs(options.speed_kmh) / KMH]),
        angles and (math.radians(angles[0]), math.radians(angles[1])),
        speeds and (speeds[0] / KMH, speeds[1] / KMH),
    )
    advice = advise(levels, excitations, question, limit=limit)
    at = np.tile(question.speeds[:, np.newaxis], len(_PLACES))
    at[Source.GROUND.index] = advice.message.ground_speeds
    print(_described(advice, levels.masses(advice.message.crank_angles, at)))
    pairs = [(speed, speed) for speed in question.speeds.tolist()]
    pairs[Source.GROUND.index] = question.ground_speeds or pairs[Source.GROUND.index]
    permitted = dict(zip(Source, pairs, strict=True))
    ends = question.crank_angles or levels.alpha3_range
    crossings = find_crossings(every, excitations, ends, permitted, limit)
    print(crossing_text(*crossing_table(crossings, permitted, ends, every[0].unknown_factors)))
    if doubt := load_ratio_doubt(advice.message.load_ratios[NOW], "now"):
        print(doubt)
    if options.csv:
        write_text(options.csv, _csv(advice), OutputError)
        print(f"Written: {options.csv}")
    return 1 if math.isnan(advice.message.load_ratios[NOW]) else 0


def _described(advice: "Advice", masses: Sequence[str]) -> str:
    """Return advice as lines: a row for each quieter place, with its mass if there are several."""
    import numpy as np

    from linkage_vibration.prediction.advice import NOW, is_quieter
    from linkage_vibration.prediction.excitation import KMH

    of, head = advice.message, ["angle [deg]", "speed [km/h]", "load ratio", "factor"]
    head += ["velocity [mm/s]", "factor", "quieter than now [%]"]
    levels = [of.load_ratios, of.load_ratio_factors, 1e3 * of.velocities, of.velocity_factors]
    columns = [np.degrees(of.crank_angles), KMH * of.ground_speeds, *levels]
    rows = np.transpose([*columns, 100.0 * of.probabilities]).tolist()
    titles = [*head, "mass [kg]"] if any(masses) else head
    lines = [" " * 16 + "".join(f"{name:>{len(name) + 2}}" for name in titles)]
    unknown, quieter = bool(np.isnan(of.load_ratios[NOW])), is_quieter(of)
    for place, name in enumerate(_PLACES):
        if place == NOW or unknown or quieter[place]:
            cells = ["unknown" if math.isnan(v) else f"{v:.4g}" for v in rows[place]]
            mass = "" if math.isnan(of.load_ratios[place]) else masses[place]
            cells[-1:] = [cells[-1] if place != NOW else "", mass]
            cells = [f"{v:>{len(title) + 2}}" for title, v in zip(titles, cells, strict=False)]
            lines.append(f"{name:16}{''.join(cells)}".rstrip())
        else:
            why = "nothing permitted has a smaller load that is known"
            if of.load_ratios[place] < of.load_ratios[NOW]:
                angle, speed, *_, probability = rows[place]
                why = f"the smallest load, at {angle:.4g} deg and {speed:.4g} km/h, is larger than "
                why += f"now with a probability of {100.0 - probability:.0f} %"
            lines.append(f"{name:16}  none: {why}")
    lines.append(of.sentence)
    if of.not_counted:
        lines.append(f"Not counted, as their loads are not known: {of.not_counted}.")
    counts = np.bincount(advice.reasons.ravel(), minlength=len(advice.reason_texts))
    for text, count in list(zip(advice.reason_texts, counts.tolist(), strict=True))[1:]:
        if count:
            lines.append(f"Refused for {count} of {advice.reasons.size} cells: {text}")
    return "\n".join(lines)


def _csv(advice: "Advice") -> str:
    """Return the map as CSV, with a line for each height and speed."""
    import numpy as np

    from linkage_vibration.messages.csv_tables import table_text

    angles, speeds = np.meshgrid(advice.crank_angles, advice.ground_speeds, indexing="ij")
    columns = {"crank_angle_rad": angles, "ground_speed_m_per_s": speeds}
    columns |= {"load_ratio": advice.load_ratios, "velocity_m_per_s": advice.velocities}
    columns["reason"] = np.array(advice.reason_texts)[advice.reasons]
    return table_text({name: values.ravel() for name, values in columns.items()})
