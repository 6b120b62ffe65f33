# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of a measurement that FRFs reveal: signs, units, missing phases, the time convention.

A fault is refused and its cause is named; nothing is corrected. A check whose lines are missing
passes: mass and signs need lines below the first resonance of the link.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray
from linkage_vibration.mechanics.bodies.frfs import Frfs
from linkage_vibration.mechanics.description import Point
from linkage_vibration.mechanics.dofs import InterfaceDof
from linkage_vibration.mechanics.mass_lines import (
    MassLines,
    find_mass_lines,
    fit_rigid_body,
    least_sound_speed,
    reversed_dofs,
)
from linkage_vibration.mechanics.regularisation import noise_level, rigid_motions
from linkage_vibration.readers.component_files import FileError

_RECIPROCITY = 0.8  # |H_ij - H_ji| / |H_ij + H_ji|; 1 if they are unrelated
_COUPLED = 0.2  # share of the two drive points, below which an FRF may be pure noise
_UNEQUAL = 0.1  # mean relative difference of H_ij and H_ji over all lines, where noise averages out
_MASSES = (0.02, 1e6)  # kg, least and greatest plausible median of the apparent mass; the least is
# a share of the mass on a scale if that is below 1 kg
_LOSS = 0.3  # least imaginary part of a line near a resonance, of the line and of the median line
_LAG = 0.02  # rad: mean phase error of a good measurement
_WEIGHED = 0.2  # relative difference of a mass by its FRFs and by its scale
_FASTEST = 13e3  # m/s; beryllium: 12.9e3
_ON_AXIS = 1e-9  # m
_LBF, _G, _INCH = 4.4482216, 9.80665, 0.0254
_FACTORS = {
    _G: "accelerations were in g (9.81 m/s2)",
    1.0 / _LBF: "forces were in lbf (4.45 N)",
    _G / _LBF: "accelerations were in g and forces in lbf",
    1.0 / 39.4: "frequencies were in rad/s, or lengths in inches",
    1.0 / (2.0 * math.pi): "frequencies were in rad/s",
    _INCH / _LBF: "lengths were in inches and forces in lbf",
    1e-3: "lengths were in mm",
    1e3: "forces were in kN",
}
"""Faults of units, by the ratio of the mass that the FRFs show to the mass on a scale."""


def check_faults(frfs: Frfs, points: Mapping[str, Point] | None, mass: float | None) -> None:
    """Refuse FRFs that no free, passive link has in SI units.

    Parameters
    ----------
    frfs : Frfs
        One of the equal links, finite values.
    points : mapping of str to (x, z), optional
        The points of the link, m.
    mass : float, optional
        Of the link on a scale, kg.

    Raises
    ------
    FileError
        If a drive point is zero, gives out power or has an implausible mass; if phases are
        missing; if signs, units or frequencies are wrong; if H_ij and H_ji differ.
    """
    moving = frfs.frequencies > 0.0
    frequencies, frf = frfs.frequencies[moving], frfs.frf[moving]
    # Accelerances have about the same noise at every frequency.
    accelerance = (2.0 * math.pi * frequencies[:, np.newaxis, np.newaxis]) ** 2 * frf
    _check_phases(frfs.dofs, accelerance)
    _check_frequencies(frequencies)
    lines = find_mass_lines(frequencies, frf)
    if mass is None or lines is None:
        _check_plausible_mass(frfs.dofs, accelerance, mass)
    _check_signs(frfs.dofs, lines)
    noise = noise_level(frequencies, frf) if len(frequencies) > 3 else math.inf
    _check_power(frfs.dofs, accelerance, noise, lines)
    _check_reciprocity(frfs.dofs, accelerance)
    if points is not None:
        _check_rigid_body(frfs.dofs, frequencies, frf, lines, points, mass)


def _check_phases(dofs: Sequence[InterfaceDof], accelerance: ComplexArray) -> None:
    """Refuse zeros and magnitudes: one phase everywhere, though drive points rise with frequency.

    The accelerance of an undamped drive point that keeps its sign can only fall.
    """
    drive = np.abs(np.einsum("kii->ki", accelerance))
    for j, dof in enumerate(dofs):
        if not drive[:, j].any():
            raise FileError(f"the FRF of {name_frf(dof, dof)} is zero; measure it again.")
    size = np.abs(accelerance)
    phases = accelerance[size > 1e-9 * size.max()]
    phases = phases / np.abs(phases)
    rises = (np.diff(drive, axis=0) > 1e-9 * drive[:-1]).any()
    if rises and (np.abs(phases - phases[0]) < 1e-9).all():
        raise FileError(
            "all FRFs have the same phase at every line, as if they were magnitudes; export real "
            "and imaginary parts."
        )


