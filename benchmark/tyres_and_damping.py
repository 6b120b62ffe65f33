# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures what tyres, oil and pins change: ``python -m benchmark tyres_and_damping``."""

import copy
import math
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.special import k1

from benchmark.report import machine, publish, table
from linkage_vibration.mechanics.ground_motion import transmissibility
from linkage_vibration.mechanics.model import LinkageModel, Solution
from linkage_vibration.mechanics.parsing import mechanism_from_mapping
from linkage_vibration.support.resources import config_file
from test.support.in_plane import IN_PLANE, in_plane

NAME = "three_point_linkage_on_tractor"
ANGLES = (90.0, 135.0, 180.0)
PITCH, BOUNCE, HEAVE = 0, 2, 3  # modes
SPEED = 20.0 / 3.6  # m/s
ROUGHNESS = 256e-6  # m3 at 0.1 1/m: class C of ISO 8608, with the exponent 2
LINES = np.geomspace(0.3, 20.0, 4097)  # Hz

# Tyres of the rear and the front axle, two of each: width and rim in inches.
SIZES = {
    "16.9R38 and 13.6R28": ((16.9, 38.0), (13.6, 28.0)),
    "18.4R38 and 14.9R28": ((18.4, 38.0), (14.9, 28.0)),
}
PRESSURES = (0.8e5, 1.2e5, 1.6e5)  # Pa

LINKS_ONLY = {"rule": "modal_ratio", "ratio": 0.01}
OIL, PIN = 0.1, 20.0  # loss factor at 6 Hz; N m s/rad
PINS = ("P1", "P2", "E1", "E2")


def tyred(mapping: dict[str, Any], size: str, pressure: float, age: float) -> dict[str, Any]:
    """Return a description whose axles stand on tyres of a size, a pressure (Pa) and an age."""
    changed = copy.deepcopy(mapping)
    for mount, (width, rim) in zip(changed["base"]["mounts"].values(), SIZES[size], strict=True):
        mount["stiffness_x"] = mount.pop("stiffness")[0]
        mount["tyre"] = {
            "width_in": width,
            "rim_in": rim,
            "age_years": age,
            "pressure": pressure,
            "count": 2,
        }
    return changed


def damped(
    mapping: dict[str, Any], rule: dict[str, Any] | None, oil: float, pin: float
) -> dict[str, Any]:
    """Return a description with other dampings of links, oil (1) and pins (N m s/rad)."""
    changed = copy.deepcopy(mapping)
    changed["damping"] = rule or changed["damping"]
    if oil:
        changed["springs"]["lift_cylinders"]["loss_factor"] = {"factor": oil, "at_hz": 6.0}
    for name in PINS if pin else ():
        changed["springs"][f"pin_{name}"] = {"joint": name, "damping": pin}
    return changed


def ground_level(solution: Solution) -> float:
    """Return the velocity of E1 along z on the ground, m/s rms, both axles with their delay."""
    mechanism = solution.model.mechanism
    assert mechanism.base is not None
    omega, followed = 2.0 * math.pi * LINES, np.zeros(len(LINES), dtype=complex)
    for mount in mechanism.base.mounts:
        each = transmissibility(solution, [("E1", "z")], (f"base:{mount.name}", "z"))
        followed += each.frf(LINES)[:, 0, 0] * np.exp(1j * omega * mount.at[0] / SPEED)
    [track] = {mount.track for mount in mechanism.base.mounts}
    x = 2.0 * math.pi * LINES / SPEED * track
    profile = ROUGHNESS * (LINES / SPEED / 0.1) ** -2 / SPEED * (1.0 + x * k1(x)) / 2.0
    return float(np.sqrt(np.trapezoid(np.abs(omega * followed) ** 2 * profile, LINES)))


def solutions(mapping: dict[str, Any]) -> list[Solution]:
    """Return the solutions of a description at the angles."""
    model = LinkageModel(mechanism_from_mapping(mapping))
    return [model.solve(math.radians(angle)) for angle in ANGLES]


def levels(result: list[Solution]) -> NDArray[np.float64]:
    """Return `ground_level` and the peak of the receptance above 4.7 Hz, (2, n_angles)."""
    band = result[0].model.mechanism.response.peak_band
    return np.array([[ground_level(s) for s in result], [s.peak(band).magnitude for s in result]])


