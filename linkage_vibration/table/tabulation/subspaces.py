# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The subspaces that sets of damped poles span, and how they continue from angle to angle.

States are written in the axes of the uncoupled components, so that those of two configurations
compare: displacements and, for viscous damping, velocities.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import schur

from linkage_vibration.mechanics.arrays import (
    BoolArray,
    ComplexArray,
    FloatArray,
    product,
    solve_stack,
)
from linkage_vibration.mechanics.description import Response
from linkage_vibration.mechanics.model import IdentifiedSolution, Solution
from linkage_vibration.mechanics.modes import MECHANISM, mixed_damping, modal_damping
from linkage_vibration.mechanics.response import peak_search_band, reach
from linkage_vibration.table.reduced import Numbers, frf_pairs

_WIDER = 2.5  # Poles up to so many times the reach may continue those of a table.
_LOW = 0.1  # Displacements of modes below this share of the reach are not enlarged.
_SLOWEST = 1e-3  # A mechanism mode is given this frequency, rad/s.
_POOR = 1e4  # Coordinates with a larger condition number are poor.
_SERIES = 1e-17  # A series ends where its terms are smaller.
_APART = 4.0  # Undamped modes above so many times the limit only correct the poles below it,
_GROWN = 1e3  # Rounding of the states of far modes grows as these do.
_DASHPOT = 0.2  # unless the limit is above this share of the slowest of their real poles.
_FLAT = 1e-5  # Beside poles below this share of the others, rounding spoils a series.
_LEAVES = 0.5  # A state that continues a subspace has a smaller share outside it.

N_FAR = 5  # Number of poles that represent all other modes

N_FIT, N_CHECK = 3 * N_FAR + 4, 8  # Frequencies of the fit of other modes, and of its check


Set = frozenset[int]
"""The indices of poles of a sample."""


@dataclass(frozen=True, slots=True, eq=False)
class Subspace:
    """The subspace of a set of k poles at one angle, on a basis of its own."""

    states: Numbers  # (n_states, k): its basis
    left: Numbers  # (k, n_states): coordinates of a state that is projected onto it
    inertia: Numbers  # (k, k): G
    stiffness: Numbers  # (k, k): S
    shapes: Numbers  # (n_rows, k): at the places and of the forces

    def on(self, left: Numbers) -> "Subspace":
        """Return it on the basis of a nearby ``left``, (k, n_states), or raise a `LinAlgError`."""
        turn = left @ self.states
        if not np.isfinite(turn).all() or np.linalg.cond(turn) > _POOR:
            raise np.linalg.LinAlgError
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
    totals: ComplexArray  # (N_FIT + N_CHECK, n_pairs): FRFs at `check_lines`, m/N
    # (2, n): standard deviations of frequencies (Hz) and ratios by the noise of measured links.
    deviations: FloatArray | None = None
    _subspaces: dict[Set, Subspace] = field(default_factory=dict)  # by their poles

    @cached_property
    def vectors(self) -> ComplexArray:
        """The states of the poles, (n_states, k), of unit length."""
        values, vectors = np.linalg.eig(self.generator)
        order = [int(np.abs(values - p).argmin()) for p in _generator_poles(self)]
        states = self.whole.states @ vectors[:, order]
        return np.asarray(states / np.linalg.norm(states, axis=0))

    def subspace(self, chosen: Set) -> Subspace:
        """Return the subspace of some of the poles, by their indices, closed under conjugation."""
        if chosen in self._subspaces:
            return self._subspaces[chosen]
        mine = _generator_poles(self)

        def is_wanted(re: float | complex, im: float = 0.0) -> bool:
            return int(np.abs(mine - complex(re + 1j * im)).argmin()) in chosen

        output = "real" if self.viscous else "complex"
        t, z, n = schur(self.generator, output=output, sort=is_wanted)
        z, t = z[:, :n], t[:n, :n]
        inertia = z.T @ self.whole.inertia @ z
        left = np.linalg.solve(inertia, z.T @ (self.whole.inertia @ self.whole.left))
        stiffness = -inertia @ t if self.viscous else inertia @ t
        states, shapes = self.whole.states @ z, self.whole.shapes @ z
        self._subspaces[chosen] = Subspace(states, left, inertia, stiffness, shapes)
        return self._subspaces[chosen]


def _generator_poles(sample: PoleSample) -> ComplexArray:
    """Return the eigenvalues of a sample's triangle that belong to its poles."""
    return sample.poles if sample.viscous else -(sample.poles**2)


