# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The lookup table over alpha3: predictions and FRFs at any angle of the stroke."""

import hashlib
import io
import json
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import BoolArray, ComplexArray, FloatArray
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import Place
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.support.atomic_files import write_bytes
from linkage_vibration.support.resources import DEFAULT_TABLE, config_file
from linkage_vibration.table.cells import Cells, spline_cells
from linkage_vibration.table.interpolation import (
    NearTerms,
    interpolate_positive,
    interpolate_terms,
    interpolation_matrix,
    stroke_angle,
    stroke_variable,
)
from linkage_vibration.table.pole_cells import PoleFinder, PolePiece, pole_piece
from linkage_vibration.table.reduced import (
    Far,
    Numbers,
    ReducedModels,
    from_triangle,
    pole_residue_sum,
)

IntArray = NDArray[np.int64]

FORMAT = "linkage_vibration table 4"
UNITS = {
    "alpha3": "rad",
    "pieces": "1",
    "natural_frequencies": "Hz",
    "damping_ratios": "1",
    "peak_frequencies": "Hz",
    "peak_magnitudes": "m/N",
    "peak_notable": "1",
    "interpolation_error": "1",
    "term_stiffness": "rad^2/s^2",
    "term_decay": "rad/s",
    "participations": "1/sqrt(kg)",
    "far_stiffness": "rad^2/s^2",
    "far_decay": "rad/s",
    "far_residues": "m/N, then 1/kg",
    "reduced_orders": "1",
    "reduced_inertia": "SI",
    "reduced_stiffness": "SI",
    "reduced_shapes": "SI",
    "reduced_far": "SI",
    "cell_starts": "rad",
    "cell_cubics": "SI",
    "cell_poles": "rad/s",
}

NOISE_UNITS = {"frequency_stddev": "Hz", "damping_ratio_stddev": "1"}
"""Arrays that only tables of measured links have."""

PARAMETER_UNITS = {"parameter_stddev": "1"}
"""An array that only tables of mechanisms with uncertain numbers have."""

POINTWISE = (
    *NOISE_UNITS,
    "alpha3",
    "natural_frequencies",
    "damping_ratios",
    "peak_frequencies",
    "peak_magnitudes",
    "term_stiffness",
    "term_decay",
    "participations",
    "far_residues",
)
"""The arrays of a table that have a row for each point."""

CELLS = 512
"""Cubic cells to a piece, for lookups: their error is below 1e-8."""

_CHUNK = 4096  # So many angles are looked up at a time, whose cells stay in the cache.
_NEAR = math.radians(1.0)  # An angle closer to a toggle is near it.


class TableError(LinkageVibrationError):
    """A table cannot be built, read or used."""


