# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Refuses FRFs without passivity or reciprocity, or with another mass than the link has.

Nothing is corrected. A check whose lines are missing passes: the mass, and signs where no line is
near a resonance, need lines below the first resonance of the link.
"""

import math
from collections.abc import Mapping

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.description import Point
from linkage_vibration.mechanics.dofs import Dofs, InterfaceDof
from linkage_vibration.mechanics.mass_lines import MassLines, find_mass_lines, shown_mass
from linkage_vibration.mechanics.regularisation import noise_level
from linkage_vibration.readers.component_files import FileError

_RECIPROCITY = 0.8  # |H_ij - H_ji| / |H_ij + H_ji|; 1 if they are unrelated
_COUPLED = 0.2  # share of the two drive points, below which an FRF may be pure noise
_UNEQUAL = 0.1  # mean relative difference of H_ij and H_ji over all lines, where noise averages out
_LOSS = 0.3  # share of a line, and of the median line, that is imaginary near a resonance
_LAG = 0.02  # rad: mean phase error of a good measurement
_MASSES = (0.02, 1e6)  # kg: least and greatest plausible median of an apparent mass
_WEIGHED = 0.2  # relative difference of a mass by its FRFs and by its scale


def check_faults(frfs: Frfs, points: Mapping[str, Point] | None, mass: float | None) -> None:
    """Refuse FRFs that no free, passive link with these points (x, z), m, and mass, kg, has."""
    moving = frfs.frequencies > 0.0
    frequencies, frf = frfs.frequencies[moving], frfs.frf[moving]
    # Accelerances have about the same noise at every frequency.
    accelerance = (2.0 * math.pi * frequencies[:, np.newaxis, np.newaxis]) ** 2 * frf
    for j, dof in enumerate(frfs.dofs):
        if not accelerance[:, j, j].any():
            raise FileError(f"the FRF of {name_frf(dof, dof)} is zero; measure it again.")
    if mass is None:
        _check_plausible_mass(frfs.dofs, accelerance)
    lines = find_mass_lines(frequencies, frf)
    wrong = _gives_power(accelerance, noise_level(frequencies, frf))
    if lines is not None:
        wrong |= np.diag(lines.accelerance) < 0.0
    if wrong.any():
        names = ", ".join(str(dof) for dof, bad in zip(frfs.dofs, wrong, strict=True) if bad)
        raise FileError(
            f"the drive point {names} gives out power, or moves with the force below the first "
            "resonance; change the sign of the sensor or of the force there. If these are all "
            "points, all signs may be reversed, or the FRFs belong to "
            "exp(-i omega t) (take the complex conjugates of all)."
        )
    _check_reciprocity(frfs.dofs, accelerance)
    if points is not None and mass is not None and lines is not None:
        _check_mass(frfs.dofs, lines, points, mass)


def _gives_power(accelerance: ComplexArray, noise: float) -> BoolArray:
    """Return at which drive points a link gives out power, (n,): imag(receptance) > 0.

    Lines near resonances show this whatever the errors of phase. Without such lines, the mean
    phase must exceed what a good measurement may have; computed FRFs have no such error.
    """
    drive = np.einsum("kii->ki", accelerance)
    size = np.maximum(np.abs(drive), np.finfo(float).tiny)
    near = np.abs(drive.imag) > _LOSS * np.maximum(size, np.median(size, axis=0))
    lost = np.where(near, drive.imag, 0.0)
    share = lost.sum(axis=0) / np.maximum(np.abs(lost).sum(axis=0), np.finfo(float).tiny)
    lag = (drive.imag / size).mean(axis=0) / min(_LAG, 100.0 * noise + 1e-9)
    return np.asarray(np.where(near.any(axis=0), 2.0 * share, lag) > 1.0)


def _check_plausible_mass(dofs: Dofs, accelerance: ComplexArray) -> None:
    """Refuse apparent masses of drive points that no link has, as it was not weighed."""
    for j, dof in enumerate(dofs):
        mass = 1.0 / max(float(np.median(np.abs(accelerance[:, j, j]))), 1e-300)
        if dof.direction != "theta" and not _MASSES[0] < mass < _MASSES[1]:
            light = "mm/N or um/N, an acceleration, or over rad/s"
            unit = light if mass <= _MASSES[0] else "m/kN"
            problem = f"belongs to a mass of {mass:.2g} kg, which no link has"
            hint = f"convert it to m/N over Hz if it is in {unit}"
            raise FileError(f"the FRF of {name_frf(dof, dof)} {problem}; {hint}.")


def _check_reciprocity(dofs: Dofs, accelerance: ComplexArray) -> None:
    sizes = np.linalg.norm(np.diagonal(accelerance, axis1=1, axis2=2), axis=0)
    for i, response in enumerate(dofs):
        for j, reference in enumerate(dofs[:i]):
            there, back = accelerance[:, i, j], accelerance[:, j, i]
            odd, even = (float(np.linalg.norm(v)) for v in (there - back, there + back))
            noise = _COUPLED * math.sqrt(sizes[i] * sizes[j])
            unequal = 2.0 * abs(np.vdot(there + back, there - back)) / max(even**2, 1e-300)
            related = odd <= max(_RECIPROCITY * even, noise)
            if not related or (even > noise and unequal > _UNEQUAL):
                how = f"differ by {100.0 * unequal:.0f} % on average"
                both = f"the FRF of {name_frf(response, reference)} and its reverse"
                problem = f"{both} {how if related else 'are unrelated'} but should be equal"
                hint = "look for a wrong direction, sign, unit or gain, or measure them again"
                raise FileError(f"{problem}; {hint}.")


def _check_mass(dofs: Dofs, lines: MassLines, points: Mapping[str, Point], mass: float) -> None:
    """Refuse FRFs of a planar rigid body with these points that has another mass, kg."""
    weighed = shown_mass(dofs, lines, points)
    if weighed is None:
        return
    shown, misfit = weighed
    if abs(math.log(shown / mass)) > _WEIGHED + 2.0 * misfit:
        raise FileError(
            f"the FRFs show a mass of {shown:.3g} kg between {lines.first:.3g} and "
            f"{lines.last:.3g} Hz, {shown / mass:.3g} times the {mass:g} kg that `mass` gives; "
            "export receptances in m/N over Hz, or correct `mass` (of one of the equal links)."
        )


def name_frf(response: InterfaceDof, reference: InterfaceDof) -> str:
    """Name an FRF in an error by the DoFs of the motion and of the force."""
    return f"response {response} to a force at {reference}"