def _check_frequencies(frequencies: FloatArray) -> None:
    """Refuse a first and a last line that are round numbers times 2 pi, but not round in Hz."""
    ends = float(frequencies[0]), float(frequencies[-1])
    if any(_is_round(end, 5, 1e-9) for end in ends):
        return
    # UFF files hold the step in six digits.
    digits, tolerance = (2, 5e-6) if _is_round(ends[0], 6, 1e-12) else (5, 1e-9)
    if all(_is_round(end / (2.0 * math.pi), digits, tolerance) for end in ends):
        raise FileError(
            f"the frequencies, {ends[0]:g} to {ends[1]:g} Hz, are 2 pi times "
            f"{ends[0] / (2.0 * math.pi):g} to {ends[1] / (2.0 * math.pi):g}, as if they were in "
            "rad/s; divide them by 2 pi."
        )


def _is_round(value: float, digits: int, tolerance: float) -> bool:
    """Return whether a positive value has only some digits."""
    return abs(float(f"{value:.{digits - 1}e}") - value) <= tolerance * value


def _check_signs(dofs: Sequence[InterfaceDof], lines: MassLines | None) -> None:
    """Refuse drive points that follow the force below the first resonance of a free link."""
    if lines is None:
        return
    wrong = np.diag(lines.accelerance) < 0.0
    where = f"between {lines.first:.3g} and {lines.last:.3g} Hz"
    if wrong.all():
        raise FileError(
            f"all drive points have the wrong sign: {where}, where the link moves as a rigid body, "
            "it must move against the force, with a negative real part of the receptance; look "
            "for reversed signs (multiply all FRFs by -1), or magnitudes without phases."
        )
    if wrong.any():
        raise FileError(
            f"the drive {_points(dofs, wrong)} {where} with the force, not against it as a free "
            "body does; the sensor there, or the force, points the other way: change its sign."
        )


def _check_power(
    dofs: Sequence[InterfaceDof],
    accelerance: ComplexArray,
    noise: float,
    lines: MassLines | None,
) -> None:
    """Refuse drive points that give out power: the imaginary part of a receptance is negative.

    Lines near resonances show this whatever the errors of phase. Without such lines, the mean
    phase must exceed what a good measurement may have; computed FRFs have no such error.
    """
    drive = np.einsum("kii->ki", accelerance)
    size = np.maximum(np.abs(drive), np.finfo(float).tiny)
    near = np.abs(drive.imag) > _LOSS * np.maximum(size, np.median(size, axis=0))
    lost = np.where(near, drive.imag, 0.0)
    share = lost.sum(axis=0) / np.maximum(np.abs(lost).sum(axis=0), np.finfo(float).tiny)
    lag = (drive.imag / size).mean(axis=0) / min(_LAG, 100.0 * noise + 1e-9)
    sign = np.where(near.any(axis=0), 2.0 * share, lag)
    wrong = sign > 1.0
    if not wrong.any():
        return
    turn = float((drive[1:] * drive[:-1].conj())[:, wrong].imag.sum())
    cause = "look for a reversed sign of the sensor or the force there"
    if (sign > -1.0).all():
        cause = "look for reversed signs, or exp(-i omega t) (take their complex conjugates)"
        if lines is not None or turn > 0.0:
            cause = "the FRFs seem to follow exp(-i omega t): take their complex conjugates"
    raise FileError(
        f"the drive {_points(dofs, wrong)} as if the link gave out power, with a positive "
        f"imaginary part of the receptance; {cause}."
    )


def _points(dofs: Sequence[InterfaceDof], chosen: BoolArray) -> str:
    """Return some drive points as the subject of a sentence, with its verb."""
    names = [str(dof) for dof, one in zip(dofs, chosen, strict=True) if one]
    return f"point {names[0]} moves" if len(names) == 1 else f"points {', '.join(names)} move"


def _check_plausible_mass(
    dofs: Sequence[InterfaceDof], accelerance: ComplexArray, weighed: float | None
) -> None:
    least = _MASSES[0] * (1.0 if weighed is None else min(weighed, 1.0))
    for j, dof in enumerate(dofs):
        mass = 1.0 / max(float(np.median(np.abs(accelerance[:, j, j]))), 1e-300)
        if dof.direction != "theta" and not least < mass < _MASSES[1]:
            light = "mm/N or um/N, an acceleration, or over rad/s"
            unit = light if mass <= least else "m/kN"
            raise FileError(
                f"the FRF of {name_frf(dof, dof)} belongs to a mass of {mass:.2g} kg, which no "
                f"link has; convert it to m/N over Hz if it is in {unit}."
            )


