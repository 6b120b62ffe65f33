# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads and writes measured natural frequencies as the targets of a calibration."""

import math
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from linkage_vibration.mechanics.keys import CheckedMapping
from linkage_vibration.mechanics.paths import number_at
from linkage_vibration.readers.mechanism import load_yaml

INCLINOMETER = math.radians(0.5)
"""Standard deviation of a measured angle, rad."""

_BOUNDS = 3.0  # from a number of the mechanism to its bounds in the calibration


HALVES = "vertical", "lateral"


class ModelMode(NamedTuple):
    """A mode of one half of a mechanism."""

    half: str
    rank: int  # from 0, ascending
    name: str = ""

    def __str__(self) -> str:
        """Return its number among the modes of its half, and its name if it has one."""
        number = f"{'lateral ' * (self.half == HALVES[1])}mode {self.rank + 1}"
        return f"{number} ({self.name})" if self.name else number


@dataclass(frozen=True, slots=True)
class Target:
    """A natural frequency that the mechanism is to have."""

    mode: int  # from 1, ascending
    at: float | str  # alpha3 in rad; or "lowest" or "highest" over the stroke
    frequency: float  # Hz
    deviation: float  # standard deviation, relative
    half: str = HALVES[0]  # among whose modes it counts

    def __str__(self) -> str:
        """Return the mode and where it is taken."""
        where = self.at if isinstance(self.at, str) else f"at {math.degrees(self.at):g} deg"
        return f"{ModelMode(self.half, self.mode - 1)} {where}"


def read_target(keys: CheckedMapping) -> Target:
    """Read a target from its keys."""
    at: float | str
    if "at_deg" in keys:
        at = math.radians(keys.number("at_deg"))
    else:
        at = keys.choice("over_the_stroke", ["lowest", "highest"])
    frequency = keys.number("hz", positive=True)
    deviation = keys.number("deviation", positive=True, default=0.01)
    half = keys.choice("half", HALVES, default=HALVES[0])
    return Target(keys.integer("mode"), at, frequency, deviation, half)


def targets_text(
    modes: Iterable[tuple[ModelMode, float, float, float]],
    mechanism: Path,
    output: Path,
    source: str,
) -> str:
    """Return the text of a calibration (written to output) of rigid bodies to measured modes.

    Each has the mode of the model, the angle in rad, Hz, and a relative standard deviation.
    """
    targets = [
        {
            **({"half": mode.half} if mode.half != HALVES[0] else {}),
            "mode": mode.rank + 1,
            "at_deg": round(math.degrees(alpha3), 6),
            "hz": float(f"{hertz:.7g}"),
            "deviation": float(f"{deviation:.3g}"),
        }
        for mode, alpha3, hertz, deviation in modes
    ]
    content = {
        "mechanism": os.path.relpath(mechanism, output.resolve().parent),
        "parameters": _rigid_numbers(load_yaml(mechanism)[0]),
        "targets": targets,
    }
    head = f"# Made from {source}. The parameters and their bounds are yours to choose.\n"
    return head + yaml.safe_dump(content, sort_keys=False)


def _rigid_numbers(mapping: dict[str, Any]) -> dict[str, list[float]]:
    """Return the masses and moments of inertia of the rigid bodies, with wide bounds."""
    bodies = mapping.get("rigid_bodies", {})
    paths = [f"rigid_bodies.{name}.{key}" for name in bodies for key in ("mass", "inertia")]
    numbers = {path: float(number_at(mapping, path)) for path in paths}
    return {path: [value / _BOUNDS, value * _BOUNDS] for path, value in numbers.items()}
