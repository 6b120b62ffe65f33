# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the lookup table: the model is solved where the table's error asks for it, and no more."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import linkage_vibration
from linkage_vibration.interpolation import (
    interpolation_matrix,
    leja_points,
    stroke_angle,
    stroke_variable,
)
from linkage_vibration.mechanics.description import GROUND
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution
from linkage_vibration.mechanics.modes import Modes, align, track
from linkage_vibration.mechanics.response import (
    PoleResidue,
    far_poles,
    in_reach,
    pole_residue,
)
from linkage_vibration.table import Table, TableError

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.intp]

TOLERANCE = 1e-6
"""Of natural frequencies, unless told otherwise."""

_LOOSER = 100.0  # times the tolerance, for peaks and FRFs: they move 1 / (2 zeta) times as much
_FRF_FLOOR = 1e-5  # no better is promised of FRFs: far poles stand for the modes above the band
_FIRST, _BATCH = 6, 3  # points of a piece to begin with, and those that tell their error
_MOST = 48  # points of a piece; one that needs more is halved
_TOTAL = 3000  # points in all
_SHORTEST = 1e-7  # of the stroke: shorter steps are not tried
_SPARE = 4  # modes beyond those in reach that may turn out to continue a tracked one
_LINES = 201  # frequencies at which FRFs are compared, beside those about the resonances
_SILENT = 1e-6  # of what two places respond to themselves: an FRF between them that is none
_NOTABLE = 0.5  # of the highest peak: a lower one is not the highest between the points either
_LARGE = 600.0  # a logarithm that is still that of a number
_MANY = 8  # points of a mechanism up to which all have FRFs in the table unless told otherwise


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """Stroke variables of a piece."""

    fitted: list[float]  # ascending: the points of its polynomials
    held: list[float]  # those that tell their error


@dataclass(frozen=True, slots=True, eq=False)
class _Terms:
    """What the FRFs between the places are made of at one angle."""

    frf: PoleResidue  # every mode
    rows: FloatArray  # (n_places, n_interface), what turns shapes into participations
    complex_shapes: ComplexArray | None  # (n_places, n_modes), where viscous damping couples modes


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    """The model solved at one angle, as far as a table needs it."""

    alpha3: float
    modes: Modes  # those that may be tracked, the lowest
    frequencies: FloatArray  # of these, Hz
    ratios: FloatArray
    peaks: FloatArray  # (2, n), of the drive-point receptance beside each of these, Hz and m/N
    edges: FloatArray  # (2, 2), the same at the band's ends
    drive: PoleResidue
    terms: _Terms | None


@dataclass(frozen=True, slots=True, eq=False)
class _Tracked:
    """Which modes of each sample continue those of the first, and what is tabulated of them."""

    orders: list[IntArray]
    signs: list[FloatArray]
    shapes: list[FloatArray]
    mac: FloatArray  # (n - 1, k), from sample to sample
    log_frequencies: FloatArray  # (n, k)
    ratios: FloatArray  # (n, k)
    peak_frequencies: FloatArray  # (n, k + 2), the last two at the band's ends
    peak_magnitudes: FloatArray