def check_lines(band: tuple[float, float], *, free: bool) -> FloatArray:
    """Return the frequencies (rad/s) of `PoleSample.totals`: those of the fit, then the others."""
    low, high = peak_search_band(band, free=free)
    fit = (1.0 - np.cos(np.pi * (np.arange(N_FIT) + 0.5) / N_FIT)) / 2.0
    # The error is largest at the end of the band.
    check = np.append((np.arange(N_CHECK - 1) + 0.5) / (N_CHECK - 1), 1.0)
    lines = low + (high - low) * np.concatenate([fit, check])
    return np.asarray(2.0 * math.pi * lines)


def sample_poles(
    solution: Solution, root: FloatArray, powers: Numbers, n_inputs: int
) -> PoleSample:
    """Find the poles in wide reach of the band, and their subspace.

    The root is that of `mass_root`; the powers are those at places, and then of forces.
    """
    coupled, vectors = solution.coupled, solution.vectors
    viscous, loss = modal_damping(coupled, vectors)
    if loss.any() and viscous.any():
        raise mixed_damping()
    motion = _Motion(
        np.maximum(solution.modes.omega, _SLOWEST),
        viscous,
        loss,
        root @ solution.modes.shapes,
        powers,
        n_inputs,
    )
    free = bool(solution.modes.mechanism.any())
    return motion.sample(solution.configuration.alpha3, solution.model.mechanism.response, free)


def sample_identified(identified: IdentifiedSolution, response: Response) -> PoleSample:
    """Return poles identified from FRFs, and their subspace; shapes are not orthogonal."""
    modes = identified.identified
    omega = modes.omega
    viscous, loss = np.diag(2.0 * modes.damping_ratios * omega), np.zeros((len(omega), len(omega)))
    motion = _Motion(omega, viscous, loss, identified.modes.shapes, modes.shapes[:1][np.newaxis], 1)
    sample = motion.sample(identified.configuration.alpha3, response, free=False, orthogonal=False)
    deviations = np.array([identified.frequency_stddev, identified.damping_ratio_stddev])
    return replace(sample, deviations=deviations)


