# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The subspaces that sets of damped poles span, and how they continue from angle to angle.

States are written in the axes of the uncoupled components, so that those of two configurations
compare: displacements and, for viscous damping, velocities.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, schur

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray, solve_stack
from linkage_vibration.mechanics.description import Rayleigh, Response
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution
from linkage_vibration.mechanics.modes import mixed_damping
from linkage_vibration.mechanics.response import reach, searched
from linkage_vibration.mechanics.sensitivity import PoleShapes
from linkage_vibration.table.pole_cells import oscillating_indices
from linkage_vibration.table.reduced import Numbers

_WIDER = 2.5  # Poles up to so many times the reach may continue those of a table.
_LOW = 0.1  # Displacements of modes below this share of the reach are not enlarged.
_SLOWEST = 1e-3  # A mechanism mode is given this frequency, rad/s.
_POOR = 1e4  # Coordinates with a larger condition number are poor.
_EXACT = 1e-12  # A smaller relative difference of damping is only rounding.
_FEW = 0.25  # The damping of this share of the coordinates may differ from the rest.
_FAST = 2.0  # Undamped modes above so many times a pole follow the slower ones.
_SWEEPS, _CONVERGED = 6, 1e-10  # Jacobi's method needs so many sweeps to so small a change.
_LEAVES = 0.5  # A state that continues a subspace has a smaller share outside it.

N_FAR = 5
"""Number of poles that represent all other modes."""

N_FIT, N_CHECK = 3 * N_FAR + 4, 8
"""Frequencies at which the sum of all other modes is fitted, and others at which it is checked."""


@dataclass(frozen=True, slots=True, eq=False)
class Subspace:
    """The subspace of a set of k poles at one angle, on a basis of its own."""

    states: Numbers  # (n_states, k): its basis
    left: Numbers  # (k, n_states): coordinates of a state that is projected onto it
    inertia: Numbers  # (k, k): G
    stiffness: Numbers  # (k, k): S
    shapes: Numbers  # (n_places, k)

    def on(self, left: Numbers) -> "Subspace | None":
        """Return it on the basis to which ``left``, (k, n_states), leads; None if that is poor.

        This ``left`` is that of one subspace nearby, for all angles.
        """
        turn = left @ self.states
        if not np.isfinite(turn).all() or np.linalg.cond(turn) > _POOR:
            return None
        back = np.linalg.inv(turn)
        return Subspace(
            self.states @ back,
            turn @ self.left,
            back.T @ self.inertia @ back,
            back.T @ self.stiffness @ back,
            self.shapes @ back,
        )


@dataclass(frozen=True, eq=False)
class PoleSample:
    """The poles of the model at one angle in wide reach of the band, and the space they span."""

    alpha3: float  # rad
    viscous: bool
    free: bool  # whether the linkage can move freely at 0 Hz
    poles: ComplexArray  # (k,), rad/s
    others: ComplexArray  # all other poles, of each pair the upper, rad/s
    generator: Numbers  # (k, k): has the poles as its eigenvalues, or k for structural damping
    whole: Subspace  # that of all k poles
    totals: ComplexArray  # (N_FIT + N_CHECK, n_triangle): FRFs at `check_lines`, m/N
    _known: dict[bytes, Subspace] = field(default_factory=dict)  # subspaces already found

    @cached_property
    def vectors(self) -> ComplexArray:
        """The states of the poles, (n_states, k), of unit length."""
        values, vectors = np.linalg.eig(self.generator)
        order = [int(np.abs(values - p).argmin()) for p in _generator_poles(self)]
        states = self.whole.states @ vectors[:, order]
        return np.asarray(states / np.linalg.norm(states, axis=0))

    def subspace(self, chosen: IntArray) -> Subspace:
        """Return the subspace of some of the poles, by their indices, closed under conjugation."""
        key = np.asarray(chosen, dtype=np.int64).tobytes()
        if key not in self._known:
            self._known[key] = self._subspace(chosen)
        return self._known[key]

    def _subspace(self, chosen: IntArray) -> Subspace:
        mine = _generator_poles(self)
        wanted = np.zeros(len(mine), dtype=np.bool_)
        wanted[chosen] = True

        def is_wanted(re: float | complex, im: float = 0.0) -> bool:
            return bool(wanted[np.abs(mine - complex(re + 1j * im)).argmin()])

        output = "real" if self.viscous else "complex"
        t, z, n = schur(self.generator, output=output, sort=is_wanted)
        z, t = z[:, :n], t[:n, :n]
        inertia = z.T @ self.whole.inertia @ z
        left = np.linalg.solve(inertia, z.T @ (self.whole.inertia @ self.whole.left))
        stiffness = -inertia @ t if self.viscous else inertia @ t
        return Subspace(self.whole.states @ z, left, inertia, stiffness, self.whole.shapes @ z)