def build_table(
    model: LinkageModel,
    tolerance: float = TOLERANCE,
    points: Sequence[str] | None = None,
    solved: Callable[[], object] = lambda: None,
) -> Table:
    """Tabulate what a prediction tells over the stroke, to a tolerance.

    Every quantity is a polynomial in `stroke_variable`. The model is solved at the points of a Leja
    sequence; the three that come next measure the error of the polynomial through those before
    them, where it is largest, and join them while it is above the tolerance. A piece of the stroke
    that would need more than 48 points is halved. Modes are tracked from point to point by their
    shapes; where a shape might continue two, a point is put between.

    Parameters
    ----------
    model : LinkageModel
        What to tabulate.
    tolerance : float
        Relative, of natural frequencies; a hundred times that of the highest peak's frequency and
        magnitude, and of each FRF between the points (L2 norm over the band; 1e-5 at best).
    points : sequence of str, optional
        Between which points the table is to hold FRFs; all that move, if they are eight at most,
        otherwise the response point. A model from measured FRFs has none.
    solved : callable
        Called after each solution of the model, for a progress bar.

    Raises
    ------
    TableError
        If the tolerance is none, or cannot be met; if the model shows too few modes, or no response
        to speak of; if a mode cannot be followed.
    """
    if not 1e-11 <= tolerance < 1.0:
        raise TableError(
            f"A tolerance of {tolerance:g} cannot be met, or is none; give one from 1e-11 to 1."
        )
    sampler = _Sampler(model, points, solved)
    first, last = sampler.ends
    shortest = _SHORTEST * (last - first)
    waiting, pieces = [_start(sampler, first, last)], list[_Piece]()
    while waiting:
        while waiting:
            fitted = waiting.pop()
            found = _refine(sampler, fitted, tolerance, shortest)
            if found is not None:
                pieces.append(found)
                continue
            low, high = fitted[0], fitted[-1]
            if high - low < 2.0 * shortest or len(sampler.samples) > _TOTAL:
                raise TableError(
                    f"{model.mechanism.name} changes too quickly at alpha3 = "
                    f"{math.degrees(sampler.angle(low)):.4f} deg for a tolerance of {tolerance:g}; "
                    "give a larger one."
                )
            middle = (low + high) / 2.0
            waiting += [_start(sampler, low, middle), _start(sampler, middle, high)]
        pieces.sort(key=lambda piece: piece.fitted[0])
        table, frf_errors = _measured(sampler, pieces)
        for piece, error in zip(list(pieces), frf_errors, strict=True):
            if error > max(_LOOSER * tolerance, _FRF_FLOOR):
                pieces.remove(piece)
                waiting.append(sorted(piece.fitted + piece.held))
    return table


def _start(sampler: "_Sampler", low: float, high: float) -> list[float]:
    """Return the first points between two stroke variables, those already solved among them."""
    points = sorted({low, high, *(x for x in sampler.samples if low < x < high)})
    return sorted(points + leja_points(points, low, high, max(0, _FIRST - len(points))))


