# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How strongly excitations shake the response point and load pins and cylinders.

Both follow from the poles and residues of a table; `ground` computes those by the ground. Numbers
for one angle are those for many to the last bit, so sums run in the order of the terms, and each
product of matrices belongs to one angle.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray, IntArray, runs
from linkage_vibration.mechanics.description import Chain, Mechanism
from linkage_vibration.mechanics.forces import tyre_place
from linkage_vibration.mechanics.model import Place
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.prediction.ensemble import EnsembleResponses, GroundMembers, load_factors
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.ground import (
    MAX_OFF_GROUND,
    REASONS,
    GroundLevels,
    GroundTable,
    Reals,
    lateral_mounts,
    off_ground_share,
)
from linkage_vibration.prediction.level_cache import Arrays, Keep, Kept, computed, level_cache
from linkage_vibration.prediction.loads import (
    ExcitationError,
    Load,
    UnitLoad,
    load_input,
    load_powers,
    unit_sizes,
    weights_at,
)
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.table.interpolation import angles_in_table, stroke_angle, stroke_variable
from linkage_vibration.table.table import Table

MAX_RESPONSE_ERROR = 1e-4
"""Largest error of a response between the angles at which the table was evaluated, over the sum of
the magnitudes of its terms; where it is larger, levels are not known."""

DEVIATION_FIELDS = {
    "velocity_factors": "velocities",
    "load_ratio_factors": "load_ratios",
    "total_velocity_factor": "total_velocity",
    "total_load_ratio_factor": "total_load_ratio",
    "warning_probability": "total_load_ratio",
}
"""How uncertain a level is, by fields of ``Resonance.msg``, and the level.

A factor is exp of the standard deviation of the level's logarithm over the ensemble, and the
probability is the share of its members whose level exceeds the limit of a warning."""

_OF_EACH = (
    *("velocities", "accelerations", "velocity_factors", "amplifications"),
    *("load_ratios", "load_ratio_factors"),
)
_OF_ALL = (
    *("total_velocity", "total_acceleration", "total_velocity_factor", "total_load_ratio"),
    *("total_load_ratio_factor", "warning_probability", "off_ground_share"),
)
_TOTALS = {
    "velocities": "total_velocity",
    "accelerations": "total_acceleration",
    "load_ratios": "total_load_ratio",
}
_MIN_KNOWN_SHARE = 0.95  # Factors are known where at least this share of the members is.
_MIN_STATIC_SHARE = 1e-5  # of the sizes of its terms; a smaller static response is rounding
_SAME_SQUARE = 1.0 - 1e-6  # of the square of a load ratio; a smaller difference is rounding
_SILENT = 1e-30  # A smaller level has no logarithm.
_FIRST_CELLS, _MOST_CELLS = 32, 512  # of a piece of the table
_NARROWEST = 1e-9  # rad; narrower cells are not divided
_MOST_DIVIDED = 32  # ranges that are divided further, each of which takes about a second
_GROUND = Source.GROUND.index
_REASONS = np.array(REASONS)
_UNITS = np.array([1.0, 1j])
# Angles that are evaluated together, so that their terms stay in the cache; those of all members
_CHUNK, _MEMBERS_CHUNK = 64, 8


