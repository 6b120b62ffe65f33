# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How strongly excitations shake the response point and load pins and cylinders.

Both follow from the poles and residues of a table; `ground` computes those by the ground. Numbers
for one angle are those for many to the last bit, so complex numbers are pairs of arrays here, and
sums run in the order of the terms.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import linear_sum_assignment

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import Place
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import RESONANCE
from linkage_vibration.prediction.ensemble import GroundMembers, Members, draws
from linkage_vibration.prediction.excitation import Excitation, ExcitationError, LoadKind, Source
from linkage_vibration.prediction.ground import REASONS, GroundLevels, GroundTable
from linkage_vibration.prediction.loads import UnitLoad, load_input
from linkage_vibration.prediction.predictor import Predictor, angles_in_table
from linkage_vibration.table.interpolation import stroke_angle, stroke_variable
from linkage_vibration.table.table import Table

ERROR = 1e-4
"""Largest error of a response between the angles at which the table was evaluated, over the sum of
the magnitudes of its terms; where it is larger, levels are not known."""

FACTORS = {
    "velocity_factors": "velocities",
    "load_ratio_factors": "load_ratios",
    "total_velocity_factor": "total_velocity",
    "total_load_ratio_factor": "total_load_ratio",
    "warning_probability": "total_load_ratio",
}
"""How uncertain a level is, by fields of ``Resonance.msg``, and the level.

A factor is exp of the standard deviation of the level's logarithm over the ensemble, and the
probability is the share of its members whose level exceeds the limit of a warning."""

_STATIC = 1e-5  # of the magnitudes of its terms: a static response below is only rounding
_SAME = 1.0 - 1e-6  # of the square of a load ratio; a smaller difference is rounding
_KNOWN = 0.95  # Factors are known where at least this share of the members is.
_SILENT = 1e-300  # A smaller level has no logarithm.
_FIRST_CELLS, _MOST_CELLS = 32, 512  # of a piece of the table
_GROUND = list(Source).index(Source.GROUND)
_REASONS = np.array(REASONS)
_CHUNK = 64  # angles that are evaluated together, so that their terms stay in the cache


@dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    """How interpolated numbers are arranged.

    First come k (real and imaginary part) and c of the terms; then, for each term, output and
    input, a (both parts) and b; then, for each output and input, the residual (both parts) and its
    rate; then, for each input, the size of the static response of the first output; and last, the
    reference force of each pin and cylinder.
    """

    n_terms: int
    n_outputs: int
    n_inputs: int
    n_forces: int

    def split(self, values: FloatArray) -> list[FloatArray]:
        """Return the parts of values, (n_values, n), as arrays whose last axis is n."""
        t, o, i, n = self.n_terms, self.n_outputs, self.n_inputs, values.shape[1]
        parts, end = [], 0
        for shape in ((3, t), (3, t, o, i), (3, o, i), (i,), (self.n_forces,)):
            begin, end = end, end + math.prod(shape)
            parts.append(values[begin:end].reshape(*shape, n))
        return parts


@dataclass(frozen=True, slots=True, eq=False)
class _Forcing:
    """What excitations do at n times, each (n_excitations, n)."""

    omega: FloatArray  # rad/s; 1 where nothing is known
    defined: FloatArray  # 1, or NaN where a speed is not known or the band is exceeded
    size: FloatArray  # rms of the load, as the multiple of a unit load; NaN if not known