def tyre_rows(mapping: dict[str, Any]) -> list[list[str]]:
    """Return natural frequencies in Hz at the middle angle, and the level there, by tyre."""
    cases = [("as shipped", mapping)]
    for size in SIZES:
        for pressure in PRESSURES:
            label = f"{size}, {pressure / 1e5:.1f} bar, new"
            cases.append((label, tyred(mapping, size, pressure, 0.0)))
    size, pressure = "16.9R38 and 13.6R28", PRESSURES[1]
    aged = f"{size}, {pressure / 1e5:.1f} bar, 10 years"
    cases.append((aged, tyred(mapping, size, pressure, 10.0)))
    rows = []
    for label, case in cases:
        result = solutions(case)[1]
        base = result.model.mechanism.base
        assert base is not None
        rear, front = (mount.stiffness[1] / 1e3 for mount in base.mounts)
        hertz = result.natural_frequencies[[PITCH, BOUNCE, HEAVE]]
        level = f"{1e3 * ground_level(result):.0f}"
        rows.append([label, f"{rear:.0f}", f"{front:.0f}", *(f"{f:.2f}" for f in hertz), level])
    return rows


def damping_rows(mapping: dict[str, Any]) -> list[list[str]]:
    """Return damping ratios and changes of levels at the angles, by where energy is lost."""
    half = {**mapping["damping"], "ratio": mapping["damping"]["ratio"] / 2.0}
    cases = {
        "as shipped: Rayleigh": (None, 0.0, 0.0),
        "half of it": (half, 0.0, 0.0),
        f"it, and oil with {OIL:g}": (None, OIL, 0.0),
        "links only, 1 % of each mode": (LINKS_ONLY, 0.0, 0.0),
        f"links, oil with {OIL / 2:g}": (LINKS_ONLY, OIL / 2.0, 0.0),
        f"links, oil with {OIL:g}": (LINKS_ONLY, OIL, 0.0),
        f"links, oil with {2 * OIL:g}": (LINKS_ONLY, 2.0 * OIL, 0.0),
        f"links, oil with {OIL:g}, pins with {PIN:g} N m s/rad": (LINKS_ONLY, OIL, PIN),
    }
    rows, before = [], None
    for label, case in cases.items():
        result = solutions(damped(mapping, *case))
        ratios = 100.0 * np.array([s.damping_ratios[[PITCH, HEAVE]] for s in result]).T
        now = levels(result)
        before = now if before is None else before
        change = 100.0 * (now / before - 1.0)
        cells = [" ".join(f"{value:.1f}" for value in row) for row in ratios]
        cells += [" ".join(f"{value:+.0f}" for value in row) for row in (change[0], change[1, 1:])]
        rows.append([label, *cells])
    return rows


def main() -> None:
    """Compare, and write the page."""
    mapping = in_plane(yaml.safe_load(config_file(f"{NAME}.yaml").read_text(encoding="utf-8")))
    del mapping["uncertainty"]
    speed = f"{3.6 * SPEED:.0f} km/h on class C"
    publish(
        "tyres_and_damping",
        "Tyres and damping",
        [
            f"This page shows what tyres, oil and pins change in `{NAME}`.",
            IN_PLANE,
            "## Tyres",
            "The vertical stiffness of two tyres on each axle by their size, pressure and age, "
            f"natural frequencies at {ANGLES[1]:.0f} deg, and the velocity of E1 along z at "
            f"{speed} there.",
            table(
                [
                    "tyres",
                    "rear, kN/m",
                    "front, kN/m",
                    "pitch, Hz",
                    "bounce, Hz",
                    "heave, Hz",
                    "E1, mm/s",
                ],
                tyre_rows(mapping),
            ),
            "## Damping",
            "Damping ratios of the tractor's pitch and of the implement's heave, in %, at "
            f"{', '.join(f'{angle:.0f}' for angle in ANGLES)} deg, and the changes, in %, of the "
            f"velocity of E1 along z at {speed} and of the peak of its receptance above 4.7 Hz "
            f"(not at {ANGLES[0]:.0f} deg, where the tractor's response hides it). The numbers of "
            "oil are loss factors at 6 Hz, and pins are P1, P2, E1 and E2. Nothing here was "
            "measured: the numbers show what an assumption changes.",
            table(["damping", "pitch", "heave", "velocity", "peak"], damping_rows(mapping)),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