@dataclass(frozen=True, eq=False)
class _Motion:
    """The equations of motion at one angle on n undamped modes."""

    omega: FloatArray  # (n,), rad/s
    viscous: FloatArray  # (n, n)
    loss: FloatArray  # (n, n)
    turned: FloatArray  # (n_dofs, n): the shapes, whose products are those by the mass
    # (3 or 1, n_rows, n): displacements at places, and forces, by powers of s, as `Solution.powers`
    rows: Numbers
    n_inputs: int

    def sample(
        self, alpha3: float, response: Response, free: bool, *, orthogonal: bool = True
    ) -> PoleSample:
        """Return the poles and their subspace; ``orthogonal`` says that the shapes are."""
        scale, viscous, near = reach(response.band), not self.loss.any(), None
        elastic = self.omega[self.omega >= MECHANISM]
        limit = _WIDER * max(scale, float(elastic[min(response.modes, len(elastic)) - 1]))
        if viscous:
            q, v, others = self._viscous(limit, response)
            states = np.vstack([self.turned @ q, self.turned @ v / scale])
            inertia = q.T @ self.viscous @ q + q.T @ v + v.T @ q
            rows = q.T @ self.viscous + v.T, q.T
            above = np.hstack([rows[0] @ self.turned.T, scale * rows[1] @ self.turned.T])
            # Unlike -inertia t, this has an error that is the square of the error of the subspace,
            # so that rounding of the highest poles does not affect the lowest.
            stiffness = np.asarray((q.T * self.omega**2) @ q - v.T @ v)
            t = np.asarray(-np.linalg.solve(inertia, stiffness))
            poles = np.linalg.eigvals(t).astype(complex)
            powers = q, v, v @ t
            if not self._is_diagonal:
                near = np.vstack([q, v]), np.linalg.solve(inertia, np.hstack(rows)), t
        else:
            t, q, poles, others = _structural(self.omega, self.loss, limit)
            states, above = self.turned @ q, q.T @ self.turned.T
            inertia = q.T @ q
            stiffness = inertia @ t
            powers = q, 0.0 * q, -q @ t
        basis, turn = np.linalg.qr(states)  # a basis that is well-conditioned
        back = np.linalg.inv(turn)
        inertia, stiffness = back.T @ inertia @ back, back.T @ stiffness @ back
        left = basis.conj().T
        if orthogonal:
            left = np.asarray(np.linalg.solve(inertia, back.T @ above))
        shapes = sum(row @ power for row, power in zip(self.rows, powers, strict=False)) @ back
        whole = Subspace(basis, left, inertia, stiffness, shapes if viscous else shapes + 0j)
        lines, lowest = check_lines(response.band, free=free), np.abs(others).min(initial=math.inf)
        if near is None or np.abs(poles).min() < _FLAT * lowest:
            moved = self._moved(lines)
        else:
            moved = self._moved_beside(*near, lines, float(lowest))
        totals = self._totals(lines, moved)
        return PoleSample(alpha3, viscous, free, poles, others, turn @ t @ back, whole, totals)

    @cached_property
    def _is_diagonal(self) -> bool:
        """Whether damping couples no modes."""
        return all(not (each - np.diag(np.diag(each))).any() for each in (self.viscous, self.loss))

    def _viscous(self, limit: float, response: Response) -> tuple[Numbers, Numbers, ComplexArray]:
        """Return displacements and velocities of the poles up to a limit, and the other poles."""
        if not self._is_diagonal:
            return _viscous(self.omega, self.viscous, limit, response)
        n, poles = len(self.omega), _uncoupled(self.omega, np.diag(self.viscous)).reshape(2, -1)
        near = np.abs(poles).min(axis=0) < limit
        chosen, none = np.eye(n)[:, near], np.zeros((n, int(near.sum())))
        others = poles[:, ~near].ravel()
        both = np.hstack([chosen, none]), np.hstack([none, chosen])
        return *both, others[others.imag >= 0.0]

    def _totals(self, lines: FloatArray, moved: ComplexArray) -> ComplexArray:
        """Return the FRFs with every mode at some lines, rad/s, (n_lines, n_pairs)."""
        outputs, inputs = frf_pairs(self.rows.shape[1], self.n_inputs)
        flat = moved.swapaxes(0, 1).reshape(len(self.omega), -1)
        powers = product(self.rows.reshape(-1, len(flat)), flat)
        each = powers.reshape(*self.rows.shape[:2], len(lines), -1)
        s = 1j * lines[:, np.newaxis]
        frf = sum(s**i * power for i, power in enumerate(each))
        return np.asarray(frf)[outputs, :, inputs].T

    def _moved(self, lines: FloatArray) -> ComplexArray:
        """Return the motion of the modes by the inputs at lines, rad/s, (n_lines, n, n_inputs)."""
        squared, w = self.omega**2, lines[:, np.newaxis]
        into = self.rows[0, : self.n_inputs].T
        if self._is_diagonal:
            dynamic = squared + 1j * np.diag(self.loss) - w**2 + 1j * w * np.diag(self.viscous)
            return np.asarray(into / dynamic[..., np.newaxis])
        dynamic = 1j * (self.loss + w[:, np.newaxis] * self.viscous)
        np.einsum("kii->ki", dynamic)[:] += squared - w**2
        return solve_stack(dynamic, into.astype(complex))

    def _moved_beside(
        self, states: Numbers, left: Numbers, t: Numbers, lines: FloatArray, lowest: float
    ) -> ComplexArray:
        """Return `_moved` by the poles of a subspace, and a series in s over the lowest other."""
        n, s = len(self.omega), 1j * lines[:, np.newaxis, np.newaxis]
        into = self.rows[0, : self.n_inputs].T
        near = left[:, n:] @ into
        moved = states[:n] @ np.linalg.solve(s * np.eye(len(t)) - t, near + 0.0 * s)
        state, terms, steps = np.vstack([0.0 * into, into]) - states @ near, [], s[:, 0] / lowest
        for _ in range(math.ceil(math.log(_SERIES) / math.log(abs(steps).max()))):
            first, second = state[:n], state[n:]
            before = (second + self.viscous @ first) / self.omega[:, np.newaxis] ** 2
            state = np.vstack([-lowest * before, lowest * first])
            state -= states @ (left @ state)  # or rounding would grow by the lowest poles
            terms.append(state[:n] / lowest)
        return np.asarray(moved - np.tensordot(steps ** np.arange(len(terms)), np.array(terms), 1))