class LevelTable:
    """Levels of vibration at any angle of a table.

    Parameters
    ----------
    predictor, mechanism : Predictor and Mechanism
        What looks up the table, and the mechanism of that table.
    excitations : sequence of Excitation
    with_forces : bool
        Whether to compute load ratios, too.

    Raises
    ------
    ExcitationError
        If a load acts where the table has no FRF.
    """

    def __init__(
        self,
        predictor: Predictor,
        mechanism: Mechanism,
        excitations: Sequence[Excitation],
        *,
        with_forces: bool = True,
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
        accelerated = [x is not None and x.kind is LoadKind.BASE_ACCELERATION for x in loads]
        self._accelerated = np.array(accelerated)[:, np.newaxis]
        self._loaded = any(one.load or one.terrain for one in excitations)
        self._ground: GroundTable | None = None
        self._terrain = next((i for i, one in enumerate(excitations) if one.terrain), 0)
        self._last: tuple[bytes, _Forcing] | None = None  # speeds, and what excitations do at them
        self._cells: tuple[FloatArray, FloatArray] | None = None
        self.force_places = table.force_places if self._loaded and with_forces else ()
        """Pins and cylinders, whose names are those of the table."""
        if table.places:
            # The response point comes first, then the components of the forces.
            rows = table.forces if self.force_places else ()
            self._first_rows = [[name for name, _ in rows].index(one) for one in self.force_places]
            outputs = [(mechanism.response.point, mechanism.response.direction), *rows]
            n_forces = len(self.force_places)
            self._cells, self._layout = _sampled(table, list(inputs.values()), outputs, n_forces)
            terrain = excitations[self._terrain].terrain
            if terrain is not None:
                self._ground = GroundTable(table, mechanism, terrain, rows)
        self._members: Members | None = None
        self._ground_members: GroundMembers | None = None
        if self._loaded and len(table.ensemble_alpha3):
            each = [list(inputs.values())[i] for i in which]
            self._members = Members(table, each, outputs, n_forces, self._table_responses)
            amplitudes, frequencies = draws(excitations, self._members.n)
            amplitudes /= np.where(self._accelerated, frequencies**2, 1.0)
            self._draws = amplitudes, frequencies
            if self._ground is not None and terrain is not None and not self._ground.never:
                self._ground_members = GroundMembers(
                    table, mechanism, terrain, outputs, self._ground.lines
                )

    @property
    def alpha3_range(self) -> tuple[float, float]:
        """First and last angle of the table, rad."""
        return self._predictor.table.alpha3_range

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray, int, IntArray]:
        """Starts and cubics of the cells, the number of terms, and each excitation's input.

        Without FRFs there are neither cells nor terms.
        """
        if self._cells is None:
            return np.empty(0), np.empty((0, 4, 0)), 0, self._inputs
        return *self._cells, self._layout.n_terms, self._inputs

    def _values(self, angles: FloatArray) -> FloatArray:
        """Return the interpolated numbers at angles in the table, (n_values, n)."""
        assert self._cells is not None
        starts, cubics = self._cells
        i = np.maximum(starts.searchsorted(angles, side="right") - 1, 0)
        apart = (angles - starts.take(i))[:, np.newaxis]
        found = _cubic(cubics.take(i, axis=0).swapaxes(0, 1), apart)
        return np.ascontiguousarray(found.T)

    def at(self, alpha3: FloatArray, speeds: FloatArray) -> MessageColumns:
        """Return the levels at n angles, which are the float32 fields of ``Resonance.msg``.

        Outside the table they are not known. Their `FACTORS` are NaN here. Other columns are
        ``ground_unknown``, (n,), and beside those of the message ``load_places``, (n,
        n_excitations), and ``total_load_places``, (n,), the indices of the pins and cylinders where
        the load ratios are largest.

        Parameters
        ----------
        alpha3, speeds : ndarray, (n,) and (n_sources, n)
            rad, and rpm or m/s of each `Source`; NaN where it is not known.
        """
        m, n = len(self._inputs), len(alpha3)
        found = _unknown(m, n), np.zeros((m + 1, n), np.int64), np.zeros(n, np.int8)
        if self._cells is not None:
            angles = angles_in_table(alpha3, self._predictor.table.alpha3_range)
            for start in range(0, n, _CHUNK):
                rows = slice(start, start + _CHUNK)
                parts = self._layout.split(self._values(angles[rows]))
                forcing = self._forcing(speeds[:, rows])
                squares = _squares(self._responses(parts, forcing.omega, self._inputs))
                levels = [part[..., rows] for part in found]
                self._levels(levels, squares, parts, forcing, angles[rows], speeds[_GROUND, rows])
        return _level_columns(*found)

    def over(self, alpha3: FloatArray, speeds: FloatArray) -> MessageColumns:
        """Return the levels `at` each of n angles with each of k speeds, (n k), angle by angle.

        What does not change with the speeds is computed once for each angle.

        Parameters
        ----------
        alpha3, speeds : ndarray, (n,) and (n_sources, k)
            As those of `at`.
        """
        m, n, k = len(self._inputs), len(alpha3), speeds.shape[1]
        found = _unknown(m, n * k), np.zeros((m + 1, n * k), np.int64), np.zeros(n * k, np.int8)
        if self._cells is not None:
            angles, forced = angles_in_table(alpha3, self.alpha3_range), self._forcing_at(speeds)
            omega = forced.omega
            changes = np.flatnonzero((omega != omega[:, :1]).any(axis=1))
            for start in range(0, n, _CHUNK):
                here = angles[start : start + _CHUNK]
                parts = self._layout.split(self._values(here))
                first = _squares(self._responses(parts, omega[:, :1], self._inputs))
                squares = np.repeat(first[..., np.newaxis], k, axis=-1)
                for i in range(k if len(changes) else 0):
                    w, inputs = omega[changes, i, np.newaxis], self._inputs[changes]
                    squares[..., i][:, changes] = _squares(self._responses(parts, w, inputs))
                tiled = [np.tile(x, len(here)) for x in (omega, forced.defined, forced.size)]
                self._levels(
                    [part[..., start * k : (start + len(here)) * k] for part in found],
                    squares.reshape(*first.shape[:2], -1),
                    [np.repeat(part, k, axis=-1) for part in parts[3:]],
                    _Forcing(*tiled),
                    np.repeat(here, k),
                    np.tile(speeds[_GROUND], len(here)),
                )
        return _level_columns(*found)

    def _levels(
        self,
        found: Sequence[NDArray[Any]],
        squares: FloatArray,
        parts: Sequence[FloatArray],
        forcing: _Forcing,
        angles: FloatArray,
        ground_speed: FloatArray,
    ) -> None:
        """Compute rows of levels, places and reasons of the ground, each (..., n), in place.

        The squares are those of responses to unit loads, (n_outputs, n_excitations, n), and the
        last parts are those of `_Layout`.
        """
        numbers, places, reasons = found
        *_, static, reference = parts
        magnitude, at = np.sqrt(squares[0]) * forcing.defined, _rows(len(self._inputs))
        np.divide(magnitude, static.take(self._inputs, axis=0), out=numbers[at["amplifications"]])
        ground = None
        if self._ground is not None:
            ground = self._ground.at(angles, ground_speed)
            reasons[:] = ground.reason
        self._evaluate(numbers, places, squares, reference, forcing, ground)

    def members(self, alpha3: FloatArray, speeds: FloatArray) -> FloatArray:
        """Return the rows of all levels of each member of the ensemble, (n_rows, n_members, n).

        Without an ensemble there is no member.

        Parameters
        ----------
        alpha3, speeds : ndarray, (n,) and (n_sources, n)
            As those of `at`.
        """
        m, members = len(self._inputs), self._members
        numbers = np.full((_n_rows(m), self.n_members, len(alpha3)), math.nan)
        if members is None:
            return numbers
        places = np.zeros((m + 1, members.n), np.int64)
        angles = angles_in_table(alpha3, self._predictor.table.alpha3_range)
        for i in np.flatnonzero(np.isfinite(angles)).tolist():
            nominal, angle = self._forcing_at(speeds[:, i : i + 1]), float(angles[i])
            omega = nominal.omega * self._draws[1]
            forcing = _Forcing(omega, nominal.defined, nominal.size * self._draws[0])
            found = members.responses(angle, omega)
            squares = found.real**2 + found.imag**2
            reference, ground = members.references(angle), None
            if self._ground is not None:
                speed = speeds[_GROUND, i : i + 1]
                ground = self._ground.at(angles[i : i + 1], speed)
                if self._ground_members is not None and not ground.reason[0]:
                    factors = self._draws[0][self._terrain]
                    ground = self._ground_members.levels(ground, angle, float(speed[0]), factors)
            self._evaluate(numbers[:, :, i], places, squares, reference, forcing, ground)
        return numbers

    def member_totals(
        self, alpha3: FloatArray, speeds: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the total load ratio and total velocity of each member, (n_members, n).

        Parameters
        ----------
        alpha3, speeds : ndarray, (n,) and (n_sources, n)
            As those of `at`.
        """
        numbers, at = self.members(alpha3, speeds), _rows(len(self._inputs))
        return numbers[at["total_load_ratio"]], numbers[at["total_velocity"]]

    @property
    def n_members(self) -> int:
        """Number of members of the ensemble by which factors are known, or 0."""
        return 0 if self._members is None else self._members.n

    def factors(
        self, alpha3: FloatArray, speeds: FloatArray, limit: float
    ) -> dict[str, NDArray[np.float32]]:
        """Return the `FACTORS` of levels at n angles, (n,) or (n, n_excitations).

        They are NaN where fewer than 95 % of the members are known.

        Parameters
        ----------
        alpha3, speeds : ndarray, (n,) and (n_sources, n)
            As those of `at`.
        limit : float
            Of the total load ratio, above which a warning begins.
        """
        numbers, at = self.members(alpha3, speeds), _rows(len(self._inputs))
        if not self.n_members:
            numbers = np.full((len(numbers), 1, len(alpha3)), math.nan)
        found = {}
        with np.errstate(all="ignore"):
            for name, level in FACTORS.items():
                values = numbers[at[level]]
                if name == "warning_probability":
                    factors = _mean(np.where(np.isnan(values), values, values > limit))
                else:
                    logs = np.log(np.maximum(values, _SILENT))
                    logs -= _mean(logs)[..., np.newaxis, :]
                    factors = np.exp(np.sqrt(_mean(logs * logs)))
                found[name] = factors.T.astype(np.float32)
        return found

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
            defined = np.where((speed >= 0.0) & (omega <= self._top), 1.0, math.nan)
            omega = np.where(np.isnan(defined), 1.0, omega)
            size = self._rms * (speed / self._speed) ** self._exponent
            # The unit load of the soil is a displacement, of which this is the acceleration.
            size = np.where(self._accelerated, size / (omega * omega), size)
            size = np.where(speed == 0.0, 0.0 * self._rms, size)
            return _Forcing(omega, defined, size * defined)

    def _responses(
        self, parts: Sequence[FloatArray], w: FloatArray, inputs: IntArray
    ) -> FloatArray:
        """Return responses to unit loads, (2, n_outputs, n_excitations, n): both parts.

        They are sums of terms (a + i w b) / D with D = k - w^2 + i w c, at n angles, whose poles,
        numerators and residuals come first in the parts of `_Layout`, and angular frequencies w,
        (n_excitations, n or 1), of excitations that act at these inputs.
        """
        poles, above, rest, *_ = parts
        poles, above = poles[:, :, np.newaxis, np.newaxis], above.take(inputs, axis=3)
        above[2] *= w
        above[1] += above[2]
        terms = _quotient(above[:2], poles[0] - w * w, poles[2] * w + poles[1])
        sums = np.add.accumulate(terms, axis=1)[:, -1]
        rest = rest.take(inputs, axis=2)
        sums += rest[:2]
        sums[1] += rest[2] * w
        return np.asarray(sums)

    def _table_responses(self, alpha3: float, omega: FloatArray) -> ComplexArray:
        """Return responses to unit loads at an angle, (n_outputs, n_excitations), at rad/s."""
        parts = self._layout.split(self._values(np.array([alpha3])))
        real, imaginary = self._responses(parts, omega[:, np.newaxis], self._inputs)[..., 0]
        return np.asarray(real + 1j * imaginary)

    def _evaluate(
        self,
        numbers: FloatArray,
        places: IntArray,
        squares: FloatArray,
        reference: FloatArray,
        forcing: _Forcing,
        ground: GroundLevels | None,
    ) -> None:
        """Compute the rows of levels at n angles, and where load ratios are largest, in place.

        Parameters
        ----------
        numbers, places : ndarray
            Rows of all levels, (n_rows, n), and the places, (n_excitations + 1, n), of each
            excitation and of the total.
        squares, reference : ndarray, (n_outputs, n_excitations, n) and (n_forces, n)
            Squares of responses to unit loads; what forces are compared with, N.
        forcing : _Forcing
        """
        if not self._loaded:
            return
        at, w = _rows(len(self._inputs)), forcing.omega
        magnitude = np.sqrt(squares[0])
        velocity = np.multiply(magnitude * forcing.size, w, out=numbers[at["velocities"]])
        acceleration = np.multiply(velocity, w, out=numbers[at["accelerations"]])
        if ground is not None:
            velocity[self._terrain], acceleration[self._terrain] = (
                ground.velocity,
                ground.acceleration,
            )
            numbers[at["off_ground_share"]] = ground.off_ground_share
        unknown = 0.0 * np.fmax.reduce(velocity)  # NaN where no level is known
        for name, known in ("velocity", velocity), ("acceleration", acceleration):
            total = np.sqrt(_sum(np.fmax(known, 0.0) ** 2))
            numbers[at[f"total_{name}"]] = total + unknown
        if not self.force_places:
            return
        forces = np.add.reduceat(squares[1:], self._first_rows, axis=0)  # of x and z, or along
        ratios = forces * (forcing.size * forcing.size)
        if ground is not None:
            ratios[:, self._terrain] = np.add.reduceat(ground.forces2, self._first_rows, axis=0)
        ratios /= (reference * reference)[:, np.newaxis]
        total = np.add.accumulate(np.fmax(ratios, 0.0), axis=1)[:, -1]
        places[:-1], places[-1] = first_largest(ratios), first_largest(total)
        np.sqrt(np.maximum.reduce(ratios), out=numbers[at["load_ratios"]])
        lost = 0.0 * np.maximum.reduce(reference)  # NaN where nothing is known to refer to
        numbers[at["total_load_ratio"]] = np.sqrt(np.maximum.reduce(total)) + unknown + lost


def _squares(responses: FloatArray) -> FloatArray:
    """Return squares of magnitudes, (...), of real and imaginary parts, (2, ...), in place."""
    responses *= responses
    return np.asarray(responses[0] + responses[1])


def first_largest(values: FloatArray) -> IntArray:
    """Return the first row of values, (n_rows, ...), that is the largest but for rounding.

    Both pins of a light link carry the same force, so that the last bit would decide.
    """
    return np.asarray((values >= _SAME * np.maximum.reduce(values)).argmax(axis=0))


def _cubic(cell: FloatArray, t: float | FloatArray) -> FloatArray:
    return np.asarray(((cell[0] * t + cell[1]) * t + cell[2]) * t + cell[3])


def unknown_levels(n_excitations: int, n: int) -> MessageColumns:
    """Return levels at n angles that are not known."""
    places = np.zeros((n_excitations + 1, n), np.int64)
    return _level_columns(_unknown(n_excitations, n), places, np.zeros(n, np.int8))


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


def _level_columns(
    numbers: FloatArray, places: IntArray, reasons: NDArray[np.int8]
) -> MessageColumns:
    """Return levels by their names, the places, (n_excitations + 1, n), of load ratios, and why.

    The reasons, (n,), are those why the level of the ground is not known.
    """
    with np.errstate(over="ignore"):
        single = numbers.astype(np.float32)
    return MessageColumns(
        **{name: single[rows].T for name, rows in _rows(len(places) - 1).items()},
        warning_probability=np.full(numbers.shape[1], math.nan),
        load_places=places[:-1].T,
        total_load_places=places[-1],
        ground_unknown=_REASONS.take(reasons),
    )


def _sum(terms: FloatArray) -> FloatArray:
    """Return the sum along the first axis, in its order; `np.sum` has others, by the shape."""
    return np.asarray(np.add.accumulate(terms)[-1])


def _mean(values: FloatArray) -> FloatArray:
    """Return the mean over members, (..., n), of (..., n_members, n); NaN if too few are known."""
    known = ~np.isnan(values)
    count = np.add.accumulate(known, axis=-2, dtype=float)[..., -1, :]
    mean = np.add.accumulate(np.where(known, values, 0.0), axis=-2)[..., -1, :] / count
    return np.where(count >= _KNOWN * values.shape[-2], mean, math.nan)


def _quotient(above: FloatArray, real: FloatArray, imaginary: FloatArray) -> FloatArray:
    """Return a complex number, (2, ...), over another, as real and imaginary part.

    Parameters
    ----------
    above : ndarray, (2, ...)
        Real and imaginary part of the numerator.
    real, imaginary : ndarray, (...)
        Those of the denominator.
    """
    square = real * real + imaginary * imaginary
    real, imaginary = real / square, imaginary / square
    quotient, across = above * real, above * imaginary
    quotient[0] += across[1]
    quotient[1] -= across[0]
    return quotient


def _sampled(
    table: Table, inputs: list[UnitLoad], outputs: list[Place], n_forces: int
) -> tuple[tuple[FloatArray, FloatArray], _Layout]:
    """Return poles and residues of the responses to inputs over the stroke, as cubics.

    The cells begin at angles, (n_cells,), rad, and have coefficients, (n_cells, 4, n_values).
    Beside the outputs, they have the reference forces of n_forces pins and cylinders.
    """
    pieces = []
    for first, last in pairwise(table.alpha3[table.pieces].tolist()):
        samples = _Samples(table, inputs, outputs, n_forces, (first, last))
        pieces.append((*samples.refined(), samples.layout))
    layout = max((piece[3] for piece in pieces), key=lambda layout: layout.n_terms)
    starts = np.concatenate([piece[0][:-1] for piece in pieces])
    parts = [
        _cubics(at, _padded(values, its_layout, layout.n_terms), lost)
        for at, values, lost, its_layout in pieces
    ]
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


def _padded(values: FloatArray, layout: _Layout, n_terms: int) -> FloatArray:
    """Return the rows of a piece with terms of no effect, if other pieces have more."""
    missing = n_terms - layout.n_terms
    poles, above, *rest = layout.split(np.ascontiguousarray(values.T))
    poles = np.pad(poles, ((0, 0), (0, missing), (0, 0)), constant_values=1.0)
    above = np.pad(above, ((0, 0), (0, missing), (0, 0), (0, 0), (0, 0)))
    n = len(values)
    return np.concatenate([part.reshape(-1, n) for part in (poles, above, *rest)]).T


class _Samples:
    """Poles and residues at the angles of one piece, with the modes of the table first."""

    def __init__(
        self,
        table: Table,
        inputs: list[UnitLoad],
        outputs: list[Place],
        n_forces: int,
        ends: tuple[float, float],
    ) -> None:
        self._table, self._inputs, self._outputs, self._ends = table, inputs, outputs, ends
        self._n_forces = n_forces
        self._variables = stroke_variable(np.array(ends), table.toggles)
        self._places = list(dict.fromkeys(p for one in inputs for p in one.places))
        self._n_terms = 0
        self._solved: dict[float, tuple[FloatArray, FloatArray, FloatArray]] = {}

    @property
    def layout(self) -> _Layout:
        """How the values are arranged, once there are some."""
        return _Layout(self._n_terms, len(self._outputs), len(self._inputs), self._n_forces)

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
        # Half of the angles of a finer division are those of the coarser one.
        if alpha3 not in self._solved:
            self._solved[alpha3] = self._responses_at(alpha3)
        poles, above, others = self._solved[alpha3]
        half = poles[2] / 2.0
        roots: ComplexArray = np.asarray(np.sqrt(half * half - poles[0] - 1j * poles[1]) - half)
        n = self._table.n_modes
        frequencies, ratios = np.split(np.array(self._table.interpolate(alpha3)[0]), 2)
        wanted = 2.0 * math.pi * frequencies * (-ratios + np.sqrt(ratios**2 - 1.0 + 0j))
        previous = roots if before is None else before
        wanted = np.where(np.isnan(wanted), previous[:n], wanted)
        order = _in_order(wanted if before is None else np.append(wanted, before[n:]), roots)
        self._n_terms = len(roots)
        row = np.concatenate([poles[:, order].ravel(), above[:, order].ravel(), others])
        return row, roots[order]

    def _responses_at(self, alpha3: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return poles, numerators and all other values at an angle, as `_Layout` arranges them."""
        table = self._table
        frf = table.frf(alpha3, self._outputs, self._places)
        numerators, rests, statics = [], [], []
        for load in self._inputs:
            which = [self._places.index(place) for place in load.places]
            part = replace(
                frf,
                residues=frf.residues[:, which],
                rates=frf.rates[:, which],
                residual=frf.residual[:, which],
            )
            response, rate = load.response(part, alpha3)
            a, b, residual = response.residues[:, 0], response.rates[:, 0], response.residual[:, 0]
            numerators.append([a.real, a.imag, b.real])
            rests.append([residual.real, residual.imag, rate[:, 0].real])
            terms = a[0] / frf.stiffness
            static = abs(complex(terms.sum() + residual[0]))
            known = static > _STATIC * float(np.abs(terms).sum() + abs(residual[0]))
            statics.append(static if known else math.nan)
        forces = table.reference_forces(np.array([alpha3]))[: self._n_forces]
        others = np.transpose(rests, (1, 2, 0)), statics, forces
        return (
            np.array([frf.stiffness.real, frf.stiffness.imag, frf.decay]),
            np.transpose(numerators, (1, 3, 2, 0)),
            np.concatenate([np.ravel(part) for part in others]),
        )

    def _errors(self, trial: FloatArray, exact: FloatArray) -> FloatArray:
        """Return the error of responses at each angle, over the sums of sizes of terms.

        They are compared at the resonances of the modes.
        """
        layout, n_modes = self.layout, self._table.n_modes
        w = np.sqrt(exact[:, np.newaxis, :n_modes]).swapaxes(1, 2)
        errors = np.zeros(len(exact))
        for output in range(layout.n_outputs):
            values, _ = _responses(trial, layout, output, w)
            true, sizes = _responses(exact, layout, output, w)
            np.maximum(errors, (np.abs(values - true) / sizes).max(axis=(1, 2)), out=errors)
        return errors


def _in_order(wanted: ComplexArray, roots: ComplexArray) -> NDArray[np.int64]:
    """Return an order of all roots in which those nearest to the wanted ones come first."""
    rows, columns = linear_sum_assignment(np.abs(wanted[:, np.newaxis] - roots))
    first = columns[np.argsort(rows)]
    return np.append(first, np.setdiff1d(np.arange(len(roots)), first))


def _responses(
    rows: FloatArray, layout: _Layout, output: int, w: FloatArray
) -> tuple[ComplexArray, FloatArray]:
    """Return responses of an output at angular frequencies w, (n, n_frequencies, 1), and sizes.

    Both are (n, n_frequencies, n_inputs); the sizes are the sums of the magnitudes of the terms.
    """
    poles, above, rest, _, _ = layout.split(np.ascontiguousarray(rows.T))
    k, c = (poles[0] + 1j * poles[1]).T[:, np.newaxis], poles[2].T[:, np.newaxis]
    above, rest = above[:, :, output].T, rest[:, output].T  # (n, n_inputs, n_terms, 3), ...
    a, b = above[..., 0] + 1j * above[..., 1], above[..., 2]
    below = (k - w**2 + 1j * w * c)[:, :, np.newaxis]
    terms = (a[:, np.newaxis] + 1j * w[..., np.newaxis] * b[:, np.newaxis]) / below
    residual = (rest[..., 0] + 1j * rest[..., 1])[:, np.newaxis]
    residual = residual + 1j * w * rest[:, np.newaxis, :, 2]
    return terms.sum(axis=3) + residual, np.abs(terms).sum(axis=3) + np.abs(residual)