@dataclass(frozen=True, slots=True, eq=False)
class _Layout:
    """How interpolated numbers are arranged.

    k (both parts) and c of terms; of each term, output and input a (both parts) and b; of each
    output and input the residual (both parts) and its rate; static responses; reference forces.
    """

    n_terms: int
    n_outputs: int
    n_inputs: int
    n_forces: int

    @property
    def shapes(self) -> tuple[tuple[int, ...], ...]:
        """Shapes of the parts."""
        t, o, i = self.n_terms, self.n_outputs, self.n_inputs
        return (3, t), (3, t, o, i), (3, o, i), (i,), (self.n_forces,)

    @property
    def n_values(self) -> int:
        """Number of values at an angle."""
        return sum(math.prod(shape) for shape in self.shapes)

    def split(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Return the parts of values, (n_values, n), as arrays whose last axis is n."""
        ends = np.cumsum([math.prod(shape) for shape in self.shapes])
        parts = zip(np.split(values, ends[:-1]), self.shapes, strict=True)
        return [part.reshape(*shape, values.shape[1]) for part, shape in parts]

    def order(self, values: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the rows of `_Terms.matrices` that are not zero, and the places of its values."""
        parts = self.split(np.arange(self.n_values)[:, np.newaxis])
        poles, above, rest, *others = (part[..., 0] for part in parts)
        rows = np.concatenate([above.reshape(-1, self.n_outputs, self.n_inputs), rest])
        nonzero = np.asarray(values.any(axis=0))
        used = np.flatnonzero(nonzero[rows].any(axis=(1, 2)))
        matrices = rows[used].transpose(2, 0, 1)
        return used, np.concatenate([part.ravel() for part in (poles, *others, matrices)])


class _Terms(NamedTuple):
    """What is interpolated at angles: responses are sums of terms (a + i w b) / (k - w^2 + i w c).

    The rows of the matrices are of the real part of a, its imaginary part, and b of all terms, then
    of the residual (both parts) and its rate; rows without numbers are left out.
    """

    poles: FloatArray  # (..., 3, n_terms): both parts of k, and c
    matrices: FloatArray  # (..., n_inputs, n_rows, n_outputs)
    static: FloatArray  # (..., n_inputs): size of the static response of the first output
    reference: FloatArray  # (..., n_forces): reference forces of pins, cylinders and tyres, N


class _Forcing(NamedTuple):
    """What excitations do at n times, each (n, n_excitations)."""

    omega: Reals  # rad/s; 1 where nothing is known
    defined: Reals  # 1, or NaN where a speed is not known or the band is exceeded
    size: Reals  # rms of the load, as the multiple of a unit load; NaN if not known


class _Half:
    """Responses of the vertical or the lateral half to its excitations, over the stroke."""

    def __init__(
        self,
        table: Table,
        loads: list[UnitLoad],
        which: IntArray,
        outputs: Sequence[Place],
        n_forces: int,
        keep: Kept,
    ) -> None:
        self.table, self._which = table, which  # indices of loads, -1 in the other half
        self.excitations, self._own = np.flatnonzero(which >= 0), which[which >= 0]
        own = [i for i, place in enumerate(outputs) if place in table.frf_outputs]
        self.outputs = np.array(own)
        self._places = [outputs[i] for i in self.outputs]
        kept = keep(lambda: _sampled(table, loads, self._places, n_forces))
        self.cells, self.order = (kept["starts"], kept["cubics"]), kept["order"]
        layout = self.layout = _Layout(*kept["layout"].tolist())
        self._rows, cubics = kept["rows"], kept["cubics"]
        ends = np.cumsum([3 * layout.n_terms, layout.n_inputs, layout.n_forces]).tolist()
        self._parts = [slice(*each) for each in pairwise([0, *ends])]
        self._numbers = np.ascontiguousarray(cubics[:, :, : ends[-1]])
        # A product for each input is so small that BLAS uses one thread.
        blocks = cubics[:, :, ends[-1] :].reshape(len(cubics), 4, layout.n_inputs, -1)
        self._blocks = blocks.swapaxes(1, 2)

    def of(self, excitations: IntArray) -> tuple[IntArray, IntArray]:
        """Return which of excitations act in this half, and the indices of their loads."""
        if len(excitations) == len(self._which):
            return self.excitations, self._own
        which = self._which[excitations]
        return np.flatnonzero(which >= 0), which[which >= 0]

    def add_members(self, loads: list[UnitLoad], n_outputs: int, n_forces: int, keep: Kept) -> None:
        """Compute what `member_squares` needs, for the loads and the first of all outputs."""
        places = self._places[: int(self.outputs.searchsorted(n_outputs))]
        self._nodes = self.terms(self.table.ensemble_alpha3)
        self.members = EnsembleResponses(
            self.table, loads, places, n_forces, self._table_responses, keep
        )

    def member_squares(self, angles: FloatArray, omega: FloatArray) -> tuple[Reals, Reals]:
        """Return squares, (n, n_members, n_own, n_places), and references, (..., n_forces), N."""
        modes, omega = self.members.at(angles), omega[..., self.excitations]
        squares = self.members.responses(angles, modes, omega, self._own) ** 2
        return squares[:, :, 0] + squares[:, :, 1], modes.references[:, 1:]

    def terms(self, angles: FloatArray) -> _Terms:
        """Return the terms at angles in the table, (n,)."""
        starts, n, layout = self.cells[0], len(angles), self.layout
        which = np.maximum(starts.searchsorted(angles, side="right") - 1, 0)
        powers = np.ones((n, 1, 4))
        rising = powers[:, 0, 2::-1]
        rising[:] = (angles - starts[which])[:, np.newaxis]
        np.multiply.accumulate(rising, axis=1, out=rising)
        numbers = (powers @ self._numbers[which])[:, 0]
        poles, static, reference = (numbers[:, part] for part in self._parts)
        matrices = np.empty((n, layout.n_inputs, 1, self._blocks.shape[3]))
        cells = [0, *(np.flatnonzero(which[1:] != which[:-1]) + 1).tolist(), n]
        for few in map(slice, cells, cells[1:]):  # A crank stays in a cell for some readings.
            block = self._blocks[which[few.start]]
            np.matmul(powers[few, np.newaxis], block, out=matrices[few])
        shape = n, layout.n_inputs, -1, layout.n_outputs
        return _Terms(poles.reshape(n, 3, -1), matrices.reshape(shape), static, reference)

    def squares(self, terms: _Terms, w: Reals, inputs: IntArray) -> FloatArray:
        """Return squares of `_responses`, (..., n_excitations, n_outputs)."""
        responses = self._responses(terms, w, inputs)
        responses *= responses
        return np.asarray(responses[..., 0, :] + responses[..., 1, :])

    def _responses(self, terms: _Terms, w: Reals, inputs: IntArray) -> FloatArray:
        """Return both parts of responses to unit loads, (..., n_excitations, 2, n_outputs)."""
        w, t = w[..., np.newaxis], self.layout.n_terms
        k, damping, c = (terms.poles[..., i, np.newaxis, :] for i in range(3))
        factors = np.empty((*np.broadcast_shapes(w.shape, k.shape)[:-1], 3 * t + 3), complex)
        first = factors[..., :t]
        first.real, first.imag = k - w * w, damping + w * c
        with np.errstate(invalid="ignore"):  # NaN where the table is not accurate
            np.reciprocal(first, out=first)
        np.multiply(first, 1j, out=factors[..., t : 2 * t])
        np.multiply(first, 1j * w, out=factors[..., 2 * t : 3 * t])
        factors[..., 3 * t : 3 * t + 2], factors[..., 3 * t + 2 :] = _UNITS, 1j * w
        parts = factors.take(self._rows, axis=-1)[..., np.newaxis].view(float).swapaxes(-1, -2)
        responses = np.empty((*parts.shape[:-1], self.layout.n_outputs))
        for each, i in enumerate(inputs.tolist()):  # A copy for all would not stay in the cache.
            matrices, out = terms.matrices[..., i, :, :], responses[..., each, :, :]
            np.matmul(parts[..., each, :, :], matrices, out=out)
        return responses

    def _table_responses(self, nodes: IntArray, omega: FloatArray) -> FloatArray:
        """Return `_responses` at nodes of the ensemble, (n, 2, n_excitations, n_outputs)."""
        terms = _Terms(*(part[nodes] for part in self._nodes))
        return self._responses(terms, omega, self._own).swapaxes(1, 2)


def kept_levels(
    predictor: Predictor, mechanism: Mechanism, excitations: Sequence[Excitation]
) -> "LevelTable":
    """Return the levels of which parts are kept in the user's cache folder."""
    keep = level_cache(predictor.table, mechanism, excitations)
    return LevelTable(predictor, mechanism, excitations, keep)


class LevelTable:
    """Levels of vibration by excitations at any angle of a predictor's table."""

    def __init__(
        self,
        predictor: Predictor,
        mechanism: Mechanism,
        excitations: Sequence[Excitation],
        keep: Keep = computed,
    ) -> None:
        self.predictor, table = predictor, predictor.table
        self.mechanism, self.lateral = mechanism, table.lateral
        self.unknown_factors = table.unknown_factors
        self.states_uncertainty = table.uncertain or table.measured
        inputs, numbers = _unit_loads(table, mechanism, excitations)
        across = np.array([bool(each.load and each.load.across) for each in excitations])
        self.excites = across[:, np.newaxis] == table.lateral_modes
        """Which modes each excitation can excite, (n_excitations, n_modes): those of its half."""
        self._top, self._inputs = 2.0 * math.pi * table.band[1], np.array(numbers)
        self._sources = np.array([excitation.source.index for excitation in excitations])
        self._every = np.arange(len(excitations))
        self._omega = np.array([2.0 * math.pi * excitation.ratio for excitation in excitations])
        self._set_sizes([excitation.load for excitation in excitations])
        self._loaded = any(excitation.load or excitation.terrain for excitation in excitations)
        rolling = [i for i, excitation in enumerate(excitations) if excitation.terrain]
        self._terrain = rolling[0] if rolling else 0
        self._surface = excitations[self._terrain].terrain
        self.force_places = table.load_places if self._loaded else ()
        """Pins and cylinders, the first ones of the table, then chains of known pretension."""
        self.chains: list[Chain] = []
        """Chains that the ground loads, those of known pretension first."""
        self._halves: list[_Half] = []
        self._ground: GroundTable | None = None
        if table.places:
            self._add_halves(inputs, across, keep)
        self.has_load_ratios = bool(self._halves) and bool(self.force_places)
        """Whether the table gives the loads of excitations in pins, up to its highest frequency."""
        self.n_members = 0
        """Number of members of the ensemble by which factors are known, or 0."""
        self._ground_members: GroundMembers | None = None
        alike = [each.table.ensemble_coordinates for each in self._halves]
        if self._loaded and len(table.ensemble_alpha3) and np.array_equal(alike[0], alike[-1]):
            self._add_members(inputs, excitations, keep)

    def _set_sizes(self, loads: Sequence[Load | None]) -> None:
        """Set the size of each load at the speed 1, which grows with a power; at rest it is 0."""
        self._powers = load_powers(loads)
        exponents = np.array([load.exponent if load else 0.0 for load in loads])
        rms = np.array([load.amplitude / math.sqrt(2.0) if load else math.nan for load in loads])
        speed = np.array([load.speed if load else 1.0 for load in loads])
        self._size = unit_sizes(rms * speed**-exponents, self._omega, self._powers)
        self._exponents, self._still = exponents + self._powers, 0.0 * rms

    def _add_halves(self, inputs: Sequence[list[UnitLoad]], across: BoolArray, keep: Keep) -> None:
        """Add the halves that respond to the unit loads of each, and the ground."""
        table, mechanism, terrain = self.predictor.table, self.mechanism, self._surface
        excited = bool(terrain and lateral_mounts(mechanism)) or bool(across.any())
        self._outputs = self._listed(table, excited)
        for i, (half, its) in enumerate(zip(table.halves, filter(None, inputs), strict=False)):
            which = np.where(across == i, self._inputs - i * len(inputs[0]), -1)
            n_forces = 0 if i else self._n_pins + self._n_tyres
            kept = partial(keep, ("cells", "lateral")[i])
            self._halves.append(_Half(half, its, which, self._outputs, n_forces, kept))
        # Members have no tyres.
        self._of_member = self._outputs[: len(self._outputs) - self._n_tyres]
        if terrain is not None:
            self._ground = GroundTable(table, mechanism, terrain, self._of_member[1:], keep=keep)

    def _add_members(
        self, inputs: Sequence[list[UnitLoad]], excitations: Sequence[Excitation], keep: Keep
    ) -> None:
        """Add the members of the ensemble to the halves and to the ground."""
        n_outputs, names = len(self._of_member), ("modes", "lateral_modes")
        for each, its, name in zip(self._halves, inputs, names, strict=False):
            each.add_members(its, n_outputs, self._n_pins, partial(keep, name))
        self.n_members = self._halves[0].members.n
        amplitudes, frequencies = load_factors(
            excitations, self.predictor.table.ensemble_coordinates
        )
        self._draws = unit_sizes(amplitudes.T, frequencies.T, self._powers), frequencies.T
        if self._surface and self._ground and not self._ground.refusal:
            of = self.predictor.table, self.mechanism, self._surface, self._of_member
            self._ground_members = GroundMembers(*of, self._ground.lines, keep)

    def _listed(self, table: Table, excited: bool) -> list[Place]:
        """Return the response point, then forces: at pins, cylinders and chains, then of tyres."""
        lateral, mechanism, pins = table.lateral, self.mechanism, self.force_places
        across = lateral.forces if lateral is not None and excited and self._loaded else ()
        if mechanism.lateral is not None and across:
            chains = mechanism.lateral.chains
            self.chains = sorted(chains, key=lambda each: each.pretension is None)
        tight = {each.name: each.pretension for each in self.chains if each.pretension is not None}
        self._pretensions, self.force_places = np.array([*tight.values()]), (*pins, *tight)
        vertical = table.forces if self._loaded else ()
        every = dict.fromkeys((*vertical, *across))
        named = [*pins, *(chain.name for chain in self.chains)]
        forces = [place for name in named for place in every if place[0] == name]
        tyres = [place for place in vertical if place[0] not in named]
        self._n_pins, self._n_tyres = len(pins), len(tyres)
        names = [name for name, _ in (*forces, *tyres)]
        self._first = np.array([*map(names.index, dict.fromkeys(names))], np.int64)
        return [(mechanism.response.point, mechanism.response.direction), *forces, *tyres]

    def prepare(self) -> None:
        """Compute now what would be computed for the first levels that need it."""
        if self._ground is not None and not self._ground.refusal:
            _ = self._ground.values
        if self._ground_members is not None:
            _ = self._ground_members.logs

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """Ranges of angles, rad, in which levels are not known, as they change too fast there."""
        found = []
        for half in self._halves:
            starts, cubics = half.cells
            ends = np.append(starts, half.table.alpha3_range[1]).tolist()
            lost = runs(np.isnan(cubics[:, 0, 0]))
            found += [(ends[a], ends[b]) for a, b in lost if ends[b] - ends[a] > _NARROWEST]
        return found

    @property
    def lacks_track(self) -> bool:
        """Whether there is a ground, and nothing says how far apart the wheels of an axle are."""
        return self._ground is not None and self._ground.lacks_track

    def chain_forces(self, alpha3: FloatArray, speed: float) -> FloatArray:
        """Return rms forces of `chains` by the ground, (n_chains, n), N; NaN if not known."""
        if not self.chains or self._ground is None or not lateral_mounts(self.mechanism):
            return np.empty((0, len(alpha3)))
        squares = self._ground.at(alpha3, np.array([speed])).forces2
        return np.asarray(np.sqrt(squares[len(squares) - len(self.chains) :]))

    @property
    def alpha3_range(self) -> tuple[float, float]:
        """First and last angle of the table, rad."""
        return self.predictor.table.alpha3_range

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray, int, IntArray]:
        """Starts and cubics of the vertical half, number of terms, and inputs of excitations."""
        if not self._halves:
            return np.empty(0), np.empty((0, 4, 0)), 0, self._inputs
        starts, cubics = self._halves[0].cells
        layout, order = self._halves[0].layout, self._halves[0].order
        every = np.zeros((*cubics.shape[:2], layout.n_values))
        every[..., order] = cubics
        return starts, every, layout.n_terms, self._inputs

    def at(self, alpha3: FloatArray, speeds: FloatArray) -> MessageColumns:
        """Return the levels at n angles, by the names of the fields of ``Levels.msg``.

        They are NaN outside the table, and factors without `set_factors`. Speeds are (n_sources,
        n). ``load_places``, (n, n_excitations), are indices of pins and cylinders.
        """
        angles, forcing = angles_in_table(alpha3, self.alpha3_range), self._forcing_at(speeds)
        parts = []
        for few in self._chunks(len(angles)):
            terms = [half.terms(angles[few]) for half in self._halves]
            squares = self._squares(terms, forcing.omega[few], self._every)
            parts.append((squares, *_at_rest(terms)))
        return self._levels(parts, forcing, angles, speeds[_GROUND])

    def at_all_pairs(self, alpha3: FloatArray, speeds: FloatArray) -> MessageColumns:
        """Return the levels `at` each of n angles with each of k speeds, (n k), by angle."""
        n, k = len(alpha3), speeds.shape[1]
        angles, forcing = angles_in_table(alpha3, self.alpha3_range), self._forcing_at(speeds)
        changes = np.flatnonzero((forcing.omega != forcing.omega[:1]).any(axis=0))
        parts = []
        for few in self._chunks(n):
            terms = [half.terms(angles[few]) for half in self._halves]
            squares = self._squares(terms, forcing.omega[:1], self._every)
            squares = squares[:, np.newaxis].repeat(k, axis=1)
            if len(changes):
                each = [_Terms(*(part[:, np.newaxis] for part in its)) for its in terms]
                w = forcing.omega[:, changes]
                squares[:, :, changes] = self._squares(each, w, changes)
            squares = squares.reshape(-1, *squares.shape[2:])
            parts.append((squares, *(part.repeat(k, 0) for part in _at_rest(terms))))
        tiled = _Forcing(*(np.tile(part, (n, 1)) for part in forcing))
        return self._levels(parts, tiled, angles.repeat(k), np.tile(speeds[_GROUND], n))

    def _chunks(self, n: int) -> list[slice]:
        """Return which of n angles are evaluated together; none without FRFs."""
        starts = range(0, n if self._halves else 0, _CHUNK)
        return [slice(start, start + _CHUNK) for start in starts]

    def _levels(
        self,
        parts: Sequence[tuple[Reals, ...]],
        forcing: _Forcing,
        angles: FloatArray,
        ground_speed: FloatArray,
    ) -> MessageColumns:
        """Return n levels from parts: `_squares`, and static and reference of `_Terms`."""
        numbers, places, reasons = _unknown(len(angles), len(self._inputs))
        if not parts:
            return _level_columns(numbers, places, reasons)
        squares, static, reference = map(np.concatenate, zip(*parts, strict=True))
        amplifications = numbers[:, _columns(len(self._inputs))["amplifications"]]
        magnitude = np.sqrt(squares[..., 0]) * forcing.defined
        np.divide(magnitude, static.take(self._inputs, axis=1), out=amplifications)
        ground = None
        if self._ground is not None:
            ground = self._ground.at_table_angles(angles, ground_speed)
        reasons = self._evaluate(numbers, places, squares, reference, forcing, ground)
        numbers[np.isnan(numbers)] = math.nan  # of one sign, so that equal levels are equal bytes
        return _level_columns(numbers, places, reasons)

    def members(self, alpha3: FloatArray, speeds: FloatArray) -> FloatArray:
        """Return the levels of each member, (n, n_members, n_levels), at angles as `at` does."""
        angles = angles_in_table(alpha3, self.alpha3_range)
        width = _unknown(0, len(self._inputs))[0].shape[1]
        quantities = np.full((len(alpha3), self.n_members, width), math.nan)
        inside = np.flatnonzero(np.isfinite(angles) & (self.n_members > 0))
        nominal, at = self.at(angles[inside], speeds[:, inside]), _columns(len(self._inputs))
        for start in range(0, len(inside), _MEMBERS_CHUNK):
            few = slice(start, start + _MEMBERS_CHUNK)
            rows, share = inside[few], nominal.off_ground_share[few]
            quantities[rows] = numbers = self._of_members(angles[rows], speeds[:, rows], share)
            # A member that lacks a level which the mechanism itself has lacks the total, too.
            for of, total in _TOTALS.items():
                known = ~np.isnan(getattr(nominal, of)[few])
                lost = (np.isnan(numbers[..., at[of]]) & known[:, np.newaxis]).any(axis=2)
                quantities[rows, :, at[total]] = np.where(lost, math.nan, numbers[..., at[total]])
        return quantities

    def _of_members(self, angles: FloatArray, speeds: FloatArray, share: FloatArray) -> Reals:
        """Return what `members` does at a few angles within the table."""
        n, nominal = len(angles), self._forcing_at(speeds)
        omega = nominal.omega[:, np.newaxis] * self._draws[1]
        size = nominal.size[:, np.newaxis] * self._draws[0]
        defined = np.broadcast_to(nominal.defined[:, np.newaxis], omega.shape)
        each = (part.reshape(-1, omega.shape[2]) for part in (omega, defined, size))
        parts = [(half.excitations, *half.member_squares(angles, omega)) for half in self._halves]
        squares, rolling = self._joined([part[:2] for part in parts]), None
        if self._ground is not None:
            rolling = self._ground.at_table_angles(angles, speeds[_GROUND]).with_share(share)
            if self._ground_members is not None:
                amplitudes = self._draws[0][:, self._terrain]
                rolling = self._ground_members.levels(rolling, angles, speeds[_GROUND], amplitudes)
            else:
                rolling = rolling.rows(np.arange(n).repeat(self.n_members))
        numbers = _unknown(n * self.n_members, len(self._inputs))[0].astype(np.float32)
        squares = squares.reshape(len(numbers), *squares.shape[2:])
        references = parts[0][2].reshape(len(numbers), -1)
        forcing = _Forcing(*(part.astype(np.float32) for part in each))
        self._evaluate(numbers, None, squares, references, forcing, rolling)
        return numbers.reshape(n, self.n_members, -1)

    def member_totals(
        self, alpha3: FloatArray, speeds: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the total load ratio and velocity of each member, (n_members, n), as `at` does."""
        numbers, at = self.members(alpha3, speeds), _columns(len(self._inputs))
        return numbers[..., at["total_load_ratio"]].T, numbers[..., at["total_velocity"]].T

    def factor_rows(self, alpha3: FloatArray, speeds: FloatArray, limit: float) -> FloatArray:
        """Return `DEVIATION_FIELDS`, (n, n_factors); above the limit a warning begins."""
        of_levels = _factored(len(self._inputs))
        if not self.n_members or not len(alpha3):
            return np.full((len(alpha3), len(of_levels)), math.nan)
        values = self.members(alpha3, speeds)[..., of_levels]
        factors, total = spreads(values), values[..., -1:]
        factors[:, -1:] = _mean(np.where(np.isnan(total), total, total > limit))
        return factors

    def set_factors(
        self,
        columns: MessageColumns,
        due: Sequence[int],
        which: Sequence[int],  # of each message: 0 if held, otherwise 1 + the index of a due row
        held: FloatArray,  # (1, n_factors), or (1, 0) at first
        limit: float,
    ) -> FloatArray:
        """Set the factors of n messages; return those of the last one, (1, n_factors)."""
        angles, speeds = columns.crank_angle[due], columns.speeds[due].T
        computed = self.factor_rows(angles, speeds, limit)
        factors = np.concatenate([held if held.size else computed[:1], computed])[which]
        levels = [getattr(columns, of) for of in DEVIATION_FIELDS.values()]
        every = np.concatenate([each.reshape(len(factors), -1) for each in levels], axis=1)
        known, end = np.where(np.isnan(every), math.nan, factors).astype(np.float32), 0
        for name, level in zip(DEVIATION_FIELDS, levels, strict=True):
            begin, end = end, end + math.prod(level.shape[1:])
            setattr(columns, name, known[:, begin:end].reshape(level.shape))
        return np.asarray(factors[-1:])

    def _forcing_at(self, speeds: FloatArray) -> _Forcing:
        """Return what excitations do at speeds, (n_sources, n)."""
        with np.errstate(all="ignore"):  # speeds may be any 64 bits
            speed = speeds.take(self._sources, axis=0).T
            omega = self._omega * speed
            known = (speed >= 0.0) & (omega <= self._top)
            size = np.where(speed == 0.0, self._still, self._size * speed**self._exponents)
            defined = np.where(known, 1.0, math.nan)
            return _Forcing(np.where(known, omega, 1.0), defined, size * defined)

    def _squares(self, terms: Sequence[_Terms], w: Reals, every: IntArray) -> Reals:
        """Return squares of responses to unit loads at rad/s, (..., k, n_outputs), of halves."""
        parts = []
        for half, its in zip(self._halves, terms, strict=True):
            own, inputs = half.of(every)
            parts.append((own, half.squares(its, w.take(own, axis=-1), inputs)))
        return self._joined(parts)

    def _joined(self, parts: Sequence[tuple[IntArray, Reals]]) -> Reals:
        """Return squares at all outputs, (..., k, n_outputs), from each half's excitations of k."""
        if len(self._halves[0].outputs) == len(self._outputs):
            return parts[0][1]
        n = sum(len(own) for own, _ in parts)
        squares = np.zeros((*parts[0][1].shape[:-2], n, len(self._outputs)))
        for half, (own, part) in zip(self._halves, parts, strict=True):
            squares[..., own[:, np.newaxis], half.outputs[: part.shape[-1]]] = part
        return squares

    def _evaluate(
        self,
        numbers: Reals,
        places: IntArray | None,
        squares: Reals,
        reference: Reals,
        forcing: _Forcing,
        ground: GroundLevels | None,
    ) -> NDArray[np.int8]:
        """Compute levels, (n, n_levels), and where load ratios are largest, (n, n_excitations + 1).

        Members have neither places nor tyres. Squares are (n, n_excitations, n_outputs), of unit
        loads, references (n, n_forces), N. Return why the level of the ground is not known, (n,).
        """
        if not self._loaded:
            return np.zeros(len(numbers), np.int8)
        at, w, m = _columns(len(self._inputs)), forcing.omega, len(self._inputs)
        moved = numbers[:, : 2 * m].reshape(-1, 2, m)  # velocities and accelerations
        velocity, acceleration = moved[:, 0], moved[:, 1]
        np.multiply(np.sqrt(squares[..., 0]) * forcing.size, w, out=velocity)
        np.multiply(velocity, w, out=acceleration)
        # The order of the axes makes their largest values fast: (n_excitations, n_forces, n).
        components, sizes = squares[..., 1:].transpose(1, 2, 0), forcing.size.T[:, np.newaxis]
        ratios, n = self._forces(components) * (sizes * sizes), len(self.force_places)
        if places is not None:
            numbers[:, at["off_ground_share"]] = share = self._share(ratios, reference, ground)
            ground = ground and ground.with_share(share)
        if ground is not None:
            velocity[:, self._terrain] = ground.velocity
            acceleration[:, self._terrain] = ground.acceleration
        unknown = 0.0 * np.fmax.reduce(velocity, axis=1)  # NaN where no level is known
        known = np.fmax(moved, 0.0)
        known *= known
        totals = np.sqrt(np.add.accumulate(known, axis=2)[..., -1]).T + unknown
        numbers[:, at["total_velocity"]], numbers[:, at["total_acceleration"]] = totals
        reasons = np.zeros(len(numbers), np.int8) if ground is None else ground.reason
        if not n:
            return reasons
        ratios, reference = ratios[:, :n], reference[:, : self._n_pins]
        if ground is not None:
            ratios[self._terrain] = self._forces(ground.forces2)[:n]
        if len(self._pretensions):
            tight = np.tile(self._pretensions, (len(reference), 1))
            reference = np.concatenate([reference, tight], axis=1)
        ratios /= (reference * reference).T
        total = np.add.accumulate(np.fmax(ratios, 0.0), axis=0)[-1:]
        ratios = np.concatenate([ratios, total])
        largest = np.maximum.reduce(ratios, axis=1)
        if places is not None:
            places[:] = first_largest(ratios, largest).T
        largest = np.sqrt(largest)
        numbers[:, at["load_ratios"]] = largest[:-1].T
        lost = 0.0 * np.maximum.reduce(reference, axis=1)  # NaN where nothing is known to refer to
        numbers[:, at["total_load_ratio"]] = largest[-1] + unknown + lost
        return reasons

    def _share(self, forces2: Reals, reference: Reals, ground: GroundLevels | None) -> FloatArray:
        """Return the time share off the ground, (n,); if small, NaN where the ground's is NaN."""
        tyres2 = forces2[:, forces2.shape[1] - self._n_tyres :]
        if self._ground is not None and not self._ground.refusal and ground is not None:
            tyres2[self._terrain] = ground.tyres2
        total = np.add.accumulate(np.fmax(tyres2, 0.0))[-1] + 0.0 * np.fmax.reduce(tyres2)
        share = off_ground_share(reference.T[self._n_pins :], total)
        known = 0.0 if ground is None else 0.0 * tyres2[self._terrain].sum(axis=0)
        return np.where(share > MAX_OFF_GROUND, share, share + known)

    def _forces(self, components: Reals) -> Reals:
        """Return squares of forces, (..., n_forces, n), from all or the first components."""
        first = self._first[self._first < components.shape[-2]]
        return np.add.reduceat(components, first, axis=-2) if len(first) else components


def _at_rest(terms: Sequence[_Terms]) -> tuple[Reals, Reals]:
    """Return static responses of all halves, (n, n_loads), and reference forces, (n, n_forces)."""
    return np.concatenate([each.static for each in terms], axis=1), terms[0].reference


def first_largest(values: Reals, largest: Reals) -> IntArray:
    """Return the first of values, (..., m, n), that is the largest, (..., n), but for rounding."""
    return np.asarray((values >= _SAME_SQUARE * largest[..., np.newaxis, :]).argmax(axis=-2))


def _unit_loads(
    table: Table, mechanism: Mechanism, excitations: Sequence[Excitation]
) -> tuple[list[list[UnitLoad]], list[int]]:
    """Return the unit loads in each half, and of each excitation the index among all of them."""
    inputs: dict[tuple[bool, str, str], UnitLoad] = {}
    keys = []
    for excitation in excitations:
        load = excitation.load
        if load is not None and not table.places:
            raise ExcitationError(
                f"excitation {excitation.name} has an amplitude, but the table of "
                f"{table.mechanism_name} has no FRFs to compute a level from; leave the "
                "amplitude out."
            )
        keys.append((load.across, load.kind.key, load.place) if load else (False, "", ""))
        if keys[-1] not in inputs:
            inputs[keys[-1]] = load_input(load, excitation.name, table, mechanism)
    if all(across for across, *_ in keys):
        inputs[False, "", ""] = load_input(None, "", table, mechanism)
    order = sorted(inputs, key=lambda key: key[0])
    halves = [[inputs[key] for key in order if key[0] == half] for half in (False, True)]
    return halves, [order.index(key) for key in keys]


def unknown_levels(n_excitations: int, n: int) -> MessageColumns:
    """Return levels at n angles that are not known."""
    return _level_columns(*_unknown(n, n_excitations))


@cache
def _columns(m: int) -> dict[str, slice | int]:
    """Return the columns of each level of m excitations: m for those of each, and one of all."""
    of_each: dict[str, slice | int] = {
        name: slice(i * m, (i + 1) * m) for i, name in enumerate(_OF_EACH)
    }
    return of_each | {name: len(_OF_EACH) * m + i for i, name in enumerate(_OF_ALL)}


@cache
def _factored(m: int) -> IntArray:
    """Return the columns of the levels of m excitations that have `DEVIATION_FIELDS`, in order."""
    columns, every = _columns(m), np.arange(_unknown(0, m)[0].shape[1])
    return np.hstack([every[columns[name]] for name in DEVIATION_FIELDS.values()])


def _unknown(n: int, m: int) -> tuple[FloatArray, IntArray, NDArray[np.int8]]:
    """Return n unknown levels of m excitations: numbers, places, and reasons of the ground."""
    numbers = np.full((n, len(_OF_EACH) * m + len(_OF_ALL)), math.nan)
    return numbers, np.zeros((n, m + 1), np.int64), np.zeros(n, np.int8)


def _level_columns(
    numbers: FloatArray, places: IntArray, reasons: NDArray[np.int8]
) -> MessageColumns:
    """Return levels by names, load places, (n, n_excitations + 1), and reasons of the ground."""
    with np.errstate(over="ignore"):  # a level beyond float32 is infinite
        single = numbers.astype(np.float32)
    columns = _columns(places.shape[1] - 1).items()
    return MessageColumns(
        **{name: single[:, where] for name, where in columns},
        load_places=places[:, :-1],
        total_load_places=places[:, -1],
        ground_unknown=_REASONS.take(reasons),
    )


def spreads(values: FloatArray) -> FloatArray:
    """Return exp of the deviations of ln(values) over members, (n, k), of (n, n_members, k)."""
    with np.errstate(over="ignore", invalid="ignore"):  # infinite levels of members
        logs = np.log(np.maximum(values, _SILENT))
        logs -= _mean(logs)[:, np.newaxis]
        return np.asarray(np.exp(np.sqrt(_mean(logs * logs))))


def _mean(values: FloatArray) -> FloatArray:
    """Return the mean over members, (n, k), of (n, n_members, k); NaN if too few are known."""
    finite = ~np.isnan(values)
    count = finite.sum(axis=1)
    if not count.any():
        return np.full(count.shape, math.nan)
    # The sum is in the order of members; that of `np.sum` depends on the shape.
    total = np.add.accumulate(np.where(finite, values, 0.0), axis=1)[:, -1]
    mean = total / np.maximum(count, 1)
    return np.where(count >= _MIN_KNOWN_SHARE * values.shape[1], mean, math.nan)


def _sampled(table: Table, inputs: list[UnitLoad], outputs: list[Place], n_forces: int) -> Arrays:
    """Return poles and residues of the responses to inputs over the stroke, as cubics."""
    pieces, waiting = [], list(pairwise(table.alpha3[table.pieces].tolist()))
    left = _MOST_DIVIDED
    while waiting:
        ends = waiting.pop(0)
        samples = _Samples(table, inputs, outputs, n_forces, ends)
        at, values, lost = samples.refined()
        # Where modes nearly coincide, cells are divided further, by themselves. They do not do so
        # over more than half of a piece, nor at many places; dividing that would go on for hours.
        half, kept = (ends[1] - ends[0]) / 2.0, np.ones(len(lost), np.bool_)
        for first, last in runs(lost):
            if left and _NARROWEST < at[last] - at[first] <= half:
                left -= 1
                waiting.append((float(at[first]), float(at[last])))
                kept[first:last] = False
        pieces.append((at, values, lost, kept, samples.layout))
    layout = max((piece[-1] for piece in pieces), key=lambda layout: layout.n_terms)
    padded = [_padded(values, of, layout.n_terms) for _, values, _, _, of in pieces]
    rows, order = layout.order(np.concatenate(padded))
    parts = [
        (at[:-1][kept], _cubics(at, values[:, order], lost)[kept])
        for (at, _, lost, kept, _), values in zip(pieces, padded, strict=True)
    ]
    starts, cubics = map(np.concatenate, zip(*parts, strict=True))
    ascending = starts.argsort()
    numbers = layout.n_terms, layout.n_outputs, layout.n_inputs, layout.n_forces
    return {
        "starts": starts[ascending],  # (n_cells,), rad
        "cubics": cubics[ascending],  # (n_cells, 4, n)
        "rows": rows,  # of the matrices of `_Terms`
        "order": order,  # of the values, as places among those of the layout
        "layout": np.array(numbers),
    }


def _spline(at: FloatArray, values: FloatArray) -> "scipy.interpolate.CubicSpline":
    """Return the spline through values, with 0 for those that are not known."""
    return scipy.interpolate.CubicSpline(at, np.nan_to_num(values, nan=0.0))


def _cubics(at: FloatArray, values: FloatArray, lost: BoolArray) -> FloatArray:
    """Return the cubics between angles, (n_cells, 4, n_values); NaN if not known, or ``lost``."""
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


_Numbers = tuple[FloatArray, FloatArray, FloatArray]  # poles, numerators and all others


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
        self._places = list(dict.fromkeys(p for load in inputs for p in load.places))
        self._n_terms = 0
        self._solved: dict[float, _Numbers] = {}

    @property
    def layout(self) -> _Layout:
        """How the values are arranged, once there are some."""
        return _Layout(self._n_terms, len(self._outputs), len(self._inputs), self._n_forces)

    def refined(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return angles, values, and the cells between them whose middle is not met."""
        cells = _FIRST_CELLS
        while True:
            at, values = self._along(2 * cells)
            interpolated = _spline(at[::2], values[::2])(at[1::2])
            wrong = ~(self._errors(interpolated, values[1::2]) <= MAX_RESPONSE_ERROR)
            if not wrong.any() or cells >= _MOST_CELLS:
                return at, values, wrong.repeat(2)
            cells *= 2

    def _along(self, cells: int) -> tuple[FloatArray, FloatArray]:
        """Return the ends of equal cells in the stroke variable, rad, and the values there."""
        at = stroke_angle(
            np.linspace(self._variables[0], self._variables[1], cells + 1), self._table.toggles
        )
        at[[0, -1]] = self._ends
        # Half of the angles of a finer division are those of the coarser one.
        new = [angle for angle in at.tolist() if angle not in self._solved]
        self._solved.update(zip(new, self._responses_at(new), strict=True))
        roots: ComplexArray | None = None
        rows, modes = [], self._table.evaluate(at)[:, : 2 * self._table.n_modes]
        for alpha3, values in zip(at.tolist(), modes, strict=True):
            row, roots = self._row(alpha3, values, roots)
            rows.append(row)
        forces = self._table.reference_forces(at)[: self._n_forces]
        return at, np.column_stack([rows, forces.T])

    def _row(
        self, alpha3: float, modes: FloatArray, before: ComplexArray | None
    ) -> tuple[FloatArray, ComplexArray]:
        """Return the values at an angle and its poles, in the order of those before."""
        poles, above, others = self._solved[alpha3]
        half = poles[2] / 2.0
        roots: ComplexArray = np.asarray(np.sqrt(half * half - poles[0] - 1j * poles[1]) - half)
        n = self._table.n_modes
        frequencies, ratios = np.split(modes, 2)
        wanted = 2.0 * math.pi * frequencies * (-ratios + np.sqrt(ratios**2 - 1.0 + 0j))
        previous = roots if before is None else before
        wanted = np.where(np.isnan(wanted), previous[:n], wanted)
        order = _in_order(wanted if before is None else np.append(wanted, before[n:]), roots)
        self._n_terms = len(roots)
        row = np.concatenate([poles[:, order].ravel(), above[:, order].ravel(), others])
        return row, roots[order]

    def _responses_at(self, angles: list[float]) -> Iterator[_Numbers]:
        """Return poles, numerators and all other values at angles, as `_Layout` arranges them."""
        # At its end the table uses the next piece, whose number of poles may be another.
        inside = np.minimum(angles, math.nextafter(self._ends[1], self._ends[0]))
        frfs = self._table.frf_at_each(inside, self._outputs, self._places)
        weights = (weights_at(self._inputs, self._places, angle) for angle in inside.tolist())
        return map(self._numbers, frfs, weights)

    def _numbers(self, every: PoleResidue, weights: FloatArray) -> _Numbers:
        """Return the same at one angle, from its FRFs and the weights of the unit loads there."""
        frf = every.driven(*weights)
        a, b, rest, rate = frf.residues, frf.rates, frf.residual, frf.residual_rate
        # A tyre is compressed by the motion of the soil under it, too.
        own = np.array(
            [[out == tyre_place(p) and d == "z" for p, d in self._places] for out in self._outputs]
        )
        by_soil = weights * [bool(load.mounts) for load in self._inputs]
        rest, rate = rest - own @ by_soil[0], rate - own @ by_soil[1]
        terms = a[0] / frf.stiffness
        static = np.abs(terms.sum(axis=1) + rest[0])
        significant = static > _MIN_STATIC_SHARE * (np.abs(terms).sum(axis=1) + np.abs(rest[0]))
        others = [rest.real, rest.imag, rate.real, np.where(significant, static, math.nan)]
        return (
            np.array([frf.stiffness.real, frf.stiffness.imag, frf.decay]),
            np.array([a.real, a.imag, b.real]).transpose(0, 3, 1, 2),
            np.concatenate([np.ravel(part) for part in others]),
        )

    def _errors(self, trial: FloatArray, exact: FloatArray) -> FloatArray:
        """Return errors at the resonances of each angle, over the sums of sizes of terms."""
        layout, n_modes = self.layout, self._table.n_modes
        w = np.sqrt(exact[:, np.newaxis, :n_modes]).swapaxes(1, 2)
        both = [layout.split(np.ascontiguousarray(rows.T)) for rows in (trial, exact)]
        errors = np.zeros(len(exact))
        for output in range(layout.n_outputs):
            (values, _), (true, sizes) = (_responses(parts, output, w) for parts in both)
            # A point in the middle does not move along x and z in the lateral half.
            off = np.abs(values - true) / np.maximum(sizes, _SILENT)
            np.maximum(errors, off.max(axis=(1, 2)), out=errors)
        return errors


def _in_order(wanted: ComplexArray, roots: ComplexArray) -> NDArray[np.int64]:
    """Return an order of all roots in which those nearest to the wanted ones come first."""
    rows, columns = scipy.optimize.linear_sum_assignment(np.abs(wanted[:, np.newaxis] - roots))
    first, others = columns[np.argsort(rows)], np.ones(len(roots), np.bool_)
    others[first] = False
    return np.append(first, np.flatnonzero(others))


def _responses(
    parts: Sequence[FloatArray], output: int, w: FloatArray
) -> tuple[ComplexArray, FloatArray]:
    """Return responses of an output at w, and sizes of terms, (n, n_frequencies, n_inputs)."""
    poles, above, rest, _, _ = parts
    k, c = (poles[0] + 1j * poles[1]).T[:, np.newaxis], poles[2].T[:, np.newaxis]
    above, rest = above[:, :, output].T, rest[:, output].T  # (n, n_inputs, n_terms, 3), ...
    a, b = above[..., 0] + 1j * above[..., 1], above[..., 2]
    below = (k - w**2 + 1j * w * c)[:, :, np.newaxis]
    terms = (a[:, np.newaxis] + 1j * w[..., np.newaxis] * b[:, np.newaxis]) / below
    residual = (rest[..., 0] + 1j * rest[..., 1])[:, np.newaxis]
    residual = residual + 1j * w * rest[:, np.newaxis, :, 2]
    return terms.sum(axis=3) + residual, np.abs(terms).sum(axis=3) + np.abs(residual)