def _check_reciprocity(dofs: Sequence[InterfaceDof], accelerance: ComplexArray) -> None:
    sizes = np.linalg.norm(np.diagonal(accelerance, axis1=1, axis2=2), axis=0)
    for i, one in enumerate(dofs):
        for j, other in enumerate(dofs[:i]):
            there, back = accelerance[:, i, j], accelerance[:, j, i]
            odd, even = (float(np.linalg.norm(v)) for v in (there - back, there + back))
            noise = _COUPLED * math.sqrt(sizes[i] * sizes[j])
            if odd > max(_RECIPROCITY * even, noise):
                raise FileError(
                    f"the FRF of {name_frf(one, other)} and its reverse are unrelated but should "
                    "be equal; look for a wrong direction, sign or unit in one of them."
                )
            unequal = 2.0 * abs(np.vdot(there + back, there - back)) / max(even**2, 1e-300)
            if even > noise and unequal > _UNEQUAL:
                raise FileError(
                    f"the FRF of {name_frf(one, other)} and its reverse differ by "
                    f"{100.0 * unequal:.0f} % on average but should be equal; look for a wrong "
                    "gain of a sensor, or measure them again."
                )


def _check_rigid_body(
    dofs: Sequence[InterfaceDof],
    frequencies: FloatArray,
    frf: ComplexArray,
    lines: MassLines | None,
    points: Mapping[str, Point],
    mass: float | None,
) -> None:
    """Refuse signs and units that no planar rigid body with these points has."""
    used = [i for i, dof in enumerate(dofs) if dof.direction != "y" and dof.point in points]
    known = [dofs[i] for i in used]
    planar = len(known) > 2 and {"x", "z"} <= {dof.direction for dof in known}
    if lines is not None and planar:
        motions = rigid_motions(known, list(points.items()))[:, :3]
        accelerance = lines.accelerance[np.ix_(used, used)]
        fit = fit_rigid_body(accelerance, motions)
        suspects = reversed_dofs(accelerance, motions, fit)
        if suspects:
            names = " or ".join(" and ".join(str(known[i]) for i in one) for one in suspects)
            raise FileError(
                f"between {lines.first:.3g} and {lines.last:.3g} Hz, where the link moves as a "
                "rigid body, its points do not move as one; they do if the sign of "
                f"{names} is reversed: look for an axis that points the other way, of the sensor "
                "and of the force."
            )
        if mass is not None and abs(math.log(fit.mass / mass)) > _WEIGHED + 2.0 * fit.misfit:
            raise _wrong_mass(fit.mass, mass, lines)
    _check_sound(known, frequencies, frf[:, used][:, :, used], points)


def _wrong_mass(shown: float, mass: float, lines: MassLines) -> FileError:
    """Return the error that the FRFs show another mass than the scale."""
    ratio = shown / mass
    nearest = min(_FACTORS, key=lambda factor: abs(math.log(ratio / factor)))
    near = abs(math.log(ratio / nearest)) < _WEIGHED
    cause = f", as if {_FACTORS[nearest]}; export them in SI" if near else "; check their units"
    return FileError(
        f"the FRFs show a mass of {shown:.3g} kg between {lines.first:.3g} and {lines.last:.3g} "
        f"Hz, {ratio:.3g} times the {mass:g} kg that `mass` gives{cause}, or correct `mass` (of "
        "one of the equal links)."
    )


def _check_sound(
    dofs: Sequence[InterfaceDof],
    frequencies: FloatArray,
    frf: ComplexArray,
    points: Mapping[str, Point],
) -> None:
    """Refuse an extension so stiff that frequencies must be in rad/s, which makes it 39 times so.

    This needs no weighed mass; it also finds the fault in accelerances, which keep their mass.
    """
    along = [i for i, dof in enumerate(dofs) if dof.direction == "x"]
    if len(along) < 2:
        return
    ends = [along[0], along[-1]]
    (x, z), (other, beside) = (points[dofs[i].point] for i in ends)
    lines = find_mass_lines(frequencies, frf[:, ends][:, :, ends], flexibility=True)
    if lines is None or abs(z - beside) > _ON_AXIS:
        return
    mass = 1.0 / max(float(np.diag(lines.accelerance).min()), 1e-300)
    speed = least_sound_speed(lines, abs(other - x), mass)
    if speed > _FASTEST:
        raise FileError(
            f"the link is so stiff between {dofs[ends[0]]} and {dofs[ends[1]]} that sound would "
            f"travel at {speed:.2g} m/s in it, faster than in any material; look for frequencies "
            "in rad/s (divide them by 2 pi), or for points that are too far apart in the YAML."
        )


def name_frf(response: InterfaceDof, reference: InterfaceDof) -> str:
    """Name an FRF in an error.

    Parameters
    ----------
    response, reference
        DoFs of the motion and of the force.
    """
    return f"response {response} to a force at {reference}"