def _generator_poles(sample: PoleSample) -> ComplexArray:
    """Return the eigenvalues of a sample's triangle that belong to its poles."""
    return sample.poles if sample.viscous else -(sample.poles**2)


def check_lines(band: tuple[float, float], *, free: bool) -> FloatArray:
    """Return the frequencies (rad/s) of `PoleSample.totals`: those of the fit, then the others."""
    low, high = searched(band, free=free)
    fit = (1.0 - np.cos(np.pi * (np.arange(N_FIT) + 0.5) / N_FIT)) / 2.0
    # The error is largest at the end of the band.
    check = np.append((np.arange(N_CHECK - 1) + 0.5) / (N_CHECK - 1), 1.0)
    lines = low + (high - low) * np.concatenate([fit, check])
    return np.asarray(2.0 * math.pi * lines)


def mass_root(model: LinkageModel) -> FloatArray:
    """Return R with R^T R = M, the mass of the uncoupled components, (n, n)."""
    values, vectors = np.linalg.eigh(model.system.mass)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, np.newaxis] * vectors.T)


def sample_poles(solution: Solution, root: FloatArray, places: tuple[Place, ...]) -> PoleSample:
    """Find the poles in wide reach of the band, and their subspace.

    The root is that of `mass_root`; the places are those where FRFs are needed.
    """
    model, coupled = solution.model, solution.coupled
    response = model.mechanism.response
    omega = np.maximum(solution.modes.omega, _SLOWEST)
    viscous = solution.vectors.T @ coupled.damping @ solution.vectors
    loss = solution.vectors.T @ coupled.loss @ solution.vectors
    if loss.any() and viscous.any():
        raise mixed_damping()
    moved_places = solution.participation(places)
    turned = root @ solution.modes.shapes  # with orthonormal columns
    scale = reach(response.band)
    limit = _WIDER * max(reach(response.band), float(omega[min(response.modes, len(omega)) - 1]))
    t: Numbers
    q: Numbers
    states: Numbers
    inertia: Numbers
    above: Numbers
    stiffness: Numbers
    if loss.any():
        t, q, poles, others = _structural(omega, loss, limit)
        states, above = turned @ q, q.T @ turned.T
        inertia = q.T @ q
        stiffness = inertia @ t
    else:
        t, q, v, poles, others = _viscous(omega, viscous, limit, response)
        states = np.vstack([turned @ q, turned @ v / scale])
        inertia = q.T @ viscous @ q + q.T @ v + v.T @ q
        above = np.hstack([(q.T @ viscous + v.T) @ turned.T, scale * q.T @ turned.T])
        # Unlike -inertia t, this has an error that is the square of the error of the subspace, so
        # that rounding of the highest poles does not affect the lowest.
        stiffness = np.asarray((q.T * omega**2) @ q - v.T @ v)
        t = np.asarray(-np.linalg.solve(inertia, stiffness))
        poles = np.linalg.eigvals(t).astype(complex)
    basis, turn = np.linalg.qr(states)  # a basis that is well-conditioned
    back = np.linalg.inv(turn)
    inertia, stiffness = back.T @ inertia @ back, back.T @ stiffness @ back
    left = np.asarray(np.linalg.solve(inertia, back.T @ above))
    shapes: Numbers = (
        moved_places @ q @ back if viscous.any() else (moved_places @ q @ back).astype(complex)
    )
    whole = Subspace(basis, left, inertia, stiffness, shapes)
    totals = _totals(solution, omega, viscous, loss, moved_places)
    alpha3 = solution.configuration.alpha3
    free = bool(solution.modes.mechanism.any())
    return PoleSample(alpha3, not loss.any(), free, poles, others, turn @ t @ back, whole, totals)