class _Sampler:
    """Solves a model at angles of the stroke, each once, and keeps what a table needs.

    Parameters
    ----------
    model, points, solved
        As in `build_table`.
    """

    def __init__(
        self, model: LinkageModel, points: Sequence[str] | None, solved: Callable[[], object]
    ) -> None:
        self.model = model
        self.response = model.mechanism.response
        self.from_frfs = model.measured_frequencies is not None
        self.places = () if self.from_frfs else _places(model, points)
        self.mass = np.eye(len(model.interface)) if self.from_frfs else model.system.mass
        toggles = model.kinematics.toggles
        self.toggles = None if toggles is None else (toggles[0].alpha3, toggles[1].alpha3)
        self.samples: dict[float, _Sample] = {}
        self._solved = solved
        stroke = model.mechanism.stroke
        self.ends = tuple(self._variable(angle) for angle in stroke)
        self._angles = dict(zip(self.ends, stroke, strict=True))  # to the last bit

    def angle(self, variable: float) -> float:
        """Angle of a stroke variable, rad."""
        if variable in self._angles:
            return self._angles[variable]
        return float(stroke_angle(np.array([variable]), self.toggles)[0])

    def at(self, variable: float) -> _Sample:
        """Return the sample at a stroke variable, solved when it is asked for first."""
        if variable not in self.samples:
            self.samples[variable] = self._solve(self.angle(variable))
            self._solved()
        return self.samples[variable]

    def _variable(self, alpha3: float) -> float:
        return float(stroke_variable(np.array([alpha3]), self.toggles)[0])

    def _solve(self, alpha3: float) -> _Sample:
        band = self.response.band
        drive: PoleResidue
        terms = None
        if self.from_frfs:
            identified = self.model.identify(alpha3)
            modes, drive = identified.modes, identified.drive_point
            ratios, elastic = identified.damping_ratios, np.arange(len(modes.omega))
        else:
            solution = self.model.solve(alpha3)
            modes, ratios = solution.modes, solution.damping_ratios
            elastic = np.flatnonzero(~modes.mechanism)
            terms = self._terms(solution)
            own = self.response.point, self.response.direction
            if terms is not None and own in self.places:
                drive = terms.frf.between(self.places.index(own), self.places.index(own))
            else:
                drive = solution.drive_point
        reach = int(in_reach(modes.omega[elastic] ** 2, band).sum())
        some = elastic[: max(self.response.modes, reach) + _SPARE]
        if len(some) < self.response.modes:
            raise TableError(
                f"response.modes asks for {self.response.modes} modes; {self.model.mechanism.name} "
                f"shows {len(some)} at {math.degrees(alpha3):.3f} deg; ask for fewer, keep more "
                "modes a link, or widen response.band_hz where modes are identified from FRFs."
            )
        lost = len(modes.omega) - len(drive.decay)  # mechanism modes have no term there
        peaks = np.array(drive.local_peaks(some - lost, band))
        edges = np.abs(drive.frf(np.array(band))[:, 0, 0])
        if not np.isfinite(peaks).all():
            raise TableError(
                f"{self.model.mechanism.name} is undamped, so that its receptance has no highest "
                "value; give its links damping."
            )
        return _Sample(
            alpha3,
            modes.select(some, np.ones(len(some))),
            modes.omega[some] / (2.0 * math.pi),
            ratios[some],
            peaks,
            np.array([band, np.where(np.isfinite(edges), edges, 0.0)]),
            drive,
            terms,
        )

    def _terms(self, solution: Solution) -> _Terms | None:
        """FRFs between the places, and what their residues are products of."""
        if not self.places or solution.modes.mechanism.any():
            return None
        rows, damped = self.model.rows(self.places, solution.configuration), solution.damped
        undamped = rows @ solution.modes.shapes[: rows.shape[1]]
        shapes = None
        if damped.shapes is not None:
            own = damped.shapes[0]
            # Signs are arbitrary; take those of the undamped modes, so that these tell them.
            turn = np.exp(0.25j * math.pi) if damped.poles is not None else 1.0
            shapes = undamped @ (own * np.where((np.diag(own) * turn).real < 0.0, -1.0, 1.0))
        return _Terms(pole_residue(damped, undamped, undamped), rows, shapes)


def _refine(
    sampler: _Sampler, fitted: list[float], tolerance: float, shortest: float
) -> _Piece | None:
    """Add points until natural frequencies and peaks meet the tolerance; None if too many."""
    while len(fitted) <= _MOST:
        held = leja_points(fitted, fitted[0], fitted[-1], _BATCH)
        every = sorted(fitted + held)
        tracked = _follow(sampler, every)
        doubtful = np.flatnonzero((tracked.mac <= 0.5).any(axis=1))
        if _error(sampler, every, fitted, tracked) > tolerance:
            fitted = every
        elif len(doubtful):
            _check_step(sampler, every, tracked, doubtful, shortest)
            fitted = sorted([*fitted, *((every[i] + every[i + 1]) / 2.0 for i in doubtful)])
        else:
            return _Piece(fitted, held)
    return None


def _check_step(
    sampler: _Sampler, variables: list[float], tracked: _Tracked, doubtful: IntArray, least: float
) -> None:
    """Refuse to halve a step for ever where a mode's shape tells no continuation."""
    for i in doubtful:
        if variables[i + 1] - variables[i] < least:
            modes = 1 + np.flatnonzero(tracked.mac[i] <= 0.5)
            raise TableError(
                f"Mode {' and mode '.join(map(str, modes))} cannot be followed past alpha3 = "
                f"{math.degrees(sampler.angle(variables[i])):.5f} deg: the shape there resembles "
                "none on the other side; keep fewer modes in response.modes, or end the stroke "
                "before."
            )


