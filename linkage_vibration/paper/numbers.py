# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every number that the paper prints, with its place in the paper.

G. Brunetti, W. D'Ambrogio, A. Fregolent, "Configuration-Dependent Substructuring as a Tool to
Predict the Vibrational Response of Mechanisms", Machines 2022, 10(12), 1146. It prints neither
cross-sections nor damping.
"""

from dataclasses import dataclass

from linkage_vibration.mechanics.arrays import FloatArray

SOURCE = "Brunetti, D'Ambrogio, Fregolent, Machines 2022, 10(12), 1146"


@dataclass(frozen=True, slots=True)
class Number:
    """One printed number."""

    key: str  # our number has the same key
    quantity: str
    value: float  # as printed
    unit: str  # empty for counts and ratios
    source: str  # table or section of the paper


def _frequencies(key: str, quantity: str, values: tuple[float, float, float]) -> tuple[Number, ...]:
    return tuple(
        Number(f"{key}.{mode}", f"mode {mode} at 140 deg, {quantity}", value, "Hz", "Table 3")
        for mode, value in enumerate(values, 1)
    )


def _dofs(key: str, name: str, physical: int, modal: int) -> tuple[Number, Number]:
    return (
        Number(f"reduction.{key}.physical", f"{name}: physical DoFs", physical, "", "Table 2"),
        Number(f"reduction.{key}.modal", f"{name}: modal DoFs", modal, "", "Table 2"),
    )


_IMPLEMENT, _MATERIAL = "rigid_bodies.implement", "links.lower_link.material"
# Each number of Table 1, with its place in the description of a linkage.
_TABLE_1 = (
    ("P1.x", "P1, x", 0.000, "m", "ground.P1.0"),
    ("P1.z", "P1, z", 0.000, "m", "ground.P1.1"),
    ("P2.x", "P2, x", -0.334, "m", "ground.P2.0"),
    ("P2.z", "P2, z", 0.403, "m", "ground.P2.1"),
    ("P3.x", "P3, x", -0.064, "m", "ground.P3.0"),
    ("P3.z", "P3, z", 0.385, "m", "ground.P3.1"),
    ("P3_V2", "P3 to V2, input crank", 0.203, "m", "links.input_crank.points.V2"),
    ("V2_V1", "V2 to V1, lift rod", 0.534, "m", "links.lift_rod.points.V1"),
    ("P1_E1", "P1 to E1, lower link", 0.810, "m", "links.lower_link.points.E1"),
    ("P1_V1", "P1 to V1", 0.366, "m", "links.lower_link.points.V1"),
    ("P2_E2", "P2 to E2, upper link", 0.420, "m", "links.upper_link.points.E2"),
    ("E1_E2", "E1 to E2, mast of the implement", 0.438, "m", f"{_IMPLEMENT}.points.E2.0"),
    ("E1_M", "E1 to M", 1.020, "m", f"{_IMPLEMENT}.centre_of_gravity.E1"),
    ("E2_M", "E2 to M", 1.095, "m", f"{_IMPLEMENT}.centre_of_gravity.E2"),
    ("implement_mass", "mass of the implement", 800.0, "kg", f"{_IMPLEMENT}.mass"),
    ("implement_inertia", "its inertia about M", 200.0, "kg m2", f"{_IMPLEMENT}.inertia"),
    ("youngs_modulus", "Young's modulus", 210.0e9, "Pa", f"{_MATERIAL}.youngs_modulus"),
    ("density", "density", 7800.0, "kg/m3", f"{_MATERIAL}.density"),
    ("poisson_ratio", "Poisson's ratio", 0.3, "", f"{_MATERIAL}.poisson_ratio"),
)
GEOMETRY = tuple(
    Number(f"geometry.{key}", quantity, value, unit, "Table 1")
    for key, quantity, value, unit, _ in _TABLE_1
)
PLACES = {f"geometry.{key}": place for key, *_, place in _TABLE_1}

REDUCTION = (
    *_dofs("lower_links", "lower link", 9, 20),
    *_dofs("upper_link", "upper link", 6, 20),
    *_dofs("input_cranks", "input crank", 6, 20),
    *_dofs("lift_rods", "lift rod", 6, 20),
    *_dofs("implement", "implement", 3, 0),
)

SWEEP = (
    Number("sweep.start_deg", "stroke, from", 90.0, "deg", "section 5"),
    Number("sweep.stop_deg", "stroke, to", 180.0, "deg", "section 5"),
    Number("sweep.step_deg", "stroke, step", 2.0, "deg", "section 5"),
    Number("band_hz.0", "band, from", 0.0, "Hz", "section 5"),
    Number("band_hz.1", "band, to", 200.0, "Hz", "section 5"),
)

FULL_FE = _frequencies("natural_frequencies_hz.at_140_deg.full_fe", "full FE", (4.2, 97.5, 176.9))
SUBSTRUCTURING = _frequencies(
    "natural_frequencies_hz.at_140_deg.substructuring", "substructuring", (4.3, 94.9, 170.6)
)

_OVER = "natural_frequencies_hz.over_the_sweep"
OVER_THE_SWEEP = (
    Number(f"{_OVER}.mode_1.0", "mode 1, increases from (90 deg)", 2.9, "Hz", "section 5"),
    Number(f"{_OVER}.mode_1.1", "mode 1, increases to (180 deg)", 6.4, "Hz", "section 5"),
    Number(f"{_OVER}.mode_2.0", "mode 2, decreases from (90 deg)", 105.9, "Hz", "section 5"),
    Number(f"{_OVER}.mode_2.1", "mode 2, decreases to (180 deg)", 57.8, "Hz", "section 5"),
    Number(f"{_OVER}.mode_3.0", "mode 3, lowest over the stroke", 152.8, "Hz", "section 5"),
    Number(f"{_OVER}.mode_3.1", "mode 3, highest over the stroke", 191.0, "Hz", "section 5"),
)

TIMING = (
    Number("timing_s.craig_bampton_reduction", "reduction", 226.0, "s", "section 5"),
    Number("timing_s.substructuring_frf", "FRFs by substructuring", 33.0, "s", "section 5"),
    Number("timing_s.full_fe_eigen", "full FE, modes", 6113.0, "s", "section 5"),
    Number("timing_s.full_fe_frf", "full FE, FRFs", 89240.0, "s", "section 5"),
    Number("timing_s.speed_up", "full FE over substructuring", 368.0, "", "section 5"),
)

NUMBERS = (*GEOMETRY, *REDUCTION, *SWEEP, *FULL_FE, *SUBSTRUCTURING, *OVER_THE_SWEEP, *TIMING)


def frequencies(over: FloatArray, at_140: FloatArray) -> dict[str, float]:
    """Return natural frequencies in Hz, (n, 3) over the stroke and at 140 deg, by printed keys."""
    ends = [*over[[0, -1], 0], *over[[0, -1], 1], over[:, 2].min(), over[:, 2].max()]
    numbers = (*FULL_FE, *SUBSTRUCTURING, *OVER_THE_SWEEP)
    pairs = zip(numbers, [*at_140[:3], *at_140[:3], *ends], strict=True)
    return {number.key: float(value) for number, value in pairs}