def _viscous(
    omega: FloatArray, viscous: FloatArray, limit: float, response: Response
) -> tuple[Numbers, Numbers, ComplexArray]:
    """Return displacements and velocities of the poles up to a limit, and the other poles."""
    n = len(omega)
    # State (S q, q'), so that rounding of the highest modes does not affect the lowest.
    scale = np.maximum(omega, _LOW * reach(response.band))
    first, second = np.diag(scale), np.diag(omega**2 / scale)
    matrix = np.block([[np.zeros((n, n)), first], [-second, -viscous]])
    while True:
        far = omega > _APART * limit
        # Strong damping makes slow poles of far modes, down to the inverse of this norm.
        slow = (viscous / np.outer(omega, omega))[np.ix_(far, far)]
        far &= limit * np.linalg.norm(slow, 2) < _DASHPOT if far.any() else far
        if far.all():  # No pole is below the limit.
            limit *= 2.0
            continue
        condensed, states = _condensed(matrix, np.tile(far, 2))
        far &= len(condensed) < 2 * n
        t, z, k = schur(
            condensed, output="real", sort=lambda re, im, r=limit: math.hypot(re, im) < r
        )
        if k == 2 * n or (np.linalg.eigvals(t[:k, :k]).imag > 0.0).sum() > response.modes:
            break
        limit *= 2.0
    z = states @ z[:, :k]
    # Poles far above the band need no coupling, as they are only represented.
    others = np.append(np.linalg.eigvals(t[k:, k:]), _uncoupled(omega[far], np.diag(viscous)[far]))
    return z[:n] / scale[:, np.newaxis], z[n:], others[others.imag >= 0.0]


def _condensed(matrix: FloatArray, far: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return a matrix on the states that are not far, and all states, (n, k), of these.

    With x_far = X x, X A = A_far X for the poles that are lower than those of A_far by _APART, by
    which each step divides the errors. It is the whole matrix if this does not converge.
    """
    near, x = ~far, np.zeros((int(far.sum()), int((~far).sum())))
    within, into = matrix[np.ix_(near, near)], matrix[np.ix_(near, far)]
    back, inverse = matrix[np.ix_(far, near)], np.linalg.inv(matrix[np.ix_(far, far)])
    for _ in range(math.ceil(-math.log(_SERIES) / math.log(_APART)) if len(x) else 0):
        x = inverse @ (x @ (within + into @ x) - back)
        if not np.abs(x).max() < _GROWN:  # Damping makes a pole of near modes a fast one.
            return matrix, np.eye(len(matrix))
    states = np.empty((len(matrix), x.shape[1]))
    states[near], states[far] = np.eye(x.shape[1]), x
    return within + into @ x, states


def _uncoupled(omega: FloatArray, decay: FloatArray) -> ComplexArray:
    """Return both poles of each mode, rad/s, (2 n,), of which damping couples none."""
    root = np.sqrt(decay**2 / 4.0 - omega**2 + 0j)
    return np.concatenate([root - decay / 2.0, -root - decay / 2.0])


def _structural(
    omega: FloatArray, loss: FloatArray, limit: float
) -> tuple[Numbers, Numbers, ComplexArray, ComplexArray]:
    """Return Schur form of k, displacements and poles up to a limit, and the other poles."""
    inverse = np.linalg.inv(np.eye(len(omega)) + 1j * loss / np.outer(omega, omega))
    flexibility = inverse / np.outer(omega, omega)
    t, z, k = schur(flexibility, output="complex", sort=lambda x: abs(x) > 1.0 / limit**2)
    values = np.diag(t)
    # The poles are the eigenvalues of the inverse of the leading block.
    poles = 1j * np.sqrt(1.0 / values)
    return np.linalg.inv(t[:k, :k]), z[:, :k], poles[:k], poles[k:]


def continue_set(here: Subspace, there: PoleSample, count: int) -> tuple[Set, bool, Set]:
    """Find the poles of another angle that continue a set of a given number.

    The projection onto its subspace leaves their states as they are. Returned are their indices;
    whether they are clear; and the pole that almost continues the set too, with its conjugate.
    """
    states = there.vectors
    inside = here.states @ (here.left @ states)
    outside = np.linalg.norm(states - inside, axis=0)
    order = np.argsort(outside, kind="stable")
    chosen = frozenset(order[:count].tolist())
    if count >= len(order):  # with fewer poles than the set, a part of it is missing there
        clear = count == len(order) and bool(outside.max() < _LEAVES)
        return chosen, clear, frozenset()
    next_one = order[count]
    pair = np.abs(there.poles - there.poles[next_one].conj()) <= 1e-9 * abs(there.poles[next_one])
    rival: Set = frozenset({int(next_one), *np.flatnonzero(pair).tolist()})
    clear = outside[order[count - 1]] < min(_LEAVES, outside[next_one] / 2.0)
    return chosen, bool(clear) and chosen.isdisjoint(rival), rival - chosen