def _follow(sampler: _Sampler, variables: list[float]) -> _Tracked:
    """Track the modes in reach of the band over samples in ascending order."""
    samples = [sampler.at(x) for x in variables]
    band = sampler.response.band
    reach = [int(in_reach((2.0 * math.pi * s.frequencies) ** 2, band).sum()) for s in samples]
    count = max(sampler.response.modes, *reach)
    while True:
        count = min(count, *(len(s.frequencies) for s in samples))
        orders, signs, mac = [np.arange(count)], [np.ones(count)], []
        shapes = [samples[0].modes.shapes[:, :count]]
        for sample in samples[1:]:
            modes = align(shapes[-1], sample.modes, sampler.mass)
            order, sign, criterion = track(shapes[-1], modes, sampler.mass)
            shapes.append(modes.select(order, sign).shapes)
            orders.append(order)
            signs.append(sign)
            mac.append(criterion)
        # A mode in reach at one angle is tracked at all, so that only higher ones are left over.
        missed = [
            len(set(range(n)).difference(order.tolist()))
            for n, order in zip(reach, orders, strict=True)
        ]
        if not any(missed) or count == min(len(s.frequencies) for s in samples):
            break
        count += max(missed)
    peaks = [
        np.hstack([s.peaks[:, order], s.edges]) for s, order in zip(samples, orders, strict=True)
    ]
    return _Tracked(
        orders,
        signs,
        shapes,
        np.array(mac),
        np.log([s.frequencies[order] for s, order in zip(samples, orders, strict=True)]),
        np.array([s.ratios[order] for s, order in zip(samples, orders, strict=True)]),
        np.array([peak[0] for peak in peaks]),
        np.maximum([peak[1] for peak in peaks], np.finfo(float).tiny),
    )


def _error(
    sampler: _Sampler, variables: list[float], fitted: list[float], tracked: _Tracked
) -> float:
    """Return the worst error where the polynomials were not fitted, in units of frequencies'."""
    n = sampler.response.modes
    low, high = sampler.response.band
    own = np.isin(variables, fitted)
    matrix = interpolation_matrix(np.array(variables)[own], np.array(variables)[~own])

    def told(values: FloatArray) -> FloatArray:
        return np.asarray(matrix @ values[own])

    frequencies = tracked.log_frequencies[:, :n]
    worst = float(np.abs(told(frequencies) - frequencies[~own]).max())
    notable = _notable(sampler, tracked.peak_frequencies[own], tracked.peak_magnitudes[own])
    at = told(tracked.peak_frequencies)
    size = np.exp(np.clip(told(np.log(tracked.peak_magnitudes)), -_LARGE, _LARGE)) * notable
    exact_at, exact_size = tracked.peak_frequencies[~own], tracked.peak_magnitudes[~own]
    for row in range(len(at)):
        # Of two peaks of one height either is the highest: each is held against itself.
        best = _highest(at[row], size[row], low, high)
        height = exact_size[row, _highest(exact_at[row], exact_size[row], low, high)]
        worst = max(worst, abs(size[row, best] / height - 1.0) / _LOOSER)
        worst = max(worst, _apart(at[row, best], exact_at[row, best]) / _LOOSER)
    return worst


def _notable(sampler: _Sampler, at: FloatArray, sizes: FloatArray) -> NDArray[np.bool_]:
    """Which maxima, (n, n_peaks), are the highest at one of n points, or might be between them."""
    highest = np.array(
        [size[_highest(f, size, *sampler.response.band)] for f, size in zip(at, sizes, strict=True)]
    )
    if not (highest > np.finfo(float).tiny).all():
        raise TableError(
            f"{sampler.model.mechanism.name} does not respond at response.drive_point; choose "
            "another point."
        )
    return np.asarray((sizes >= _NOTABLE * highest[:, np.newaxis]).any(axis=0))


def _highest(at: FloatArray, size: FloatArray, low: float, high: float) -> int:
    """Which of several maxima is the highest within a band."""
    room = 1e-9 * high
    return int(np.where((low - room <= at) & (at <= high + room), size, -1.0).argmax())