@dataclass(frozen=True, eq=False)
class Table:
    """The values of a prediction and the terms of FRFs at angles over the stroke.

    The stroke is divided into pieces, in each of which every quantity is the polynomial through its
    points (in `interpolation.stroke_variable`). For lookups the polynomials are resampled into
    `Cells` when they are first needed.

    Attributes
    ----------
    alpha3 : ndarray, (n,)
        Angles, rad, ascending.
    pieces : ndarray of int, (n_pieces + 1,)
        Indices of the points that bound the pieces; from 0 to n - 1.
    natural_frequencies, damping_ratios : ndarray, (n, n_modes)
        Hz, ascending at the first angle, then tracked by shape; 1. NaN where an overdamped mode
        does not oscillate.
    peak_frequencies, peak_magnitudes : ndarray, (n, n_peaks)
        Maxima of the drive-point receptance that are the highest in the band at some angle: near
        resonances, and at the ends of the band; Hz and m/N. Each is smooth, while the highest may
        jump from one to another.
    peak_notable : ndarray of bool, (n_pieces, n_peaks)
        Which of them are high enough in a piece to be used there.
    interpolation_error : ndarray, (n_pieces,)
        Bound of the relative errors of natural frequencies and damping ratios, 1: the largest
        difference from finer polynomials over the piece, and from the model at further points.
    peak_error, frf_error : float
        The same for the highest peak, frequency and magnitude, and for single FRFs (L2 norm over
        the band; NaN without FRFs), the largest of all pieces.
    slope_error : float
        The same for the slopes of natural frequencies, relative to these, 1/rad.
    free_modes : int
        Modes at 0 Hz, since nothing holds the linkage, which are left out together with all FRFs.
    toggles, band : tuple of float
        Where the linkage locks, rad, or None; where peaks are sought and FRFs are valid, Hz.
    places : tuple of (point, direction)
        Between which FRFs are available; empty if the model has no such terms.
    term_stiffness, term_decay : ndarray, (n, n_terms)
        k and c of each pole's term in an FRF, as in `PoleResidue`.
    participations : complex ndarray, (n, n_places, n_terms)
        Shapes of the terms at the places; their products are the residues. Terms are only those of
        modes that damping does not couple.
    far_stiffness, far_decay : ndarray, (n_far,) or (n_pieces, n_far)
        Poles that represent all modes above the band (`response.FarPoles`).
    far_residues : ndarray, (n, 1 + n_far, n_places (n_places + 1) / 2)
        Static flexibility and residues of those, the upper triangle row by row.
    reduced_orders : ndarray of int, (n_pieces,)
        Number of poles of the reduced models in each piece; none if damping couples no modes.
    reduced_inertia, reduced_stiffness, reduced_shapes, reduced_far : ndarray, (...,)
        Where damping couples the modes, the numbers of the `ReducedModels` at every point of every
        piece, one piece after the other. The response point is the first of their places.
    cell_starts, cell_cubics : ndarray, (n_cells,) and (n_cells, 4, 2 n_modes + 2)
        The `Cells` where damping couples the modes; otherwise they are made from the polynomials.
    cell_poles : complex ndarray, (n_direct, 2, n_branches)
        Poles at both ends of the cells that have no cubics, as `PoleFinder` takes them.
    frequency_stddev, damping_ratio_stddev : ndarray, (n, n_modes)
        Standard deviations by the noise of measured links, Hz and 1; (n, 0) without such links.
    mode_names : tuple of str, (n_modes,)
        A name for each mode, which holds over the stroke.
    mode_shares : ndarray, (n_modes, 3)
        Mean shares of its kinetic energy in the base, the rigid bodies and the links, 1; (0, 3) if
        they are not known, as of measured links.
    parameter_stddev : ndarray, (2, n_angles, n_modes)
        Standard deviations of the logarithms of frequencies and of damping ratios by uncertain
        numbers of the mechanism, at even angles over the range; NaN where the first order is not
        enough. (2, 0, 0) without such numbers.
    model_hash, mechanism_name, package_version : str
        Of the mechanism from which it was built, and of the package that built it.
    """

    alpha3: FloatArray
    pieces: IntArray
    natural_frequencies: FloatArray
    damping_ratios: FloatArray
    peak_frequencies: FloatArray
    peak_magnitudes: FloatArray
    peak_notable: BoolArray
    interpolation_error: FloatArray
    peak_error: float
    frf_error: float
    slope_error: float
    free_modes: int
    toggles: tuple[float, float] | None
    band: tuple[float, float]
    places: tuple[Place, ...]
    term_stiffness: ComplexArray
    term_decay: FloatArray
    participations: ComplexArray
    far_stiffness: ComplexArray
    far_decay: FloatArray
    far_residues: FloatArray | ComplexArray
    reduced_orders: IntArray
    reduced_inertia: Numbers
    reduced_stiffness: Numbers
    reduced_shapes: Numbers
    reduced_far: Numbers
    cell_starts: FloatArray
    cell_cubics: FloatArray
    cell_poles: ComplexArray
    frequency_stddev: FloatArray
    damping_ratio_stddev: FloatArray
    model_hash: str
    mechanism_name: str
    package_version: str
    mode_names: tuple[str, ...] = ()
    mode_shares: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    parameter_stddev: FloatArray = field(default_factory=lambda: np.empty((2, 0, 0)))

    @property
    def n_modes(self) -> int:
        """Number of tracked modes."""
        return int(self.natural_frequencies.shape[1])

    @cached_property
    def alpha3_range(self) -> tuple[float, float]:
        """First and last angle, rad."""
        return float(self.alpha3[0]), float(self.alpha3[-1])

    @cached_property
    def sound_range(self) -> tuple[float, float]:
        """Range of angles (rad) at least one degree away from the toggles."""
        if self.toggles is None:
            return -math.inf, math.inf
        return self.toggles[0] + _NEAR, self.toggles[1] - _NEAR

    def mode_label(self, mode: int) -> str:
        """Return how a mode, counted from 0, is called: "mode 4 (implement heave)"."""
        number, name = f"mode {mode + 1}", self.mode_names[mode]
        return number if name == number else f"{number} ({name})"

    def find_mode(self, wanted: str) -> int | None:
        """Return the index of a mode by its number, counted from 1, or its name; None if unknown.

        The number 0 is no mode, and its index is -1. If nothing is wanted, the first mode that is
        not the tractor's is meant.
        """
        if not wanted:
            linkage_modes = (
                i for i, name in enumerate(self.mode_names) if not name.startswith("tractor ")
            )
            return next(linkage_modes, 0)
        if wanted.isdecimal():
            return int(wanted) - 1
        return self.mode_names.index(wanted) if wanted in self.mode_names else None

    @property
    def table_id(self) -> str:
        """Sixteen hexadecimal digits that change with any number in the table."""
        return self.checksum[:16]

    @cached_property
    def checksum(self) -> str:
        """SHA-256 of every array and of the metadata."""
        digest = hashlib.sha256(json.dumps(self._metadata(), sort_keys=True).encode())
        for name in self._names:
            array = np.ascontiguousarray(getattr(self, name))
            array = array.astype(array.dtype.newbyteorder("<"), copy=False)
            digest.update(f"{name}{array.shape}{array.dtype.kind}".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    @property
    def measured(self) -> bool:
        """Whether links are known by FRFs, so that modes have standard deviations."""
        return self.frequency_stddev.size > 0

    def deviations(self, alpha3: FloatArray) -> FloatArray:
        """Return the standard deviations by noise at angles, (2, n, n_modes), Hz and 1.

        They are interpolated linearly. The table must be of measured links.

        Parameters
        ----------
        alpha3 : ndarray, (n,)
            rad, within the range.
        """
        arrays = self.frequency_stddev, self.damping_ratio_stddev
        return np.array(
            [np.array([np.interp(alpha3, self.alpha3, c) for c in values.T]).T for values in arrays]
        )

    @property
    def uncertain(self) -> bool:
        """Whether numbers of the mechanism are uncertain."""
        return self.parameter_stddev.size > 0

    def parameter_deviations(self, alpha3: float) -> list[float]:
        """Return the standard deviations by uncertain numbers at an angle (rad) within the range.

        They are those of the logarithms of frequencies, then those of damping ratios, 2 n_modes;
        NaN where the first order is not enough, and 0 without uncertain numbers.
        """
        if not self.uncertain:
            return [0.0] * (2 * self.n_modes)
        first, step, rows = self._parameter_rows
        place = (alpha3 - first) / step
        i = min(int(place), len(rows) - 2)
        share = place - i
        return [a + (b - a) * share for a, b in zip(rows[i], rows[i + 1], strict=True)]

    def evaluate_parameter_deviations(self, alpha3: FloatArray) -> FloatArray:
        """Return the same at many angles, (n, 2 n_modes), equal to the last bit."""
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
        n, n_peaks, low, high = self._layout
        values = self._lookup.values(alpha3)
        frequency = magnitude = -1.0
        for at, size in zip(values[n : n + n_peaks], values[n + n_peaks :], strict=True):
            if size > magnitude and low <= at <= high:
                frequency, magnitude = at, size
        starts, errors = self._errors
        return values[:n], frequency, magnitude, errors[bisect_right(starts, alpha3) - 1]

    def evaluate(self, alpha3: FloatArray) -> FloatArray:
        """Evaluate the values of a prediction at many angles, (n,), rad, within the range.

        Returns
        -------
        ndarray, (n, 2 n_modes + 2)
            Natural frequencies (Hz), damping ratios (1), frequency (Hz) and magnitude (m/N) of the
            highest peak; the same bits as `interpolate` gives.
        """
        n, n_peaks, low, high = self._layout
        result = np.empty((len(alpha3), n + 2))
        for start in range(0, len(alpha3), _CHUNK):
            chunk = np.asarray(alpha3[start : start + _CHUNK], dtype=float)
            values = self._lookup.many_values(chunk)
            at, size = values[:, n : n + n_peaks], values[:, n + n_peaks :]
            best = np.where((low <= at) & (at <= high), size, -1.0).argmax(axis=1)[:, np.newaxis]
            rows = slice(start, start + len(chunk))
            result[rows, :n] = values[:, :n]
            result[rows, n:] = np.hstack([np.take_along_axis(x, best, 1) for x in (at, size)])
        return result

    @property
    def cells(self) -> Cells:
        """What looks up values: 2 n_modes + 2 n_peaks of them, as `interpolate` uses them."""
        return self._lookup

    def polynomials(self, piece: int, alpha3: FloatArray) -> FloatArray:
        """Evaluate the values of a piece without cells, (n, 2 n_modes + 2 n_peaks).

        Parameters
        ----------
        piece : int
        alpha3 : ndarray, (n,)
            rad, in this piece; the first is its first angle.
        """
        return self._resampled(alpha3, self.peak_notable[piece])

    def thinned(self, kept: BoolArray) -> "Table":
        """Return the table with some of its points, (n,); the ends of all pieces are kept."""
        rows = {name: getattr(self, name)[kept] for name in POINTWISE}
        return replace(self, pieces=np.cumsum(kept)[self.pieces] - 1, **rows)

    def slopes(self, alpha3: float) -> list[float]:
        """Return slopes with alpha3 at an angle (rad) within the range, 2 n_modes.

        They are those of natural frequencies, Hz/rad, then those of damping ratios, 1/rad.
        """
        return self._lookup.slopes(alpha3)[: 2 * self.n_modes]

    def evaluate_slopes(self, alpha3: FloatArray) -> FloatArray:
        """Return the same at many angles, (n, 2 n_modes), equal to the last bit."""
        return self._lookup.many_slopes(alpha3)[:, : 2 * self.n_modes]

    def frf(self, alpha3: float, outputs: Sequence[Place], inputs: Sequence[Place]) -> PoleResidue:
        """Return receptances between some of the places at an angle, valid within the band.

        Parameters
        ----------
        alpha3 : float
            rad, within the range.
        outputs, inputs : sequence of (point, direction)
            Places of the table.

        Raises
        ------
        TableError
            If the angle is outside the range, or the table does not know one of the places.
        """
        low, high = self.alpha3_range
        if not low <= alpha3 <= high:
            raise TableError(
                f"alpha3 = {math.degrees(alpha3):.3f} deg is outside the table "
                f"({math.degrees(low):g} to {math.degrees(high):g} deg); choose an angle within it."
            )
        for place in (*outputs, *inputs):
            if place not in self.places:
                names = ", ".join(" ".join(names) for names in self.places) or "none"
                raise TableError(
                    f"The table has no FRF at {' '.join(place)}; it has these: {names}. Name the "
                    "point when the table is built, or solve the model."
                )
        o = [self.places.index(place) for place in outputs]
        i = [self.places.index(place) for place in inputs]
        if len(self.reduced_orders):
            modal = self._pole_pieces[self._piece(alpha3)].modal(np.array([alpha3]))
            return pole_residue_sum(modal, o, i)
        points, matrix = self._polynomial(np.array([alpha3]))
        weights = matrix[0]
        k, c, shapes = (each[0] for each in self.terms(np.array([alpha3])))
        residues = shapes[o][:, np.newaxis] * shapes[i][np.newaxis]
        far = np.tensordot(weights, self.far_residues[points], axes=1)
        full = from_triangle(far, len(self.places), o, i)
        return PoleResidue(
            np.concatenate([k, self.far_stiffness]),
            np.concatenate([c, self.far_decay]),
            np.concatenate([residues, full[:, :, 1:]], axis=2),
            np.zeros((len(o), len(i), len(k) + len(self.far_decay)), dtype=complex),
            np.array(full[:, :, 0]),
        )

    def terms(self, alpha3: FloatArray) -> NearTerms:
        """Return the terms of FRFs at angles, (n,), rad, in the piece of the first."""
        points, matrix = self._polynomial(alpha3)
        terms = self.term_stiffness[points], self.term_decay[points], self.participations[points]
        return interpolate_terms(matrix, terms)

    def _polynomial(self, alpha3: FloatArray) -> tuple[slice, FloatArray]:
        """Return the points of the piece of some angles, and their weights, (n, n_points)."""
        i = self._piece(float(alpha3[0]))
        points = slice(int(self.pieces[i]), int(self.pieces[i + 1]) + 1)
        variables = stroke_variable(self.alpha3[points], self.toggles)
        return points, interpolation_matrix(variables, stroke_variable(alpha3, self.toggles))

    def _piece(self, alpha3: float) -> int:
        """Return the index of the piece of an angle."""
        bounds = self.alpha3[self.pieces]
        return int(np.clip(np.searchsorted(bounds, alpha3, side="right") - 1, 0, len(bounds) - 2))

    @cached_property
    def _pole_pieces(self) -> list[PolePiece]:
        """The pieces in which poles are found by reduced models."""
        pieces, starts = [], [0, 0, 0, 0]
        arrays = (
            self.reduced_inertia,
            self.reduced_stiffness,
            self.reduced_shapes,
            self.reduced_far,
        )
        counts = np.diff(self.pieces) + 1
        n_places = len(self.reduced_shapes) // int(counts @ self.reduced_orders)
        n_triangle, n_weights = n_places * (n_places + 1) // 2, 1 + 2 * self.far_decay.shape[1]
        for piece, (n, order) in enumerate(zip(counts, self.reduced_orders, strict=True)):
            shapes = (n, order, order), (n, order, order), (n, n_places, order)
            parts = []
            for i, shape in enumerate((*shapes, (n, n_weights, n_triangle))):
                size = math.prod(shape)
                parts.append(arrays[i][starts[i] : starts[i] + size].reshape(shape))
                starts[i] += size
            far = Far(self.far_stiffness[piece], self.far_decay[piece], parts[3])
            viscous = not np.iscomplexobj(self.reduced_stiffness)
            free = self.free_modes > 0
            models = ReducedModels(parts[0], parts[1], parts[2], far, viscous, free)
            points = slice(int(self.pieces[piece]), int(self.pieces[piece + 1]) + 1)
            pieces.append(pole_piece(self.alpha3[points], models, self.toggles, self.band))
        return pieces

    @cached_property
    def _layout(self) -> tuple[int, int, float, float]:
        """Numbers of values before those of the peaks and of peaks, and the band (Hz)."""
        return 2 * self.n_modes, self.peak_frequencies.shape[1], *widened(self.band)

    @cached_property
    def _errors(self) -> tuple[list[float], list[float]]:
        """Where the pieces begin, rad, and their errors."""
        return self.alpha3[self.pieces[:-1]].tolist(), self.interpolation_error.tolist()

    @cached_property
    def _lookup(self) -> Cells:
        """What looks up values: stored cells, or the polynomials of each piece, resampled."""
        if len(self.reduced_orders):
            direct = np.flatnonzero(np.isposinf(self.cell_cubics[:, 3]).any(axis=1)).tolist()
            bounds, rows = np.append(self.cell_starts, self.alpha3[-1]), range(len(direct))
            row_of_cell = dict(zip(direct, rows, strict=True))
            finder = PoleFinder(
                self._pole_pieces, bounds, row_of_cell, self.cell_poles, self.n_modes
            )
            return Cells(self.cell_starts, self.cell_cubics, finder)
        pieces: list[tuple[FloatArray, FloatArray]] = []
        for piece, ends in enumerate(pairwise(self.alpha3[self.pieces].tolist())):
            first, last = stroke_variable(np.array(ends), self.toggles)
            at = stroke_angle(np.linspace(first, last, CELLS + 1), self.toggles)
            at[[0, -1]] = ends
            pieces.append((at, self._resampled(at, self.peak_notable[piece])))
        return spline_cells(pieces)

    def _resampled(self, at: FloatArray, notable: BoolArray) -> FloatArray:
        """Evaluate the polynomials of a piece, (n, 2 n_modes + 2 n_peaks), at its angles, (n,)."""
        points, matrix = self._polynomial(at)
        frequencies = interpolate_positive(matrix, self.natural_frequencies[points])
        others = matrix @ np.hstack([self.damping_ratios, self.peak_frequencies])[points]
        magnitudes = np.zeros((len(matrix), len(notable)))
        heights = self.peak_magnitudes[points][:, notable]
        magnitudes[:, notable] = interpolate_positive(matrix, heights)
        return np.hstack([frequencies, others, magnitudes])

    @property
    def _names(self) -> tuple[str, ...]:
        """Names of the arrays in the file."""
        noise = NOISE_UNITS if self.measured else {}
        return (*UNITS, *noise, *(PARAMETER_UNITS if self.uncertain else {}))

    def _metadata(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "mechanism_name": self.mechanism_name,
            "model_hash": self.model_hash,
            "package_version": self.package_version,
            "range_rad": list(self.alpha3_range),
            "units": UNITS,
            "peak_error": self.peak_error,
            "slope_error": self.slope_error,
            "free_modes": self.free_modes,
            "frf_error": None if math.isnan(self.frf_error) else self.frf_error,
            "toggles_rad": self.toggles and list(self.toggles),
            "band_hz": list(self.band),
            "places": [list(place) for place in self.places],
            "mode_names": list(self.mode_names),
            "mode_shares": self.mode_shares.tolist(),
        }


def widened(band: tuple[float, float]) -> tuple[float, float]:
    """Return a slightly wider band, Hz, so that peaks at its ends are inside despite rounding."""
    low, high = band
    room = 1e-9 * high
    return low - room, high + room


def table_bytes(table: Table) -> bytes:
    """Return a table as one ``.npz``: an array for each quantity, and JSON metadata."""
    metadata = json.dumps({**table._metadata(), "checksum": table.checksum}, sort_keys=True)
    archive = io.BytesIO()
    arrays = {name: getattr(table, name) for name in table._names}
    np.savez_compressed(archive, metadata=np.array(metadata), **arrays)
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
    """
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
    if mechanism is not None and table.model_hash != mechanism.model_hash:
        raise TableError(
            f"{path}: was built from another mechanism ({table.mechanism_name}, model "
            f"{table.model_hash[:12]}) than the one in use ({mechanism.name}, model "
            f"{mechanism.model_hash[:12]}); build it again with `linkage-vibration build`."
        )
    return table


def _read(path: Path) -> Table:
    rebuild = "build one with `linkage-vibration build`."
    try:
        with np.load(path, allow_pickle=False) as archive:
            metadata = json.loads(str(archive["metadata"]))
            if metadata["format"] != FORMAT or metadata["units"] != UNITS:
                raise TableError(f"{path}: is a table of another format; {rebuild}")
            arrays = {name: archive[name] for name in UNITS}
            unknown = np.empty((len(arrays["alpha3"]), 0))
            arrays |= {name: archive.get(name, unknown) for name in NOISE_UNITS}
            nothing = np.empty((2, 0, 0))
            arrays |= {name: archive.get(name, nothing) for name in PARAMETER_UNITS}
        if arrays["alpha3"].dtype != np.float64:
            raise TableError(f"{path}: is damaged (its angles are not numbers); {rebuild}")
        toggles, frf_error = metadata["toggles_rad"], metadata["frf_error"]
        table = Table(
            **arrays,
            peak_error=metadata["peak_error"],
            slope_error=metadata["slope_error"],
            free_modes=metadata["free_modes"],
            frf_error=math.nan if frf_error is None else frf_error,
            toggles=toggles and (toggles[0], toggles[1]),
            band=(metadata["band_hz"][0], metadata["band_hz"][1]),
            places=tuple((point, direction) for point, direction in metadata["places"]),
            model_hash=metadata["model_hash"],
            mechanism_name=metadata["mechanism_name"],
            package_version=metadata["package_version"],
            mode_names=tuple(metadata["mode_names"]),
            mode_shares=np.array(metadata["mode_shares"]).reshape(-1, 3),
        )
        if table.checksum != metadata["checksum"]:
            raise TableError(f"{path}: is damaged (its checksum differs); build the table again.")
        return table
    except TableError:
        raise
    except OSError as error:
        raise TableError(f"{path}: cannot be read ({error.strerror or error}); {rebuild}") from None
    # A damaged archive raises errors of zipfile, zlib, struct, tokenize, json and NumPy.
    except Exception as error:
        raise TableError(
            f"{path}: is damaged or not a table ({type(error).__name__}: {error}); {rebuild}"
        ) from None