def _viscous(
    omega: FloatArray, viscous: FloatArray, limit: float, response: Response
) -> tuple[FloatArray, FloatArray, FloatArray, ComplexArray, ComplexArray]:
    """Return Schur form, displacements, velocities and poles up to a limit, and the other poles."""
    n = len(omega)
    # State (S q, q'), so that rounding of the highest modes does not affect the lowest.
    scale = np.maximum(omega, _LOW * reach(response.band))
    first, second = np.diag(scale), np.diag(omega**2 / scale)
    matrix = np.block([[np.zeros((n, n)), first], [-second, -viscous]])
    while True:
        t, z, k = schur(matrix, output="real", sort=lambda re, im, r=limit: math.hypot(re, im) < r)
        poles = np.linalg.eigvals(t[:k, :k]).astype(complex)
        if k == 2 * n or (poles.imag > 0.0).sum() > response.modes:
            break
        limit *= 2.0
    others = np.linalg.eigvals(t[k:, k:]).astype(complex)
    z = z[:, :k]
    return t[:k, :k], z[:n] / scale[:, np.newaxis], z[n:], poles, others[others.imag >= 0.0]


def _structural(
    omega: FloatArray, loss: FloatArray, limit: float
) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
    """Return Schur form of k, displacements and poles up to a limit, and the other poles."""
    inverse = np.linalg.inv(np.eye(len(omega)) + 1j * loss / np.outer(omega, omega))
    flexibility = inverse / np.outer(omega, omega)
    t, z, k = schur(flexibility, output="complex", sort=lambda x: abs(x) > 1.0 / limit**2)
    values = np.diag(t)
    # The poles are the eigenvalues of the inverse of the leading block.
    poles = 1j * np.sqrt(1.0 / values)
    return np.linalg.inv(t[:k, :k]), z[:, :k], poles[:k], poles[k:]


def _totals(
    solution: Solution,
    omega: FloatArray,
    viscous: FloatArray,
    loss: FloatArray,
    moved_places: FloatArray,
) -> ComplexArray:
    """Return the FRFs with every mode, (n_lines, n_triangle), from the equations of motion."""
    free = bool(solution.modes.mechanism.any())
    lines = check_lines(solution.model.mechanism.response.band, free=free)
    upper, w = np.triu_indices(len(moved_places)), lines[:, np.newaxis, np.newaxis]
    coupling = None if loss.any() else _coupling(solution)
    if coupling is None:
        dynamic = np.diag(omega**2) + 1j * loss - w**2 * np.eye(len(omega)) + 1j * w * viscous
        frf = moved_places @ solve_stack(dynamic, moved_places.T.astype(complex))
    else:  # few forces replace the equations of all modes
        decay, moved, damping = coupling
        terms = 1.0 / (omega**2 - w**2 + 1j * w * decay)
        both, n = np.vstack([moved_places, moved]), len(moved_places)
        every = (both * terms) @ both.T
        force = 1j * w * damping
        inner = np.eye(len(damping)) + force @ every[:, n:, n:]
        added = np.linalg.solve(inner, force @ every[:, n:, :n])
        frf = np.asarray(every[:, :n, :n] - every[:, :n, n:] @ added, dtype=np.complex128)
    return np.asarray(frf[:, upper[0], upper[1]])