def _apart(found: float, exact: float) -> float:
    """Relative difference of a frequency, which may be 0."""
    return abs(found - exact) / abs(exact) if exact else abs(found)


def _assemble(sampler: _Sampler, pieces: list[list[float]]) -> Table:
    """Make the table of pieces that hold these points, its errors not yet measured."""
    variables = sorted({x for piece in pieces for x in piece})
    samples = [sampler.at(x) for x in variables]
    tracked = _follow(sampler, variables)
    n = sampler.response.modes
    ends = [variables.index(piece[0]) for piece in pieces] + [len(variables) - 1]
    notable = np.array(
        [
            _notable(sampler, tracked.peak_frequencies[rows], tracked.peak_magnitudes[rows])
            for rows in (slice(a, b + 1) for a, b in zip(ends[:-1], ends[1:], strict=True))
        ]
    )
    used = notable.any(axis=0)
    table = Table(
        alpha3=np.array([sample.alpha3 for sample in samples]),
        pieces=np.array(ends, dtype=np.int64),
        natural_frequencies=np.exp(tracked.log_frequencies[:, :n]),
        damping_ratios=tracked.ratios[:, :n],
        peak_frequencies=tracked.peak_frequencies[:, used],
        peak_magnitudes=tracked.peak_magnitudes[:, used],
        peak_notable=notable[:, used],
        interpolation_error=np.zeros(len(pieces)),
        peak_error=math.nan,
        frf_error=math.nan,
        toggles=sampler.toggles,
        band=sampler.response.band,
        places=(),
        term_stiffness=np.zeros((len(samples), 0), dtype=complex),
        term_decay=np.zeros((len(samples), 0)),
        participations=np.zeros((len(samples), 0, 0), dtype=complex),
        complex_modes=False,
        far_stiffness=np.zeros(0, dtype=complex),
        far_decay=np.zeros(0),
        far_residues=np.zeros((len(samples), 1, 0)),
        model_hash=sampler.model.mechanism.model_hash,
        mechanism_name=sampler.model.mechanism.name,
        package_version=linkage_vibration.__version__,
    )
    return _with_frfs(table, sampler, samples, tracked)


def _with_frfs(table: Table, sampler: _Sampler, samples: list[_Sample], tracked: _Tracked) -> Table:
    """Add the terms of FRFs to a table, where the model has such terms."""
    terms = [sample.terms for sample in samples if sample.terms is not None]
    if len(terms) < len(samples):
        return table
    # Terms are numbered as all modes are, since there is no mechanism mode.
    kept = []
    for term, order in zip(terms, tracked.orders, strict=True):
        kept.append(np.zeros(len(term.frf.decay), dtype=bool))
        kept[-1][order] = True
    stiffness = np.array([t.frf.stiffness[o] for t, o in zip(terms, tracked.orders, strict=True)])
    decay = np.array([t.frf.decay[o] for t, o in zip(terms, tracked.orders, strict=True)])
    coupled = any(t.frf.rates.any() for t in terms)
    if coupled and (decay**2 >= 4.0 * stiffness.real).any():
        return table  # a mode damped beyond oscillation is no pair of conjugate poles
    participations: list[ComplexArray] = []
    for i, (term, order) in enumerate(zip(terms, tracked.orders, strict=True)):
        if term.complex_shapes is not None:
            participations.append(term.complex_shapes[:, order] * tracked.signs[i])
        else:
            shapes = tracked.shapes[i][: term.rows.shape[1]]
            participations.append((term.rows @ shapes).astype(complex))
    far = far_poles(
        np.concatenate([t.frf.stiffness[~k] for t, k in zip(terms, kept, strict=True)]),
        np.concatenate([t.frf.decay[~k] for t, k in zip(terms, kept, strict=True)]),
        table.band,
    )
    upper = np.triu_indices(len(sampler.places))
    n_far = len(far.stiffness)
    residues = []
    for term, own in zip(terms, kept, strict=True):
        condensed = term.frf.condensed(own, far)
        tail = condensed.residues[:, :, len(condensed.decay) - n_far :]
        both = np.concatenate([condensed.residual[:, :, np.newaxis], tail], axis=2)
        residues.append(both[upper].T)
    far_residues = np.array(residues)
    return replace(
        table,
        places=sampler.places,
        term_stiffness=stiffness,
        term_decay=decay,
        participations=np.array(participations),
        complex_modes=coupled,
        far_stiffness=far.stiffness,
        far_decay=far.decay,
        far_residues=far_residues if far_residues.imag.any() else far_residues.real,
    )


