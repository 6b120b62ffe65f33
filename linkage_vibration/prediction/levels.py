# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How strongly excitations shake the response point, from the poles and residues of a table.

Numbers for one angle are those for many to the last bit, so complex numbers are pairs of arrays
here, and sums run in the order of the terms.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import RESONANCE
from linkage_vibration.prediction.excitation import Excitation, ExcitationError, LoadKind, Source
from linkage_vibration.prediction.loads import UnitLoad, load_input
from linkage_vibration.prediction.predictor import Predictor, angles_in_table
from linkage_vibration.table.interpolation import stroke_angle, stroke_variable
from linkage_vibration.table.table import Table

ERROR = 1e-4
"""Largest error of a response between the angles at which the table was evaluated, over the sum of
the magnitudes of its terms; where it is larger, levels are not known."""

# Of a variance: the largest share of second order over that of first order, and over the square of
# the value, up to which standard deviations agree with samples within 10 %, in 98 of 100 cases.
_EVEN, _LARGE = 0.04, 0.25
_ROUNDING = 1e-20  # of the square of a value: a variance that is only rounding
_REACH = math.sqrt(3.0)  # standard deviations, to the points at which a response is evaluated

_STATIC = 1e-5  # of the magnitudes of its terms: a static response below is only rounding
_CANCELLED = 0.25  # of the sum of the sizes of the terms; a smaller response is a difference
_NOTABLE = 0.1  # of the level by all, from which one of them counts
_TINY = float(np.finfo(float).tiny)
_FIRST_CELLS, _MOST_CELLS = 32, 512  # of a piece of the table
_CHUNK = 64  # angles that are evaluated together, so that their terms stay in the cache


@dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    """How interpolated numbers are arranged.

    First come k (real and imaginary part) and c of the terms; then, for each input and term, a
    (both parts) and b; then, for each input, the residual (both parts), its rate, and the size of
    the static response.
    """

    n_terms: int
    n_inputs: int
    n_modes: int

    @property
    def terms(self) -> int:
        """Number of values of poles and residues."""
        return 3 * self.n_terms * (1 + self.n_inputs)


@dataclass(frozen=True, slots=True, eq=False)
class _Forcing:
    """What excitations do at n times, each (n_excitations, n)."""

    omega: FloatArray  # rad/s; 1 where nothing is known
    known: FloatArray  # 1, or NaN where a speed is not known or zero, or the band is exceeded
    velocity: FloatArray  # m/s, root mean square, per response to a unit load; NaN if not known


@dataclass(frozen=True, slots=True, eq=False)
class _Responses:
    """Responses to unit loads at n angles, with real and imaginary parts as the first axis.

    They are sums of terms (a + i w b) / D with D = k - w^2 + i w c.
    """

    above: FloatArray  # (2, n_terms, n_excitations, n): a + i w b
    terms: FloatArray  # (2, n_terms, n_excitations, n)
    poles: FloatArray  # (3, n_terms, 1, n): k (both parts) and c
    sums: FloatArray  # (2, n_excitations, n)
    squares: FloatArray  # (n_excitations, n): squares of their magnitudes
    static: FloatArray  # (n_excitations, n): magnitudes of the static responses