def _coupling(solution: Solution) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Split the modal damping into a diagonal, (m,), and R^T D R with few rows R, (r, m).

    Rayleigh damping of all components would leave the modes real; D, (r, r), is what springs and
    components without it add. It returns the diagonal, R and D; None if most components differ.
    """
    model, joining, shapes = solution.model, solution.joining, solution.modes.shapes
    system, rule = model.system, model.mechanism.damping
    a, b = 0.0, 0.0
    if isinstance(rule, Rayleigh):
        a, b = rule.mass_coefficient, rule.stiffness_coefficient
    rest = system.damping - a * system.mass - b * system.stiffness
    size = np.abs(system.damping) + a * np.abs(system.mass) + b * np.abs(system.stiffness)
    rows = np.flatnonzero((np.abs(rest) > _EXACT * size).any(axis=1))
    if len(rows) > _FEW * len(rest) or model.mechanism.gravity:
        return None
    stretch = joining.elongation @ shapes[: joining.elongation.shape[1]]
    springs = np.diag(joining.damping - b * joining.stiffness)
    added = block_diag(rest[np.ix_(rows, rows)], springs)
    return a + b * solution.modes.omega**2, np.vstack([shapes[rows], stretch]), added


def pole_shapes(
    sample: PoleSample, solution: Solution, root: FloatArray, highest: float
) -> PoleShapes | None:
    """Return the poles up to a frequency (Hz) and their shapes; None if the sample lacks some.

    It also returns None if the damping couples fast modes too strongly to find the shapes.
    """
    if math.tau * highest > np.abs(sample.others).min(initial=math.inf):
        return None
    chosen, modes, vectors = oscillating_indices(sample.poles), solution.modes, solution.vectors
    poles, turned = sample.poles[chosen], root @ modes.shapes  # with orthonormal columns
    shapes = turned.T @ sample.vectors[: len(root), chosen]  # by the undamped modes
    factors = poles if sample.viscous else np.full(len(poles), 1j)
    damping = solution.coupled.damping if sample.viscous else solution.coupled.loss
    damping = np.asarray(vectors.T @ damping @ vectors)
    # The equations of fast modes, whose forces are large, remove the rounding of their shares.
    omega, diagonal = modes.omega[:, np.newaxis], np.diag(damping)[:, np.newaxis]
    fast, change = omega > _FAST * np.abs(poles), np.zeros_like(shapes)
    for _ in range(_SWEEPS):
        forces = factors * (damping @ shapes - diagonal * shapes)
        followed = np.asarray(-forces / (omega**2 + factors * diagonal + poles**2))
        change = np.where(fast, followed - shapes, 0.0)
        shapes = shapes + change
    if np.linalg.norm(omega * change) > _CONVERGED * np.linalg.norm(omega * shapes):
        return None
    scale = np.asarray((shapes**2).sum(axis=0))
    if sample.viscous:
        scale = np.asarray(2.0 * poles * scale + (shapes * (damping @ shapes)).sum(axis=0))
    return PoleShapes(poles, modes.shapes @ (shapes / np.sqrt(scale)), sample.viscous)


def continue_set(here: Subspace, there: PoleSample, count: int) -> tuple[IntArray, bool, IntArray]:
    """Find the poles of another angle that continue a set of a given number.

    A pole continues the set if the projection onto its subspace leaves its state as it is, and does
    not if the projection removes it. It returns the indices of the poles; whether they are clear,
    which they are not if the step is too long or a pole of the set is close to another; and the
    pole that almost continues the set too, with its conjugate.
    """
    states = there.vectors
    inside = here.states @ (here.left @ states)
    outside = np.linalg.norm(states - inside, axis=0)
    order = np.argsort(outside, kind="stable")
    chosen = order[:count]
    if count >= len(order):  # with fewer poles than the set, a part of it is missing there
        clear = count == len(order) and bool(outside.max() < _LEAVES)
        return np.sort(chosen), clear, order[:0]
    next_one = order[count]
    rival = np.flatnonzero(
        np.abs(there.poles - there.poles[next_one].conj()) <= 1e-9 * abs(there.poles[next_one])
    )
    rival = np.union1d(rival, [next_one])
    clear = outside[chosen].max() < min(_LEAVES, outside[next_one] / 2.0)
    clear = bool(clear and not np.isin(rival, chosen).any())
    return np.sort(chosen), clear, np.setdiff1d(rival, chosen)
