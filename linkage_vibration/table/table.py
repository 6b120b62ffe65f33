# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The lookup table over alpha3: predictions and FRFs at any angle of the stroke."""

import hashlib
import io
import json
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from itertools import groupby, pairwise
from pathlib import Path
from shlex import quote
from typing import Any
from zipfile import is_zipfile

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError, check_type
from linkage_vibration.mechanics.arrays import (
    BoolArray,
    ComplexArray,
    FloatArray,
    Reals,
    real_number,
    real_numbers,
)
from linkage_vibration.mechanics.description import Mechanism, ReferenceForce
from linkage_vibration.mechanics.forces import SOIL, is_force, magnitudes, reference
from linkage_vibration.mechanics.kinematics import unit_question
from linkage_vibration.mechanics.model import Place, excite_lateral, pairs
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.support.atomic_files import check_suffix, refuse_pipe, write_bytes
from linkage_vibration.support.resources import DEFAULT_TABLE, command, config_file
from linkage_vibration.table.cells import Cells, JoinedCells
from linkage_vibration.table.interpolation import interpolation_matrix, stroke_variable
from linkage_vibration.table.packing import PACKED, pack, unpack
from linkage_vibration.table.pole_cells import PoleFinder, PolePiece
from linkage_vibration.table.reduced import MODEL_ARRAYS, ReducedModels

IntArray = NDArray[np.int64]

FORMAT = "linkage_vibration table 12"

_CHUNK = 4096  # So many angles are looked up at a time, whose cells stay in the cache.
_NEAR = math.radians(1.0)  # Predictions are marked as near a toggle within this angle of it.


def _array(unit: str, *, shape: tuple[int, ...] = (0,)) -> Any:
    """Declare an array of a table, and its shape if it is empty."""
    return field(default_factory=lambda: np.empty(shape), metadata={"unit": unit})