class LevelTable:
    """Levels of vibration at any angle of a table.

    Parameters
    ----------
    predictor, mechanism : Predictor and Mechanism
        What looks up the table, and the mechanism of that table.
    excitations : sequence of Excitation

    Raises
    ------
    ExcitationError
        If a load acts where the table has no FRF.
    """

    def __init__(
        self, predictor: Predictor, mechanism: Mechanism, excitations: Sequence[Excitation]
    ) -> None:
        self._predictor, table = predictor, predictor.table
        inputs: dict[tuple[str, str], UnitLoad] = {}
        loads, which = [one.load for one in excitations], []
        for one, load in zip(excitations, loads, strict=True):
            if load is not None and not table.places:
                raise ExcitationError(
                    f"excitation {one.name} has an amplitude, but the table of "
                    f"{table.mechanism_name} has no FRFs to compute a level from; leave the "
                    "amplitude out."
                )
            key = ("", "") if load is None else (load.kind.value, load.place)
            if key not in inputs:
                inputs[key] = load_input(one, table, mechanism)
            which.append(list(inputs).index(key))
        self.states_uncertainty = table.uncertain or table.measured
        self._top, self._inputs = 2.0 * math.pi * table.band[1], np.array(which)
        self._sources = np.array([list(Source).index(one.source) for one in excitations])

        def column(values: list[float]) -> FloatArray:
            return np.array(values)[:, np.newaxis]

        self._omega = column([2.0 * math.pi * one.ratio for one in excitations])
        self._rms = column([x.amplitude / math.sqrt(2.0) if x else math.nan for x in loads])
        self._speed = column([load.speed if load else 1.0 for load in loads])
        self._exponent = column([load.exponent if load else 0.0 for load in loads])
        self._deviation = column([load.relative_stddev if load else 0.0 for load in loads])
        self._moved = column([one.relative_stddev for one in excitations])
        self._any_moved = bool(self._moved.any())
        self._soil = column([x is not None and x.kind is LoadKind.BASE_ACCELERATION for x in loads])
        self._loaded = any(loads)
        self._last: tuple[bytes, _Forcing] | None = None  # speeds, and what excitations do at them
        self._cells: tuple[FloatArray, FloatArray] | None = None
        if table.places:
            place = mechanism.response.point, mechanism.response.direction
            self._cells, self._layout = _sampled(table, list(inputs.values()), place)

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray, int, IntArray]:
        """Starts and cubics of the cells, the number of terms, and each excitation's input.

        Without FRFs there are neither cells nor terms.
        """
        if self._cells is None:
            return np.empty(0), np.empty((0, 4, 0)), 0, self._inputs
        return *self._cells, self._layout.n_terms, self._inputs

    def terms(self, alpha3: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return the terms (a + s b) / (k + c s + s^2) of the responses, those of the modes first.

        Parameters
        ----------
        alpha3 : ndarray, (n,)
            rad, in the table, which has FRFs.

        Returns
        -------
        poles : ndarray, (3, n_terms, n)
            Real and imaginary part of k, and c.
        residues : ndarray, (3, n_terms, n_inputs, n)
            Real and imaginary part of a, and b.
        inputs : ndarray of int, (n_excitations,)
            Which input each excitation has.
        """
        layout, values = self._layout, self._values(alpha3)
        kept, n = 3 * layout.n_terms, len(alpha3)
        poles = values[:kept].reshape(3, layout.n_terms, n)
        shape = 3, layout.n_terms, layout.n_inputs, n
        return poles, values[kept : layout.terms].reshape(shape), self._inputs

    def _values(self, angles: FloatArray) -> FloatArray:
        """Return the interpolated numbers at angles in the table, (n_values, n)."""
        assert self._cells is not None
        starts, cubics = self._cells
        i = np.maximum(starts.searchsorted(angles, side="right") - 1, 0)
        apart = (angles - starts.take(i))[:, np.newaxis]
        found = _cubic(cubics.take(i, axis=0).swapaxes(0, 1), apart)
        return np.ascontiguousarray(found.T)

    def at(self, alpha3: FloatArray, speeds: FloatArray, stddev: FloatArray) -> MessageColumns:
        """Return the levels at n angles, which are the float32 fields of ``Resonance.msg``.

        Outside the table they are not known. Standard deviations take the shapes of the modes as
        exact, and are not known where the first order is not enough.

        Parameters
        ----------
        alpha3, speeds : ndarray, (n,) and (n_sources, n)
            rad, and rpm or m/s of each `Source`; NaN where it is not known.
        stddev : ndarray, (2, n, n_modes)
            Standard deviations of natural frequencies over these, and of damping ratios.
        """
        m, n = len(self._inputs), len(alpha3)
        numbers = _unknown(m, n)
        if self._cells is not None:
            angles = angles_in_table(alpha3, self._predictor.table.alpha3_range)
            for start in range(0, n, _CHUNK):
                rows = slice(start, start + _CHUNK)
                values, forcing = self._values(angles[rows]), self._forcing(speeds[:, rows])
                self._evaluate(numbers[:, rows], values, forcing, stddev[:, rows])
        return _level_columns(numbers, m)

    def _forcing(self, speeds: FloatArray) -> _Forcing:
        """Return what excitations do at speeds, (n_sources, n), which often are the last ones."""
        key, last = speeds.tobytes(), self._last
        if last is None or last[0] != key:
            last = self._last = key, self._forcing_at(speeds)
        return last[1]

    def _forcing_at(self, speeds: FloatArray) -> _Forcing:
        with np.errstate(all="ignore"):
            speed = speeds[self._sources]
            omega = self._omega * speed
            known = np.where((speed > 0.0) & (omega <= self._top), 1.0, math.nan)
            omega = np.where(np.isnan(known), 1.0, omega)
            # An acceleration of the soil moves it by its amplitude / omega^2.
            factor = np.where(self._soil, 1.0 / omega, omega)
            rms = self._rms * (speed / self._speed) ** self._exponent
            return _Forcing(omega, known, rms * factor * known)

    def _responses(self, values: FloatArray, w: FloatArray) -> _Responses:
        """Return the responses at n angles and angular frequencies, (n_excitations, n)."""
        layout, n = self._layout, values.shape[1]
        kept = 3 * layout.n_terms
        poles = values[:kept].reshape(3, layout.n_terms, 1, n)
        above = values[kept : layout.terms].reshape(3, layout.n_terms, layout.n_inputs, n)
        above = above.take(self._inputs, axis=2)
        rest = values[layout.terms :].reshape(4, layout.n_inputs, n).take(self._inputs, axis=1)
        above[2] *= w
        above[1] += above[2]
        terms = _quotient(above[:2], poles[0] - w * w, poles[2] * w + poles[1])
        sums = np.add.accumulate(terms, axis=1)[:, -1]
        sums += rest[:2]
        sums[1] += rest[2] * w
        square = sums * sums
        return _Responses(above[:2], terms, poles, sums, square[0] + square[1], rest[3])

    def _evaluate(
        self,
        numbers: FloatArray,
        values: FloatArray,
        forcing: _Forcing,
        stddev: FloatArray,
    ) -> None:
        """Compute the rows of all levels at n angles in place.

        The standard deviations, (2, n, n_modes), are those that `at` takes.
        """
        at = _rows(len(self._inputs))
        w, responses = forcing.omega, self._responses(values, forcing.omega)
        magnitude = np.sqrt(responses.squares)
        static = responses.static
        np.divide(magnitude * forcing.known, static, out=numbers[at["amplifications"]])
        if not self._loaded:
            return
        velocity = np.multiply(magnitude, forcing.velocity, out=numbers[at["velocities"]])
        np.multiply(velocity, w, out=numbers[at["accelerations"]])
        unknown = 0.0 * np.fmax.reduce(velocity)  # NaN where no level is known
        heard = np.fmax(velocity, 0.0)
        total = np.sqrt(_sum(heard * heard))
        numbers[at["total_velocity"]] = total + unknown
        numbers[at["total_acceleration"]] = np.sqrt(_sum((heard * w) ** 2)) + unknown
        if self.states_uncertainty:
            deviations = np.ascontiguousarray(stddev.swapaxes(1, 2))
            each, together = self._spreads(values, forcing, responses, heard, total, deviations)
            numbers[at["velocity_stddevs"]] = each + 0.0 * velocity  # NaN where it is not known
            numbers[at["total_velocity_stddev"]] = together + unknown

    def _spreads(
        self,
        values: FloatArray,
        forcing: _Forcing,
        responses: _Responses,
        velocity: FloatArray,
        total: FloatArray,
        deviations: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return standard deviations of velocities, (n_excitations, n), and of their total, (n,).

        A velocity that is not known is 0.
        """
        magnitude = np.sqrt(responses.squares)
        factor, share = velocity / magnitude, velocity / np.maximum(total, _TINY)
        own = self._moved if self._any_moved else None
        moved = _deviated(responses, forcing.omega, deviations, own) * factor
        variance = _variances(moved, velocity, total)
        by_load = velocity * self._deviation
        by_load *= by_load
        if self._any_moved:
            by_load += self._by_own_frequencies(values, forcing, velocity)
        each = np.sqrt(variance[:-1] + by_load)
        together = np.sqrt(variance[-1] + _sum(by_load * share * share))
        # Where modes cancel, their shapes decide, whose deviations are not known.
        sizes = _sum(np.hypot(responses.terms[0], responses.terms[1]))
        cancelled = magnitude < _CANCELLED * sizes
        if np.count_nonzero(cancelled):
            each[cancelled] = math.nan
            together[(cancelled & (share > _NOTABLE)).any(axis=0)] = math.nan
        return each, together

    def _by_own_frequencies(
        self, values: FloatArray, forcing: _Forcing, velocity: FloatArray
    ) -> FloatArray:
        """Return variances of velocities, (n_excitations, n), by those of their frequencies."""
        sides = np.empty((2, *velocity.shape))
        for side, sign in zip(sides, (-1.0, 1.0), strict=True):
            size = 1.0 + sign * _REACH * self._moved
            magnitude = np.sqrt(self._responses(values, forcing.omega * size).squares)
            rms = forcing.velocity * np.where(self._soil, 1.0 / size, size)
            np.fmax(magnitude * rms, 0.0, out=side)
        return _variance(sides, velocity)


def _cubic(cell: FloatArray, t: float | FloatArray) -> FloatArray:
    return np.asarray(((cell[0] * t + cell[1]) * t + cell[2]) * t + cell[3])


def unknown_levels(n_excitations: int, n: int) -> MessageColumns:
    """Return levels at n angles that are not known."""
    return _level_columns(_unknown(n_excitations, n), n_excitations)


@cache
def _rows(m: int) -> dict[str, slice | int]:
    """Return the rows of each level of m excitations, which are the float32 fields.

    Those of each excitation have m rows, and those of all together one.
    """
    rows: dict[str, slice | int] = {}
    end = 0
    for field in message_fields(RESONANCE):
        if field.type == "float32":
            rows[field.name] = slice(end, end + m) if field.is_sequence else end
            end += m if field.is_sequence else 1
    return rows


@cache
def _n_rows(m: int) -> int:
    return sum(1 if isinstance(row, int) else m for row in _rows(m).values())


def _unknown(m: int, n: int) -> FloatArray:
    """Return the rows of all levels of m excitations at n angles, NaN."""
    return np.full((_n_rows(m), n), math.nan)


def _level_columns(numbers: FloatArray, m: int) -> MessageColumns:
    with np.errstate(over="ignore"):
        single = numbers.astype(np.float32)
    return MessageColumns(**{name: single[rows].T for name, rows in _rows(m).items()})


def _sum(terms: FloatArray) -> FloatArray:
    """Return the sum along the first axis, in its order; `np.sum` has others, by the shape."""
    return np.asarray(np.add.accumulate(terms)[-1])


def _quotient(above: FloatArray, real: FloatArray, imaginary: FloatArray) -> FloatArray:
    """Return a complex number, (2, ...), over another, as real and imaginary part.

    Parameters
    ----------
    above : ndarray, (2, ...)
        Real and imaginary part of the numerator.
    real, imaginary : ndarray, (...)
        Those of the denominator.
    """
    found, across = above * real, above * imaginary
    found[0] += across[1]
    found[1] -= across[0]
    found /= real * real + imaginary * imaginary
    return found


def _deviated(
    responses: _Responses, w: FloatArray, deviations: FloatArray, own: FloatArray | None
) -> FloatArray:
    """Return responses when one frequency or damping ratio deviates, (4 m, n_excitations, n).

    They are NaN where they do not show a resonance that is within reach of the deviations.

    The first 2 m have smaller and the others larger frequencies and damping ratios of the m modes,
    by the square root of three standard deviations.

    Parameters
    ----------
    responses, w : _Responses and ndarray, (n_excitations, n)
        Those without deviations, and the angular frequencies, rad/s.
    deviations : ndarray, (2, m, n)
        Standard deviations of the logarithms of frequencies, and of damping ratios.
    own : ndarray, (n_excitations, 1), optional
        Relative standard deviations of the frequencies of the excitations; None if all are 0.
    """
    m, n = deviations.shape[1:]
    above, poles = responses.above[:, :m], responses.poles[:, :m]
    step = _REACH * deviations[:, :, np.newaxis]
    k, c = np.empty((2, 2, 2, m, 1, n))  # smaller or larger; frequency or damping ratio
    ratio = np.sqrt(4.0 * poles[0]) * step[1]
    for sign, size, decay in ((0, 1.0 - step[0], -ratio), (1, 1.0 + step[0], ratio)):
        np.multiply(poles[0], size * size, out=k[sign, 0])
        np.multiply(poles[2], size, out=c[sign, 0])
        k[sign, 1] = poles[0]
        np.add(poles[2], decay, out=c[sign, 1])
    changed = _quotient(above[:, np.newaxis, np.newaxis], k - w * w, c * w + poles[1])
    rest = responses.sums[:, np.newaxis] - responses.terms[:, :m]
    changed += rest[:, np.newaxis, np.newaxis]
    changed *= changed
    stddev = deviations[0, :, np.newaxis]
    stddev = stddev if own is None else np.hypot(stddev, own)
    hidden = _hides_a_peak(above, responses.squares, poles, w, stddev)
    if np.count_nonzero(hidden):
        changed[0, :, 0][:, hidden] = math.nan
    return np.asarray(np.sqrt(changed[0] + changed[1]).reshape(4 * m, *w.shape))


def _hides_a_peak(
    above: FloatArray, size: FloatArray, poles: FloatArray, w: FloatArray, stddev: FloatArray
) -> BoolArray:
    """Return where a mode that may meet the excitation resonates too sharply for a few points.

    That is within three standard deviations, if the half-power half-width is less than two of
    them, and the mode's own response there is more than half of the present one.
    """
    twice = 2.0 * poles[0]
    found = np.abs(poles[0] - w * w) < 3.0 * stddev * twice
    found &= poles[2] * poles[2] < 8.0 * stddev * stddev * twice
    if np.count_nonzero(found):
        width, square = poles[2] * w, above * above
        found &= 4.0 * (square[0] + square[1]) > width * width * size
    return np.asarray(found)


def _variances(moved: FloatArray, velocities: FloatArray, total: FloatArray) -> FloatArray:
    """Return the variances of velocities and, last, of their total, (n_excitations + 1, n).

    Parameters
    ----------
    moved : ndarray, (4 m, n_excitations, n)
        Velocities if one mode deviates, as `_deviated` orders them.
    velocities, total : ndarray, (n_excitations, n) and (n,)
        Velocities and their total without deviations.
    """
    others = np.empty((len(moved), len(velocities) + 1, velocities.shape[1]))
    others[:, :-1] = moved
    np.sqrt(np.add.accumulate(moved * moved, axis=1)[:, -1], out=others[:, -1])
    return _variance(others, np.concatenate([velocities, total[np.newaxis]]))


def _variance(others: FloatArray, centre: FloatArray) -> FloatArray:
    """Return the variance of values by those of the modes, each on its own.

    Three points of Gauss and Hermite in each direction are exact for a cubic. It is NaN where the
    modes are so uncertain that they are not enough.

    Parameters
    ----------
    others, centre : ndarray, (4 m, ...) and (...)
        Values at the points on both sides, as `_deviated` returns them, and between them.
    """
    others -= centre
    half = len(others) // 2
    odd, even = others[half:] - others[:half], others[half:] + others[:half]
    odd *= odd
    even *= even
    first, second = np.add.reduce(odd) / 12.0, np.add.reduce(even) / 18.0
    total = first + second
    square = centre * centre
    known = (second <= _EVEN * first + _ROUNDING * square) & (total <= _LARGE * square)
    return np.where(known, total, math.nan)


def _sampled(
    table: Table, inputs: list[UnitLoad], place: tuple[str, str]
) -> tuple[tuple[FloatArray, FloatArray], _Layout]:
    """Return poles and residues of the responses to inputs over the stroke, as cubics.

    The cells begin at angles, (n_cells,), rad, and have coefficients, (n_cells, 4, n_values).
    """
    pieces, n_terms = [], 0
    for first, last in pairwise(table.alpha3[table.pieces].tolist()):
        samples = _Samples(table, inputs, place, (first, last))
        pieces.append(samples.refined())
        n_terms = max(n_terms, samples.n_terms)
    layout = _Layout(n_terms, len(inputs), table.n_modes)
    starts = np.concatenate([at[:-1] for at, _, _ in pieces])
    parts = [_cubics(at, _padded(values, layout), lost) for at, values, lost in pieces]
    return (starts, np.ascontiguousarray(np.concatenate(parts))), layout


def _spline(at: FloatArray, values: FloatArray) -> CubicSpline:
    """Return the spline through values, with 0 for those that are not known."""
    return CubicSpline(at, np.nan_to_num(values, nan=0.0))


def _cubics(at: FloatArray, values: FloatArray, lost: BoolArray) -> FloatArray:
    """Return the cubics between angles, (n_cells, 4, n_values); NaN where they are not known.

    Parameters
    ----------
    at, values : ndarray, (n_cells + 1,) and (n_cells + 1, n_values)
        rad, and the values there, NaN where they are not known.
    lost : ndarray of bool, (n_cells,)
        Where a cubic is not accurate.
    """
    unknown = np.isnan(values)
    unknown = unknown[:-1] | unknown[1:] | lost[:, np.newaxis]
    cubics = _spline(at, values).c.swapaxes(0, 1)
    return np.where(unknown[:, np.newaxis], math.nan, cubics)


def _padded(values: FloatArray, layout: _Layout) -> FloatArray:
    """Return the rows of a piece with terms of no effect, if other pieces have more."""
    own = (values.shape[1] - 4 * layout.n_inputs) // (3 * (1 + layout.n_inputs))
    missing = layout.n_terms - own
    if not missing:
        return values
    n = len(values)
    poles, above, rest = np.split(values, [3 * own, 3 * own * (1 + layout.n_inputs)], axis=1)
    poles = np.pad(poles.reshape(n, 3, own), ((0, 0), (0, 0), (0, missing)), constant_values=1.0)
    above = above.reshape(n, 3, own, layout.n_inputs)
    above = np.pad(above, ((0, 0), (0, 0), (0, missing), (0, 0)))
    return np.hstack([poles.reshape(n, -1), above.reshape(n, -1), rest])


class _Samples:
    """Poles and residues at the angles of one piece, with the modes of the table first."""

    def __init__(
        self,
        table: Table,
        inputs: list[UnitLoad],
        place: tuple[str, str],
        ends: tuple[float, float],
    ) -> None:
        self._table, self._inputs, self._place, self._ends = table, inputs, place, ends
        self._variables = stroke_variable(np.array(ends), table.toggles)
        self._places = list(dict.fromkeys(p for one in inputs for p in one.places))
        self._known: dict[float, FloatArray] = {}
        self.n_terms = 0

    def refined(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return angles, values, and the cells between them whose middle is not met."""
        cells = _FIRST_CELLS
        while True:
            at, values = self._along(2 * cells)
            found = _spline(at[::2], values[::2])(at[1::2])
            wrong = ~(self._errors(found, values[1::2]) <= ERROR)
            if not wrong.any() or cells >= _MOST_CELLS:
                return at, values, wrong.repeat(2)
            cells *= 2

    def _along(self, cells: int) -> tuple[FloatArray, FloatArray]:
        """Return the ends of equal cells in the stroke variable, rad, and the values there."""
        at = stroke_angle(
            np.linspace(self._variables[0], self._variables[1], cells + 1), self._table.toggles
        )
        at[[0, -1]] = self._ends
        roots: ComplexArray | None = None
        rows = []
        for alpha3 in at.tolist():
            row, roots = self._row(alpha3, roots)
            rows.append(row)
        return at, np.array(rows)

    def _row(self, alpha3: float, before: ComplexArray | None) -> tuple[FloatArray, ComplexArray]:
        """Return the values at an angle and its poles, in the order of those before."""
        table = self._table
        frf = table.frf(alpha3, [self._place], self._places)
        half = frf.decay / 2.0 + 0j
        roots: ComplexArray = np.asarray(np.sqrt(half * half - frf.stiffness) - half)
        n = table.n_modes
        frequencies, ratios = np.split(np.array(table.interpolate(alpha3)[0]), 2)
        modes = 2.0 * math.pi * frequencies * (-ratios + np.sqrt(ratios**2 - 1.0 + 0j))
        if before is None:
            order = _in_order(np.where(np.isnan(modes), roots[:n], modes), roots)
        else:
            order = _in_order(
                np.append(np.where(np.isnan(modes), before[:n], modes), before[n:]), roots
            )
        self.n_terms = len(roots)
        k, c = frf.stiffness[order], frf.decay[order]
        parts = [k.real, k.imag, c]
        columns, rests = [], []
        for one in self._inputs:
            which = [self._places.index(place) for place in one.places]
            own = type(frf)(
                frf.stiffness,
                frf.decay,
                frf.residues[:, which],
                frf.rates[:, which],
                frf.residual[:, which],
            )
            response, rate = one.response(own, alpha3)
            a, b = response.residues[0, 0, order], response.rates[0, 0, order]
            columns.append([a.real, a.imag, b.real])
            residual = complex(response.residual[0, 0])
            static = abs(complex((a / k).sum()) + residual)
            if not static > _STATIC * (float(np.abs(a / k).sum()) + abs(residual)):
                static = math.nan
            rests.append([residual.real, residual.imag, complex(rate[0, 0]).real, static])
        above = np.transpose(columns, (1, 2, 0))
        values = [*parts, above.ravel(), np.transpose(rests).ravel()]
        return np.concatenate(values), roots[order]

    def _errors(self, found: FloatArray, exact: FloatArray) -> FloatArray:
        """Return the error of responses at each angle, over the sums of sizes of terms.

        They are compared at the resonances of the modes.
        """
        layout = _Layout(self.n_terms, len(self._inputs), self._table.n_modes)
        values = [_responses(rows, layout, exact) for rows in (found, exact)]
        return np.asarray((np.abs(values[0][0] - values[1][0]) / values[1][1]).max(axis=(1, 2)))


def _in_order(wanted: ComplexArray, roots: ComplexArray) -> NDArray[np.int64]:
    """Return an order of all roots in which those nearest to the wanted ones come first."""
    rows, columns = linear_sum_assignment(np.abs(wanted[:, np.newaxis] - roots))
    first = columns[np.argsort(rows)]
    return np.append(first, np.setdiff1d(np.arange(len(roots)), first))


def _responses(
    rows: FloatArray, layout: _Layout, exact: FloatArray
) -> tuple[ComplexArray, FloatArray]:
    """Return responses at the resonances of other rows, (n, n_modes, n_inputs), and their sizes."""
    n, t = len(rows), layout.n_terms
    w = np.sqrt(exact[:, np.newaxis, : layout.n_modes]).swapaxes(1, 2)
    real, imaginary, decay = np.split(rows[:, : 3 * t], 3, axis=1)
    below = (real + 1j * imaginary)[:, np.newaxis] - w**2 + 1j * w * decay[:, np.newaxis]
    above = rows[:, 3 * t : layout.terms].reshape(n, 3, t, layout.n_inputs)
    a, b = (above[:, 0] + 1j * above[:, 1])[:, np.newaxis], above[:, 2][:, np.newaxis]
    terms = (a + 1j * w[..., np.newaxis] * b) / below[..., np.newaxis]
    rest = rows[:, layout.terms :].reshape(n, 4, 1, layout.n_inputs)
    residual = rest[:, 0] + 1j * rest[:, 1] + 1j * w * rest[:, 2]
    return terms.sum(axis=2) + residual, np.abs(terms).sum(axis=2) + np.abs(residual)
