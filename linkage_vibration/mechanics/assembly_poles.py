# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Poles of an assembly from the interface flexibility, and their variances.

At a pole p of the assembly the joints transmit forces without a gap, (B H(p) B^T + S(p)) z = 0. A
change dH of the receptances moves the pole by -z^T B dH B^T z / (z^T D z), where D is the
derivative of B H B^T + S. So the noise of measured links gives the variances of the poles, and so
does an error of a gain that all receptances of a link share, dH = g H.

The fit of a measured link has real poles at rates that the fit chooses. Noise can join two of them
to a strongly damped pole of the assembly. Such a pole is not there if the rates are others. How far
a pole moves by a fit with more terms, or with other rates, is a part of its deviation, which is not
known if a lightly damped pole is not found with other rates.
"""

import math
from dataclasses import dataclass

import numpy as np

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray
from linkage_vibration.mechanics.compatibility import Joining
from linkage_vibration.mechanics.components import Components, FrfComponent
from linkage_vibration.mechanics.fbs import held_frf, independent_rows
from linkage_vibration.mechanics.link_fit import Choice

_STEP = 1e-7  # step for the derivative, as a share of a pole
_STEPS = 20  # largest number of Newton steps
_CLOSE = 1e-9  # A pole has converged if its relative step is smaller.
_SAME = 1e-6  # Two poles are one if their relative distance is smaller.
_UNCERTAIN = 0.1  # A mode is noise if the relative standard deviation of its frequency is larger.
_APART = 3.0  # Poles are different if they are farther apart, in standard deviations.
_DEPENDS = 0.1  # A pole depends on the rates of a fit if others move it by a larger share.
_STRONG = 0.1  # Such a pole is an artefact if its damping ratio is larger, and else not well known.
# Newton's method may move a pole by this share of it, or by its decay rate if that is larger.
_MOVES = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class AssemblyPole:
    """A pole, and the forces in the joints there."""

    pole: complex  # rad/s
    forces: ComplexArray  # (n_rows,): z
    slope: complex  # z^T D z

    def turns(self) -> ComplexArray:
        """Return t, (2,), of changes Re(t z^T B dH B^T z) of frequency (Hz) and damping ratio."""
        size = abs(self.pole)
        frequency = self.pole.conjugate() / size
        ratio = (self.pole.real / size * frequency - 1.0) / size
        return np.array([frequency / (2.0 * math.pi), ratio]) / -self.slope


class Assembly:
    """Components, some measured, that are joined; the ground holds the DoFs `held`, (n,)."""

    def __init__(self, components: Components, held: BoolArray, joining: Joining) -> None:
        kept = joining.compatibility[:, ~held].any(axis=1)
        rigid, _ = independent_rows(joining.compatibility[kept], 0.0)
        self._rows = np.vstack([rigid, joining.elongation])
        # That `confirm` kept: poles, rad/s, deviations of natural frequencies, Hz, and ratios.
        self.modes: list[tuple[complex, float, float]] = []
        self._rigid = np.zeros(len(rigid))
        self._joining = joining
        ends = np.cumsum([len(component.dofs) for component in components])[:-1]
        rows = np.split(self._rows, ends, axis=1)
        self._parts = list(zip(components, np.split(held, ends), rows, strict=True))

    def confirm(self, poles: ComplexArray) -> BoolArray:
        """Return which poles, (n,), rad/s, are modes, and not caused by noise or the fit."""
        self.modes.clear()
        kept = np.zeros(len(poles), dtype=np.bool_)
        for i, start in enumerate(poles):
            mode = self._refined(complex(start))
            if mode is None:
                continue
            pole, size = mode.pole, abs(mode.pole)
            if any(abs(pole - other) <= _SAME * size for other, _, _ in self.modes):
                continue
            noise, gain = self._variances(mode)
            if self._of_one_link(mode, noise):
                continue
            moved = self._moved(mode)
            lasts = -pole.real < _STRONG * size or not np.isnan(moved).any()
            if noise[0] <= (_UNCERTAIN * size / (2.0 * math.pi)) ** 2 and lasts:
                kept[i] = True
                self.modes.append((pole, *np.sqrt(noise + gain + moved**2).tolist()))
        return kept

    def _variances(self, mode: AssemblyPole) -> FloatArray:
        """Return variances of frequency (Hz) and damping ratio by noise and gain, (2, 2)."""
        power = np.zeros((2, 2))
        for component, _, rows in self._parts:
            if isinstance(component, FrfComponent):
                forces, fit = rows.T @ mode.forces, component.measured.fit
                given = mode.pole, forces, mode.turns(), component.noise
                power[0] += fit.variances(*given)
                change = forces @ fit.at(np.array([mode.pole]))[0] @ forces
                power[1] += (component.gain * (mode.turns() * change).real) ** 2
        return power

    def _of_one_link(self, mode: AssemblyPole, noise: FloatArray) -> bool:
        """Return whether noise does not separate a pole from one of a measured link that is free.

        Noise can leave a pole beside that of a free link, although the joined link has none there.
        """
        fits = [c.measured.fit for c, _, _ in self._parts if isinstance(c, FrfComponent)]
        poles = np.concatenate([[mode.pole], *(fit.poles for fit in fits)])
        numbers = np.array([np.abs(poles) / (2.0 * math.pi), poles.real / np.abs(poles)])
        near = np.abs(numbers[:, 1:] - numbers[:, :1]) <= _APART * np.sqrt(noise)[:, np.newaxis]
        return bool(near.all(axis=0).any())

    def _moved(self, mode: AssemblyPole) -> FloatArray:
        """Return by how much other real poles in measured links move Hz and damping ratio, (2,).

        They are NaN if the pole is not there with them.
        """
        other = self._refined(mode.pole, Choice.SHIFTED)
        if other is None or abs(other.pole - mode.pole) > _DEPENDS * abs(mode.pole):
            return np.full(2, math.nan)
        poles = np.array([other.pole, mode.pole])
        sizes = np.abs(poles)
        return np.diff([sizes / (2.0 * math.pi), -poles.real / sizes])[:, 0]

    def _refined(self, start: complex, choice: Choice = Choice.BEST) -> AssemblyPole | None:
        """Find the oscillating pole near an identified one by Newton's method, or None."""
        pole, allowed = start, max(abs(start.real), _MOVES * abs(start))
        for _ in range(_STEPS):
            flexibility, side = self._flexibility(pole, choice), _STEP * abs(pole)
            forces = np.linalg.svd(flexibility)[2][-1].conj()
            ends = [self._flexibility(pole + step, choice) for step in (side, -side)]
            rate = ends[0] - ends[1]
            slope = complex(forces @ rate @ forces) / (2.0 * side)
            step = complex(forces @ flexibility @ forces) / slope
            pole -= step
            if not abs(pole - start) <= allowed:
                break
            if abs(step) <= _CLOSE * abs(pole):
                oscillates = pole.imag > _SAME * abs(pole)
                return AssemblyPole(pole, forces, slope) if oscillates else None
        return None

    def _flexibility(self, s: complex, choice: Choice) -> ComplexArray:
        """Return B H(s) B^T + S(s) of independent rows, (n_rows, n_rows)."""
        springs = 1.0 / (self._joining.stiffness + s * self._joining.damping)
        flexibility = np.diag(np.concatenate([self._rigid, springs]).astype(complex))
        for component, held, rows in self._parts:
            if isinstance(component, FrfComponent):
                receptance = component.measured.fit.at(np.array([s]), choice)[0]
            else:
                receptance = held_frf(component, np.array([s / (2j * math.pi)]), held)[0]
            flexibility += rows @ receptance @ rows.T
        return flexibility