class TableError(LinkageVibrationError):
    """A table cannot be built, read or used."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Table:
    """The values of a prediction and the terms of FRFs at angles over the stroke.

    The stroke is divided into pieces, in each of which reduced models are polynomials through its
    points (in `interpolation.stroke_variable`). FRFs follow from them. For lookups of values, the
    file has cubic `Cells`. Arrays that do not apply are empty.

    Attributes
    ----------
    alpha3 : ndarray, (n,)
        Angles, rad, ascending.
    pieces : ndarray of int, (n_pieces + 1,)
        Indices of the points that bound the pieces; from 0 to n - 1.
    natural_frequencies, damping_ratios : ndarray, (n, n_modes)
        Hz, ascending at the first angle, then followed as poles; 1. NaN where an overdamped mode
        does not oscillate.
    peak_frequencies, peak_magnitudes : ndarray, (n,)
        The highest maximum of the drive-point receptance in `peak_band`, Hz and m/N.
    interpolation_error : ndarray, (n_pieces,)
        Bound of the relative errors of natural frequencies and damping ratios, 1: the largest
        difference from polynomials of fewer points over the piece, and that of its cells.
    peak_error, frf_error : float
        The same for the highest peak, frequency and magnitude, and for single FRFs (L2 norm over
        the band; NaN without FRFs), the largest of all pieces.
    force_error : float
        That of FRFs to forces, relative to the largest force by the same input; NaN without forces.
    slope_error : float
        The same for the slopes of natural frequencies, relative to these, 1/rad.
    free_modes : int
        Modes at 0 Hz, since nothing holds the linkage, which are left out together with all FRFs.
    toggles, band, peak_band : tuple of float
        Where the linkage locks, rad, or None; where FRFs are valid, and the part of it in which
        the highest peak is sought, Hz.
    places, outputs : tuple of (point, direction)
        Between which FRFs are available, the response point first; empty if there are none. Places
        of the lateral half that move, but where no load acts, are outputs alone.
    reduced : tuple of ReducedModels, (n_pieces,)
        Reduced models at the points of each piece, with the rows of all `frf_outputs`.
    cell_starts, cell_cubics : ndarray, (n_cells,) and (n_cells, 4, 2 n_modes + 2)
        The `Cells`.
    cell_poles : complex ndarray, (n_direct, 2, n_branches)
        Poles at both ends of the cells that have no cubics, as `PoleFinder` takes them.
    frequency_stddev, damping_ratio_stddev : ndarray, (n, n_modes)
        Standard deviations by the noise of measured links, Hz and 1; empty without such links.
    mode_names : tuple of str, (n_modes,)
        A name for each mode, which holds over the stroke.
    mode_shares : ndarray, (n_modes, 3)
        Mean shares of its kinetic energy in the base, the rigid bodies and the links, 1; (0, 3) if
        they are not known, as of measured links.
    parameter_stddev : ndarray, (2, n_angles, n_modes)
        Standard deviations of the logarithms of frequencies and of damping ratios by uncertain
        numbers of the mechanism, at even angles over the range; NaN where they are not known
        (`unknown_deviations` says why). (2, 0, 0) without such numbers.
    ensemble_alpha3 : ndarray, (n_nodes,)
        Angles at which the members of the ensemble are known, rad; none without uncertain numbers
        or without FRFs. The first member is the mechanism itself, the numbers of the others are
        drawn. They are NaN where a member is not known.
    ensemble_coordinates : float32 ndarray, (n_members, n_numbers)
        The draws of these others, in standard deviations, as `uncertainty.paired_draws` has them.
    ensemble_poles, ensemble_shapes : complex64 ndarray
        (n_members, n_nodes, k), rad/s, and (n_members, n_nodes, n_rows, k) at `member_outputs`:
        products are the residues of 1 / (s - pole); those of the conjugate poles follow.
    ensemble_far : float32 ndarray, (n_members, n_nodes, n_rows, n_places)
        What all other modes add at 0 Hz.
    ensemble_static : float32 ndarray, (n_members, n_nodes, n_forces)
        The forces under the weight, as `static_forces`.
    ensemble_mounts : float32 ndarray, (n_members, n_mounts, 2, 2)
        Stiffness and damping, along x and z, of the mounts of the base.
    forces : tuple of (name, direction)
        Forces that are outputs of FRFs: both components of each pin, then springs and cylinders.
    static_forces : ndarray, (n, n_forces)
        The same under the weight, N; NaN where nothing carries it.
    reference_force : float, tuple of (name, float) or None
        N, that the mechanism gives in place of all static forces, or of those at some places.
    model_hash, mechanism_name, package_version : str
        Of the mechanism from which it was built, and of the package that built it.
    parts : tuple of Table
        The tables of the vertical and the lateral half, if the mechanism has both. The modes are
        then those of both, in one list, and all other fields are those of the vertical half.
    """

    alpha3: FloatArray = _array("rad")
    pieces: IntArray = _array("1")
    natural_frequencies: FloatArray = _array("Hz")
    damping_ratios: FloatArray = _array("1")
    peak_frequencies: FloatArray = _array("Hz")
    peak_magnitudes: FloatArray = _array("m/N")
    interpolation_error: FloatArray = _array("1")
    peak_error: float = math.nan
    frf_error: float = math.nan
    force_error: float = math.nan
    slope_error: float = math.nan
    free_modes: int
    toggles: tuple[float, float] | None
    band: tuple[float, float]
    peak_band: tuple[float, float]
    places: tuple[Place, ...] = ()
    outputs: tuple[Place, ...] = ()
    forces: tuple[Place, ...] = ()
    static_forces: FloatArray = _array("N")
    reference_force: ReferenceForce | None = None
    reduced: tuple[ReducedModels, ...] = ()
    cell_starts: FloatArray = _array("rad")
    cell_cubics: FloatArray = _array("SI")
    cell_poles: ComplexArray = _array("rad/s")
    mode_names: tuple[str, ...] = ()
    mode_shares: FloatArray = _array("1", shape=(0, 3))
    frequency_stddev: FloatArray = _array("Hz")
    damping_ratio_stddev: FloatArray = _array("1")
    parameter_stddev: FloatArray = _array("1", shape=(2, 0, 0))
    ensemble_alpha3: FloatArray = _array("rad")
    ensemble_coordinates: NDArray[np.float32] = _array("1")
    ensemble_poles: NDArray[np.complex64] = _array("rad/s")
    ensemble_shapes: NDArray[np.complex64] = _array("SI")
    ensemble_far: NDArray[np.float32] = _array("m/N or 1")
    ensemble_static: NDArray[np.float32] = _array("N")
    ensemble_mounts: NDArray[np.float32] = _array("N/m, then N s/m")
    model_hash: str
    mechanism_name: str
    package_version: str
    parts: "tuple[Table, ...]" = ()

    def __repr__(self) -> str:
        """Return what it is a table of, in a line."""
        low, high = map(math.degrees, self.alpha3_range)
        return f"Table({self.mechanism_name}: {self.n_modes} modes, {low:g} to {high:g} deg)"

    @property
    def n_modes(self) -> int:
        """Number of tracked modes."""
        return int(self.natural_frequencies.shape[1])

    @cached_property
    def alpha3_range(self) -> tuple[float, float]:
        """First and last angle, rad."""
        return float(self.alpha3[0]), float(self.alpha3[-1])

    @cached_property
    def range_away_from_toggles(self) -> tuple[float, float]:
        """Range of angles (rad) at least one degree away from the toggles."""
        if self.toggles is None:
            return -math.inf, math.inf
        return self.toggles[0] + _NEAR, self.toggles[1] - _NEAR

    def mode_label(self, mode: int) -> str:
        """Return how a mode, counted from 0, is called: "mode 4 (implement heave)"."""
        number, name = f"mode {mode + 1}", self.mode_names[mode]
        return number if name == number else f"{number} ({name})"

    @property
    def halves(self) -> "tuple[Table, ...]":
        """The table of the vertical half, which is this one if it has no parts, and the lateral."""
        return self.parts or (self,)

    @property
    def vertical(self) -> "Table":
        """The table of the vertical half alone."""
        return self.halves[0]

    @property
    def lateral(self) -> "Table | None":
        """The table of the lateral half, if there is one."""
        return self.parts[1] if self.parts else None

    @property
    def frf_places(self) -> tuple[Place, ...]:
        """The places between which it has FRFs: `places`, and those of the lateral half along y."""
        across = self.lateral.places if self.lateral else ()
        return (*self.places, *(place for place in across if place[1] == "y"))

    @property
    def frf_outputs(self) -> tuple[Place, ...]:
        """All that FRFs of this half give: places, other outputs, and forces."""
        return (*self.places, *self.outputs, *self.forces)

    @property
    def member_outputs(self) -> tuple[Place, ...]:
        """Those that members of the ensemble have.

        In the lateral half, they are what levels sum: the response in the plane, and no tyres.
        """
        loads = [force for force in self.forces if force[0] in self.load_places]
        return (*self.places, *self.outputs[:1], *(loads if self.outputs else self.forces))

    @cached_property
    def lateral_modes(self) -> BoolArray:
        """Which modes are those of the lateral half, (n_modes,)."""
        return np.asarray(self.mode_order >= self.vertical.n_modes)

    @cached_property
    def mode_order(self) -> IntArray:
        """The place of each mode in a list of all vertical, then all lateral ones, (n_modes,)."""
        if not self.parts:
            return np.arange(self.n_modes)
        first = np.concatenate([half.natural_frequencies[0] for half in self.halves])
        return np.argsort(first, kind="stable")

    def listed(self, of_halves: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Return what is known of the modes of each half, (..., n_modes), as of all modes."""
        return np.asarray(np.concatenate(of_halves, axis=-1)[..., self.mode_order])

    @property
    def table_id(self) -> str:
        """Sixteen hexadecimal digits that change with any number in the table."""
        return self.checksum[:16]

    @cached_property
    def checksum(self) -> str:
        """SHA-256 of every array and of the metadata."""
        digest = hashlib.sha256(json.dumps(self._metadata(), sort_keys=True).encode())
        for name, array in self._arrays.items():
            array = np.ascontiguousarray(array)
            array = array.astype(array.dtype.newbyteorder("<"), copy=False)
            digest.update(f"{name}{array.shape}{array.dtype.kind}".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    @property
    def measured(self) -> bool:
        """Whether links are known by FRFs, so that modes have standard deviations."""
        return self.frequency_stddev.size > 0

    def deviations(self, alpha3: Reals) -> FloatArray:
        """Return the standard deviations by noise at angles, (2, n, n_modes), Hz and 1.

        They are interpolated linearly. The table must be of measured links.

        Parameters
        ----------
        alpha3 : ndarray, (n,)
            rad, within the range.
        """
        alpha3 = real_numbers(alpha3, "alpha3")
        arrays = self.frequency_stddev, self.damping_ratio_stddev
        columns = [[np.interp(alpha3, self.alpha3, c) for c in values.T] for values in arrays]
        return np.array(columns).swapaxes(1, 2)

    @property
    def uncertain(self) -> bool:
        """Whether numbers of the mechanism are uncertain."""
        return self.parameter_stddev.size > 0

    @property
    def unknown_deviations(self) -> str:
        """Why standard deviations by uncertain numbers are NaN somewhere, a sentence, or ""."""
        unknown = np.isnan(self.parameter_stddev)
        if not unknown.any():
            return ""
        if unknown.all():
            return (
                "Standard deviations are not known: at each angle, machines with other numbers do "
                "not close, have other overdamped modes, or have modes that veer too quickly; "
                "state smaller ones in `uncertainty`, or shorten range_deg."
            )
        return (
            "Standard deviations are not known where modes veer too quickly, or where a mode is "
            "overdamped in the machine or in one with other numbers."
        )

    @property
    def unknown_factors(self) -> str:
        """Why a factor of a known load is NaN, if one is; the end of a sentence."""
        if not self.uncertain:
            return "no number of the mechanism is uncertain"
        if not len(self.ensemble_alpha3):
            return "models with other numbers cannot be interpolated over the stroke"
        share = "fewer than 95 % of the models with other numbers"
        return f"{share} had this load when factors were last computed"

    def parameter_deviations(self, alpha3: float) -> list[float]:
        """Return the standard deviations by uncertain numbers at an angle (rad) within the range.

        They are those of the logarithms of frequencies, then those of damping ratios, 2 n_modes;
        NaN where they are not known, and 0 without uncertain numbers.
        """
        if not self.uncertain:
            return [0.0] * (2 * self.n_modes)
        first, step, rows = self._parameter_rows
        place = (real_number(alpha3, "alpha3") - first) / step
        i = min(int(place), len(rows) - 2)
        share = place - i
        return [a + (b - a) * share for a, b in zip(rows[i], rows[i + 1], strict=True)]

    def evaluate_parameter_deviations(self, alpha3: Reals) -> FloatArray:
        """Return the same at many angles, (n, 2 n_modes), equal to the last bit."""
        alpha3 = real_numbers(alpha3, "alpha3")
        if not self.uncertain:
            return np.zeros((len(alpha3), 2 * self.n_modes))
        first, step, plain = self._parameter_rows
        place, rows = (alpha3 - first) / step, np.array(plain)
        i = np.minimum(place.astype(np.int64), len(rows) - 2)
        share = (place - i)[:, np.newaxis]
        return np.asarray(rows[i] + (rows[i + 1] - rows[i]) * share)

    @cached_property
    def _parameter_rows(self) -> tuple[float, float, list[list[float]]]:
        """First angle and step of `parameter_stddev`, rad, and its rows, (n_angles, 2 n_modes)."""
        (first, last), n = self.alpha3_range, self.parameter_stddev.shape[1]
        return first, (last - first) / (n - 1), np.hstack(list(self.parameter_stddev)).tolist()

    def interpolate(self, alpha3: float) -> tuple[list[float], float, float, float]:
        """Evaluate the values of a prediction at an angle (rad) within the range.

        Returns
        -------
        values : list of float, 2 n_modes
            Natural frequencies (Hz), then damping ratios (1); NaN for an overdamped mode.
        peak_frequency, peak_magnitude : float
            The highest peak, Hz and m/N.
        error : float
            Bound of the relative errors of both in this piece.
        """
        first, last = self.alpha3_range
        alpha3 = real_number(alpha3, "alpha3")
        if not first <= alpha3 <= last:
            self._refuse_outside(np.array([alpha3]))
        values = self.cells.values(alpha3)
        starts, errors = self._errors
        return values[:-2], values[-2], values[-1], errors[bisect_right(starts, alpha3) - 1]

    def evaluate(self, alpha3: Reals) -> FloatArray:
        """Evaluate the values of a prediction at many angles, (n,), rad, within the range.

        Returns
        -------
        ndarray, (n, 2 n_modes + 2)
            Natural frequencies (Hz), damping ratios (1), frequency (Hz) and magnitude (m/N) of the
            highest peak; the same bits as `interpolate` gives.

        Raises
        ------
        TableError
            If an angle is outside the range.
        """
        alpha3 = self._refuse_outside(alpha3)
        result = np.empty((len(alpha3), 2 * self.n_modes + 2))
        for start in range(0, len(alpha3), _CHUNK):
            chunk = alpha3[start : start + _CHUNK]
            result[start : start + len(chunk)] = self.cells.many_values(chunk)
        return result

    def _refuse_outside(self, alpha3: object) -> FloatArray:
        """Return angles, (n,), rad, all of which are real and in the range; refuse any others."""
        alpha3 = real_numbers(alpha3, "alpha3")
        low, high = self.alpha3_range
        inside = (low <= alpha3) & (alpha3 <= high)
        if not inside.all():
            first = float(alpha3[~inside][0])
            ends = f"{math.degrees(low):g} to {math.degrees(high):g} deg"
            problem = f"alpha3 = {math.degrees(first):.3f} deg is outside the table ({ends})"
            hint = unit_question(first, low, high) or "choose an angle within it."
            raise TableError(f"{problem}; {hint}")
        return alpha3

    def to_xarray(self) -> Any:
        """Return the values over alpha3, at the points of the table, as an `xarray.Dataset`.

        It has natural frequencies, damping ratios and the highest peak of the FRF, with units.
        """
        values, n = self.evaluate(self.alpha3), self.n_modes
        data = MessageColumns(
            natural_frequencies=values[:, :n],
            damping_ratios=values[:, n : 2 * n],
            frf_peak_frequency=values[:, -2],
            frf_peak_magnitude=values[:, -1],
        )
        rows = data.to_xarray().rename(row="alpha3")
        return rows.assign_coords(alpha3=self.alpha3, mode_name=("mode", list(self.mode_names)))

    def at(
        self, alpha3: float
    ) -> tuple[tuple[list[float], float, float, float], list[float], list[float]]:
        """Return what `interpolate`, `slopes` and `parameter_deviations` do at an angle, rad."""
        return self.interpolate(alpha3), self.slopes(alpha3), self.parameter_deviations(alpha3)

    def slopes(self, alpha3: float) -> list[float]:
        """Return slopes with alpha3 at an angle (rad) within the range, 2 n_modes.

        They are those of natural frequencies, Hz/rad, then those of damping ratios, 1/rad.
        """
        return self.cells.slopes(real_number(alpha3, "alpha3"))[: 2 * self.n_modes]

    def evaluate_slopes(self, alpha3: Reals) -> FloatArray:
        """Return the same at many angles, (n, 2 n_modes), equal to the last bit."""
        return self.cells.many_slopes(self._refuse_outside(alpha3))[:, : 2 * self.n_modes]

    def frf(
        self, alpha3: float, outputs: Sequence[Place | str], inputs: Sequence[Place | str]
    ) -> PoleResidue:
        """Return receptances between places at an angle, or forces there, valid within the band.

        Parameters
        ----------
        alpha3 : float
            rad, within the range.
        outputs, inputs : sequence of (point, direction)
            Places of the table, ("E1", "z") or "E1.z"; an output may also be one of its forces.
            Inputs along y excite the lateral half, of which x and z are those of the left side.

        Raises
        ------
        TableError
            If the angle is outside the range, or the table does not know one of the places.
        ModelError
            If some inputs are along y and others are not, or no output moves.
        """
        return self.frf_at_each(np.array([real_number(alpha3, "alpha3")]), outputs, inputs)[0]

    def frf_at_each(
        self, alpha3: Reals, outputs: Sequence[Place | str], inputs: Sequence[Place | str]
    ) -> list[PoleResidue]:
        """Return what `frf` does at many angles, which takes less time.

        Parameters
        ----------
        alpha3 : ndarray, (n,)
            rad, within the range.
        outputs, inputs : sequence of (point, direction)
            As `frf` takes them.

        Raises
        ------
        TableError, ModelError
            As those of `frf`.
        """
        alpha3 = self._refuse_outside(alpha3)
        outputs, inputs = pairs(outputs), pairs(inputs)
        if self.parts:
            return self.parts[excite_lateral(outputs, inputs)].frf_at_each(alpha3, outputs, inputs)
        rows = self.frf_outputs
        for place, valid in (*((o, rows) for o in outputs), *((i, self.places) for i in inputs)):
            if place not in valid:
                names = ", ".join(" ".join(names) for names in valid) or "none"
                hint = "Name the point when the table is built, or solve the model"
                problem = f"The table has no FRF at {' '.join(place)}; it has these: {names}"
                raise TableError(f"{problem}. {hint}.")
        o = [rows.index(place) for place in outputs]
        i = [self.places.index(place) for place in inputs]
        error = np.array([self.force_error if is_force(out) else self.frf_error for out in outputs])
        named = partial(replace, outputs=tuple(outputs), inputs=tuple(inputs), error=error)
        pieces, frfs = [self._piece(angle) for angle in alpha3.tolist()], list[PoleResidue]()
        for piece, same in groupby(range(len(alpha3)), lambda row: pieces[row]):
            modal = self._pole_pieces[piece].modal(alpha3[list(same)])
            frfs += [named(modal.frf(row, o, i)) for row in range(len(modal.poles))]
        return frfs

    @cached_property
    def force_places(self) -> tuple[str, ...]:
        """Names of the pins, springs, cylinders and tyres in `forces`, if the table has FRFs."""
        return tuple(dict.fromkeys(name for name, _ in self.forces)) if self.places else ()

    @cached_property
    def load_places(self) -> tuple[str, ...]:
        """Those of `force_places` that load ratios compare: all but the tyres, which are last."""
        return tuple(name for name in self.force_places if not name.startswith(SOIL))

    def forces_at_rest(self, alpha3: FloatArray) -> FloatArray:
        """Return the forces at `force_places` under the weight, (n_force_places, n), N.

        They are magnitudes; NaN where nothing carries the weight.

        Parameters
        ----------
        alpha3 : ndarray, (n,)
            rad, within the range.
        """
        return magnitudes(self.forces, self.components_at_rest(alpha3))

    def components_at_rest(self, alpha3: FloatArray) -> FloatArray:
        """Return `forces` under the weight at angles, rad, (n_forces, n), N; none without FRFs."""
        alpha3 = self._refuse_outside(alpha3)
        if not self.force_places:
            return np.empty((0, len(alpha3)))
        forces = np.empty((len(self.forces), len(alpha3)))
        bounds = np.array([self._piece(angle) for angle in alpha3.tolist()], dtype=np.int64)
        for piece in np.unique(bounds).tolist():
            points, matrix = self._polynomial(piece, alpha3[bounds == piece])
            forces[:, bounds == piece] = (matrix @ self.static_forces[points]).T
        return forces

    def reference_forces(self, alpha3: FloatArray) -> FloatArray:
        """Return what dynamic forces at `force_places` are compared with, (n_force_places, n), N.

        It is the static force, but at least a tenth of the largest at that angle, as a pin that
        carries nearly nothing has no meaningful ratio; or `response.reference_force` of the
        mechanism. It is NaN where nothing carries the weight, and negative of a tyre that would
        have to pull.

        Parameters
        ----------
        alpha3 : ndarray, (n,)
            rad, within the range.
        """
        forces = self.components_at_rest(alpha3)
        return reference(self.forces if self.places else (), forces, self.reference_force)

    def _polynomial(self, piece: int, alpha3: FloatArray) -> tuple[slice, FloatArray]:
        """Return the points of a piece, and their weights at angles, (n, n_points)."""
        points = slice(int(self.pieces[piece]), int(self.pieces[piece + 1]) + 1)
        variables = stroke_variable(self.alpha3[points], self.toggles)
        return points, interpolation_matrix(variables, stroke_variable(alpha3, self.toggles))

    def _piece(self, alpha3: float) -> int:
        """Return the index of the piece of an angle."""
        bounds = self.alpha3[self.pieces]
        return int(np.clip(np.searchsorted(bounds, alpha3, side="right") - 1, 0, len(bounds) - 2))

    @cached_property
    def _pole_pieces(self) -> list[PolePiece]:
        """The pieces with their reduced models."""
        ends = zip(self.reduced, pairwise(self.pieces.tolist()), strict=True)
        return [
            PolePiece(self.alpha3[first : last + 1], models, self.toggles, self.peak_band)
            for models, (first, last) in ends
        ]

    @cached_property
    def _errors(self) -> tuple[list[float], list[float]]:
        """Where the pieces begin, rad, and their errors."""
        return self.alpha3[self.pieces[:-1]].tolist(), self.interpolation_error.tolist()

    @cached_property
    def cells(self) -> Cells:
        """What looks up values: 2 n_modes, then the frequency and the height of the peak."""
        if self.parts:
            n, m = (half.n_modes for half in self.halves)
            # Frequencies, ratios and the peak of the vertical half are before the lateral ones.
            frequencies = np.r_[:n, 2 * n + 2 : 2 * n + 2 + m][self.mode_order]
            ratios = frequencies + np.where(self.lateral_modes, m, n)
            columns = np.concatenate([frequencies, ratios, [2 * n, 2 * n + 1]])
            return JoinedCells([half.cells for half in self.halves], columns)
        direct = np.isposinf(self.cell_cubics[:, 3]).any(axis=1)
        bounds, rows = np.append(self.cell_starts, self.alpha3[-1]), np.cumsum(direct) - 1
        finder = PoleFinder(self._pole_pieces, bounds, rows, self.cell_poles, self.n_modes)
        return Cells(self.cell_starts, self.cell_cubics, finder)

    @property
    def _arrays(self) -> dict[str, Any]:
        """Every array of which the table has any, by its name in the file."""
        arrays = {name: getattr(self.vertical, name) for name in UNITS}
        for i, models in enumerate(self.reduced):
            arrays |= {f"reduced_{i}_{name}": getattr(models, name) for name in MODEL_ARRAYS}
        if self.lateral is not None:
            arrays |= {_LATERAL + name: array for name, array in self.lateral._arrays.items()}
        return {name: array for name, array in arrays.items() if array.shape != (0,)}

    def _metadata(self) -> dict[str, Any]:
        """Return what the file has beside arrays: every other field, without NaN, for JSON."""
        facts = {name: getattr(self.vertical, name) for name in _FACTS}
        facts |= {"reduced": len(self.reduced)}
        if not self.outputs:
            del facts["outputs"]  # as in tables without a lateral half
        facts |= {name: None for name in _MAYBE if math.isnan(facts[name])}
        if self.lateral is not None:
            facts["lateral"] = self.lateral._metadata()
        return {"format": FORMAT, "units": UNITS, "range_rad": self.alpha3_range, **facts}


UNITS = {each.name: each.metadata["unit"] for each in fields(Table) if each.metadata}
"""Arrays of a table, by their names."""

_MAYBE = "frf_error", "force_error"  # NaN in a table without FRFs; JSON has no NaN
_FACTS = [each.name for each in fields(Table) if each.name not in (*UNITS, "reduced", "parts")]
_LATERAL = "lateral_"  # before the names of the arrays of the lateral half
_EXPONENTS = "_exponents"  # after the names of packed arrays


def _tuples(value: Any) -> Any:
    """Turn lists in JSON into tuples."""
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def widened(band: tuple[float, float]) -> tuple[float, float]:
    """Return a slightly wider band, Hz, so that peaks at its ends are inside despite rounding."""
    low, high = band
    room = 1e-9 * high
    return low - room, high + room


def table_bytes(table: Table) -> bytes:
    """Return a table as one ``.npz``: an array for each quantity, and JSON metadata."""
    metadata = json.dumps({**table._metadata(), "checksum": table.checksum}, sort_keys=True)
    archive, arrays = io.BytesIO(), table._arrays
    for name in [name for name in arrays if name.removeprefix(_LATERAL) in PACKED]:
        arrays[name], arrays[name + _EXPONENTS] = pack(arrays[name])
    try:
        np.savez_compressed(archive, metadata=np.array(metadata), **arrays)
    except ValueError as error:  # zipfile hides that there is not enough memory
        raise MemoryError from error
    return archive.getvalue()


def save_table(table: Table, path: str | Path) -> None:
    """Write a table to a file.

    Parameters
    ----------
    table, path
        The table, and the `.npz` file to write; an existing one is replaced.

    Raises
    ------
    TableError
        If it cannot be written.
    OutputError
        If the name is that of another format, such as CSV.
    """
    check_type(table, "use `build_table`", Table)
    check_suffix(Path(path), ".npz")
    write_bytes(Path(path), table_bytes(table), TableError)


def load_table(path: str | Path | None = None, mechanism: Mechanism | None = None) -> Table:
    """Read a table and check it.

    Parameters
    ----------
    path : str or Path, optional
        The file that `save_table` wrote. Without a path, the table of the three-point linkage that
        ships with the package is read.
    mechanism : Mechanism, optional
        The mechanism in use; a table of another one is refused.

    Raises
    ------
    TableError
        If the file is missing, is not a table, holds pickles, is damaged, or belongs to another
        mechanism.
    """
    path = config_file(DEFAULT_TABLE) if path is None else Path(path)
    table = _read(path)
    if mechanism is not None:
        refuse_other(table, path, mechanism)
    return table


def refuse_other(table: Table, path: Path, mechanism: Mechanism, source: str = "FILE") -> None:
    """Refuse the table of another mechanism than that of a source; the path is the table's."""
    if table.model_hash != mechanism.model_hash:
        raise TableError(
            f"{path}: was built from another mechanism ({table.mechanism_name}, model "
            f"{table.model_hash[:12]}) than the one in use ({mechanism.name}, model "
            f"{mechanism.model_hash[:12]}); build it again with "
            f"`{command(f'build {source} -o {quote(str(path))}')}`."
        )


def _table(metadata: dict[str, Any], arrays: dict[str, Any]) -> Table:
    """Return the table whose metadata and arrays a file has."""
    facts = {name: _tuples({"outputs": (), **metadata}[name]) for name in _FACTS}
    facts |= {name: math.nan for name in _MAYBE if facts[name] is None}
    reduced = []
    if "lateral" in metadata:
        names = [name for name in arrays if name.startswith(_LATERAL)]
        own = {name.removeprefix(_LATERAL): arrays.pop(name) for name in names}
        lateral = metadata.pop("lateral")
        return both_halves(_table(metadata, arrays), _table(lateral, own))
    for i in range(metadata["reduced"]):
        parts = {k: arrays.pop(f"reduced_{i}_{k}", np.empty(0)) for k in MODEL_ARRAYS}
        n_inputs = parts["shapes"].shape[1] - len(facts["outputs"]) - len(facts["forces"])
        reduced.append(ReducedModels(**parts, n_inputs=n_inputs, free=facts["free_modes"] > 0))
    return Table(**arrays, **facts, reduced=tuple(reduced))


def both_halves(vertical: Table, lateral: Table) -> Table:
    """Return one table of both halves of a mechanism, whose modes are one list."""
    halves, names = (vertical, lateral), vertical.mode_names
    others = [f"lateral {name}" if name in names else name for name in lateral.mode_names]
    table = replace(vertical, parts=halves)
    angles = [np.clip(vertical.alpha3, *half.alpha3_range) for half in halves]
    values = [half.evaluate(at) for half, at in zip(halves, angles, strict=True)]
    modal = [np.hsplit(each[:, :-2], 2) for each in values]
    frequencies, ratios = (table.listed(parts) for parts in zip(*modal, strict=True))
    stddev = [half.parameter_stddev for half in halves]
    errors = [half.interpolation_error for half in halves]
    return replace(
        table,
        natural_frequencies=frequencies,
        damping_ratios=ratios,
        mode_names=tuple(table.listed([np.array(each) for each in (names, others)]).tolist()),
        mode_shares=table.listed([half.mode_shares.T for half in halves]).T,
        parameter_stddev=table.listed(stddev) if vertical.uncertain else stddev[0],
        interpolation_error=np.maximum(errors[0], errors[1].max()),
        slope_error=max(half.slope_error for half in halves),
        frf_error=float(np.fmax(vertical.frf_error, lateral.frf_error)),
    )


def _read(path: Path) -> Table:
    rebuild = f"build one with `{command('build')}`."
    try:
        refuse_pipe(path)
        with np.load(path, allow_pickle=False) as archive:
            metadata = json.loads(str(archive["metadata"]))
            if metadata["format"] != FORMAT or metadata["units"] != UNITS:
                raise TableError(f"{path}: is a table of another format; {rebuild}")
            arrays = {name: archive[name] for name in archive.files if name != "metadata"}
        for name in [name for name in arrays if name.removeprefix(_LATERAL) in PACKED]:
            kind = PACKED[name.removeprefix(_LATERAL)]
            arrays[name] = unpack(arrays[name], arrays.pop(name + _EXPONENTS), kind)
        table = _table(metadata, arrays)
        if table.checksum != metadata["checksum"]:
            raise TableError(f"{path}: is damaged (its checksum differs); build the table again.")
        return table
    except TableError:
        raise
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror or error}); {rebuild}") from None
    # A damaged archive raises errors of zipfile, zlib, struct, tokenize, json and NumPy.
    except Exception as error:
        why = f"{type(error).__name__}: {error}" if is_zipfile(path) else "it is no .npz archive"
        raise TableError(f"{path}: is damaged or not a table ({why}); {rebuild}") from None