def _measured(sampler: _Sampler, pieces: list[_Piece]) -> tuple[Table, list[float]]:
    """Make the table, and measure its errors at the points that it was not fitted to.

    Returns
    -------
    table : Table
    frf_errors : list of float
        Of each piece.
    """
    table = _assemble(sampler, [piece.fitted for piece in pieces])
    n, band = table.n_modes, table.band
    errors, frf_errors, peak_error = [], [], 0.0
    for piece in pieces:
        every = sorted(piece.fitted + piece.held)
        tracked = _follow(sampler, every)
        worst = 0.0
        for x in piece.held:
            sample = sampler.samples[x]
            values, at, size, _ = table.interpolate(sample.alpha3)
            exact = np.exp(tracked.log_frequencies[every.index(x), :n])
            worst = max(worst, float(np.abs(np.sort(values[:n]) / np.sort(exact) - 1.0).max()))
            peak = sample.drive.peak(band)
            peak_error = max(peak_error, abs(size / peak.magnitude - 1.0))
            # Of two peaks of one height either is the highest.
            row = every.index(x)
            level = tracked.peak_magnitudes[row] >= (1.0 - 2.0 * peak_error) * peak.magnitude
            rivals = [peak.frequency, *tracked.peak_frequencies[row][level]]
            peak_error = max(peak_error, min(_apart(at, rival) for rival in rivals))
        errors.append(worst)
        frf_errors.append(_frf_error(sampler, table, piece.held))
    told = replace(
        table,
        interpolation_error=np.array(errors),
        peak_error=peak_error,
        frf_error=max(frf_errors) if table.places else math.nan,
    )
    return told, frf_errors


def _frf_error(sampler: _Sampler, table: Table, held: list[float]) -> float:
    """Return the relative L2 error of the worst FRF at points that the table was not fitted to."""
    if not table.places:
        return 0.0
    worst = 0.0
    for x in held:
        sample = sampler.samples[x]
        assert sample.terms is not None
        found, exact = table.frf(sample.alpha3, table.places, table.places), sample.terms.frf
        lines = exact.lines(table.band, _LINES)
        weights = np.sqrt(np.gradient(lines))[:, np.newaxis, np.newaxis]
        true = weights * exact.frf(lines)
        size = np.linalg.norm(true, axis=0)
        # What does not respond at all but for rounding has no relative error.
        size = np.maximum(size, _SILENT * np.sqrt(np.outer(np.diag(size), np.diag(size))))
        apart = np.linalg.norm(weights * found.frf(lines) - true, axis=0)
        worst = max(worst, float((apart[size > 0.0] / size[size > 0.0]).max(initial=0.0)))
    return worst


def _places(model: LinkageModel, points: Sequence[str] | None) -> tuple[Place, ...]:
    """Return the points that the table has FRFs between, each along x and z."""
    mechanism = model.mechanism
    if points is None:
        moving = {p for body in mechanism.bodies for p in mechanism.local_points(body.name)}
        names = sorted(moving.difference(mechanism.local_points(GROUND)))
        points = names if len(names) <= _MANY else [mechanism.response.point]
    for point in points:
        if not mechanism.owners(point):
            raise TableError(f"There is no point {point} in {mechanism.name} to have FRFs at.")
    return tuple((point, direction) for point in points for direction in ("x", "z"))
