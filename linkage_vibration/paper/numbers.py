# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every number that the paper prints, with the place where it stands.

G. Brunetti, W. D'Ambrogio, A. Fregolent, "Configuration-Dependent Substructuring as a Tool to
Predict the Vibrational Response of Mechanisms", Machines 2022, 10(12), 1146. It prints neither
cross-sections nor damping.
"""

from dataclasses import dataclass

SOURCE = "Brunetti, D'Ambrogio, Fregolent, Machines 2022, 10(12), 1146"


@dataclass(frozen=True, slots=True)
class Number:
    """One printed number.

    Attributes
    ----------
    key : str
        Names it; ours carry the same.
    quantity : str
        What it tells, in words.
    value : float
        As printed.
    unit : str
        Of the value; empty for counts and ratios.
    source : str
        Table or section of the paper.
    """

    key: str
    quantity: str
    value: float
    unit: str
    source: str


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


GEOMETRY = (
    Number("geometry.P1.x", "P1, x", 0.000, "m", "Table 1"),
    Number("geometry.P1.z", "P1, z", 0.000, "m", "Table 1"),
    Number("geometry.P2.x", "P2, x", -0.334, "m", "Table 1"),
    Number("geometry.P2.z", "P2, z", 0.403, "m", "Table 1"),
    Number("geometry.P3.x", "P3, x", -0.064, "m", "Table 1"),
    Number("geometry.P3.z", "P3, z", 0.385, "m", "Table 1"),
    Number("geometry.P3_V2", "P3 to V2, input crank", 0.203, "m", "Table 1"),
    Number("geometry.V2_V1", "V2 to V1, lift rod", 0.534, "m", "Table 1"),
    Number("geometry.P1_E1", "P1 to E1, lower link", 0.810, "m", "Table 1"),
    Number("geometry.P1_V1", "P1 to V1", 0.366, "m", "Table 1"),
    Number("geometry.P2_E2", "P2 to E2, upper link", 0.420, "m", "Table 1"),
    Number("geometry.E1_E2", "E1 to E2, mast of the implement", 0.438, "m", "Table 1"),
    Number("geometry.E1_M", "E1 to M", 1.020, "m", "Table 1"),
    Number("geometry.E2_M", "E2 to M", 1.095, "m", "Table 1"),
    Number("geometry.implement_mass", "mass of the implement", 800.0, "kg", "Table 1"),
    Number("geometry.implement_inertia", "its inertia about M", 200.0, "kg m2", "Table 1"),
    Number("geometry.youngs_modulus", "Young's modulus", 210.0e9, "Pa", "Table 1"),
    Number("geometry.density", "density", 7800.0, "kg/m3", "Table 1"),
    Number("geometry.poisson_ratio", "Poisson's ratio", 0.3, "", "Table 1"),
)

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
FITTED = (*SUBSTRUCTURING, *OVER_THE_SWEEP)
"""The nine natural frequencies that a choice of sections has to meet."""
