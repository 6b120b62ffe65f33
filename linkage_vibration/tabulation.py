# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the lookup table: the model is solved where the table's error asks for it, and no more."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

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
_PEAKS = 20.0  # the same where peaks are measured: they change more between the points
_RIVAL = 0.8  # of the highest peak: a maximum that may be higher between the points
_LONG = 0.01  # of the stroke: pieces in which such maxima have to be there all along
_SAME = 1e-3  # of the band: two maxima of one height that are this near are one
_EQUALLY_GOOD = math.log(3.0)  # of a Leja point's product: a point that is solved already serves
_VEERING = 0.03  # of the tolerance: what is left out of shapes that veer by little more than it
_MIXED = 0.9  # of a shape: less of it goes on where two have mixed
_NARROW = 100.0  # tolerances: modes that mix and are nearer than that veer
_BETWEEN = 401  # places in a piece at which polynomials are compared
_MANY = 8  # points of a mechanism up to which all have FRFs in the table unless told otherwise


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """Stroke variables of a piece."""

    fitted: list[float]  # ascending: the points of its polynomials
    held: list[float]  # those that tell their error
    gap: float  # relative error of frequencies where modes cross that veer by next to nothing


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
    peaks: FloatArray  # (2, n), of the drive-point receptance beside each of these, Hz, m/N or NaN
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
    peak_frequencies: FloatArray  # (n, k + 2), the last two at the band's ends; NaN where none
    peak_magnitudes: FloatArray

    def only(self, rows: NDArray[np.bool_]) -> "_Tracked":
        """Return what is tracked at some of the samples, (n,), followed through all of them."""
        some = np.flatnonzero(rows)
        return _Tracked(
            [self.orders[i] for i in some],
            [self.signs[i] for i in some],
            [self.shapes[i] for i in some],
            self.mac[:0],
            self.log_frequencies[some],
            self.ratios[some],
            self.peak_frequencies[some],
            self.peak_magnitudes[some],
        )


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
    that would need more than 48 points is halved, and one in which the highest peak passes from one
    maximum to another that is not there all along. Modes are tracked from point to point by their
    shapes; where a shape might continue two, a point is put between. Where modes seem to cross, the
    model is solved to see whether they do, or veer.

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
    sampler = _Sampler(model, points, solved, tolerance)
    first, last = sampler.ends
    shortest = _SHORTEST * (last - first)
    waiting, pieces = [_start(sampler, first, last)], list[_Piece]()
    poor_before: set[tuple[float, float]] = set()
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
            waiting += _halves(sampler, low, high)
        pieces.sort(key=lambda piece: piece.fitted[0])
        table, poor = _measured(sampler, pieces, tolerance)
        for piece in poor:
            pieces.remove(piece)
            low, high = piece.fitted[0], piece.fitted[-1]
            if (low, high) in poor_before:  # more points have not helped
                waiting += _halves(sampler, low, high)
            else:
                poor_before.add((low, high))
                more = leja_points(piece.fitted, low, high, _BATCH)
                waiting.append(sorted(piece.fitted + more))
    return table


def _halves(sampler: "_Sampler", low: float, high: float) -> list[list[float]]:
    """Return the first points of both halves between two stroke variables."""
    middle = (low + high) / 2.0
    return [_start(sampler, low, middle), _start(sampler, middle, high)]


def _start(sampler: "_Sampler", low: float, high: float) -> list[float]:
    """Return the first points between two stroke variables, near Leja's, some solved already."""
    points, solved = [low, high], [x for x in sampler.samples if low < x < high]
    while len(points) < _FIRST or (solved and len(points) < _MOST // 2):
        best = leja_points(points, low, high, 1)
        products = np.log(np.abs(np.subtract.outer([*best, *solved], points))).sum(axis=1)
        if solved and products[1:].max() > products[0] - _EQUALLY_GOOD:
            best = [solved.pop(int(products[1:].argmax()))]
        elif len(points) >= _FIRST:
            break
        points += best
    return sorted(points)


class _Sampler:
    """Solves a model at angles of the stroke, each once, and keeps what a table needs.

    Parameters
    ----------
    model, points, solved, tolerance
        As in `build_table`.

    Attributes
    ----------
    left_out : float
        Of a gap between modes that cross, as `align` wants it: less once some are known to veer.
    """

    def __init__(
        self,
        model: LinkageModel,
        points: Sequence[str] | None,
        solved: Callable[[], object],
        tolerance: float,
    ) -> None:
        self.model = model
        self.response = model.mechanism.response
        self.from_frfs = model.measured_frequencies is not None
        self.places = () if self.from_frfs else _places(model, points)
        self.mass = np.eye(len(model.interface)) if self.from_frfs else model.system.mass
        toggles = model.kinematics.toggles
        self.toggles = None if toggles is None else (toggles[0].alpha3, toggles[1].alpha3)
        self.samples: dict[float, _Sample] = {}
        self.tolerance = self.left_out = tolerance
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
        if np.isinf(peaks).any():
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
    between: list[float] = []  # where modes could not be told apart
    while len(fitted) <= _MOST:
        more = leja_points(fitted, fitted[0], fitted[-1], _BATCH)
        held = sorted({*more, *between}.difference(fitted))
        every = sorted(fitted + held)
        tracked = _follow(sampler, every)
        long = fitted[-1] - fitted[0] > _LONG * (sampler.ends[1] - sampler.ends[0])
        maxima = _notable(sampler, tracked.peak_frequencies, tracked.peak_magnitudes, long)
        if maxima is None:
            return None
        if _mix_closely(tracked, tolerance):
            sampler.left_out = _VEERING * tolerance
        if (
            _error(sampler, every, fitted, tracked, maxima) > tolerance
            or _difference(sampler, every, fitted, more, tracked, maxima) > tolerance
        ):
            fitted = sorted(fitted + more)
            continue
        doubtful = np.flatnonzero((tracked.mac <= 0.5).any(axis=1))
        if len(doubtful):
            _check_step(sampler, every, tracked, doubtful, shortest)
            between += [(every[i] + every[i + 1]) / 2.0 for i in doubtful]
            continue
        gaps = _gaps(sampler, every, fitted, tracked)
        veering = [x for x, gap in gaps.items() if gap > tolerance / 2.0]
        if not veering:
            return _Piece(fitted, held, max(gaps.values(), default=0.0))
        sampler.left_out = _VEERING * tolerance
        if set(veering) <= set(between):
            return None  # points there did not help; halving will
        between += veering
    return None


def _mix_closely(tracked: _Tracked, tolerance: float) -> bool:
    """Whether shapes mix of modes whose frequencies are next to one another, so that they veer."""
    mixed = np.flatnonzero((tracked.mac <= _MIXED).any(axis=1))
    beside = np.sort(tracked.log_frequencies[[*mixed, *(mixed + 1)]], axis=1)
    return bool((np.diff(beside, axis=1) < _NARROW * tolerance).any())


def _gaps(
    sampler: _Sampler, variables: list[float], fitted: list[float], tracked: _Tracked
) -> dict[float, float]:
    """Solve the model where tracked modes cross, and tell how far apart they are there.

    Modes that veer within a step shorter than those of the table look as if they crossed.

    Returns
    -------
    dict of float to float
        For each stroke variable half the relative gap, which is the error of their frequencies.
    """
    own = np.isin(variables, fitted)
    points, logarithms = np.array(variables)[own], tracked.log_frequencies[own]
    grid = np.linspace(points[0], points[-1], _BETWEEN)
    told = interpolation_matrix(points, grid) @ logarithms
    found = {}
    for one, other in itertools.combinations(range(told.shape[1]), 2):
        apart = told[:, one] - told[:, other]
        for i in np.flatnonzero(apart[:-1] * apart[1:] < 0.0):
            difference = logarithms[:, one] - logarithms[:, other]

            def at(x: float, difference: FloatArray = difference) -> float:
                return float((interpolation_matrix(points, np.array([x])) @ difference)[0])

            x = float(brentq(at, grid[i], grid[i + 1], xtol=1e-15))
            level = (interpolation_matrix(points, np.array([x])) @ logarithms)[0, one]
            off = np.abs(np.log(sampler.at(x).frequencies) - level)
            found[x] = float(np.sort(off)[1])
    return found


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
    band, n = sampler.response.band, len(samples)
    needed = [int(in_reach((2.0 * math.pi * s.frequencies) ** 2, band).sum()) for s in samples]
    needed[0] = max(needed[0], sampler.response.modes)
    most = min(len(s.frequencies) for s in samples)
    count = min(max(needed), most)
    # Where modes lie apart their shapes are their own; so that is where it begins.
    apart = [np.diff(np.log(s.frequencies[: count + 1])).min(initial=math.inf) for s in samples]
    base = int(np.argmax(apart))
    while True:
        orders = [np.arange(count)] * n
        signs, mac = np.ones((n, count)), np.ones((n - 1, count))
        shapes = [samples[base].modes.shapes[:, :count]] * n
        for i in (*range(base + 1, n), *range(base - 1, -1, -1)):
            before = i - 1 if i > base else i + 1
            found = samples[i].modes
            order, sign, criterion = track(shapes[before], found, sampler.mass)
            modes = align(shapes[before], found, sampler.mass, order, sign, sampler.left_out)
            if modes is not found:
                order, sign, criterion = track(shapes[before], modes, sampler.mass)
            orders[i], signs[i], mac[min(i, before)] = order, sign, criterion
            shapes[i] = modes.select(order, sign).shapes
        # A mode in reach at one angle is tracked at all, so that only higher ones are left over.
        missed = [
            len(set(range(few)).difference(order.tolist()))
            for few, order in zip(needed, orders, strict=True)
        ]
        if not any(missed) or count == most:
            break
        count = min(count + max(missed), most)
    turn, rank = signs[0].copy(), np.argsort(orders[0], kind="stable")
    orders = [order[rank] for order in orders]
    peaks = [
        np.hstack([s.peaks[:, order], s.edges]) for s, order in zip(samples, orders, strict=True)
    ]
    return _Tracked(
        orders,
        [(sign * turn)[rank] for sign in signs],
        [(shape * turn)[:, rank] for shape in shapes],
        mac[:, rank],
        np.log([s.frequencies[order] for s, order in zip(samples, orders, strict=True)]),
        np.array([s.ratios[order] for s, order in zip(samples, orders, strict=True)]),
        np.array([peak[0] for peak in peaks]),
        np.maximum([peak[1] for peak in peaks], np.finfo(float).tiny),
    )


def _error(
    sampler: _Sampler,
    variables: list[float],
    fitted: list[float],
    tracked: _Tracked,
    maxima: NDArray[np.bool_],
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
    exact_at, exact_size = tracked.peak_frequencies[:, maxima], tracked.peak_magnitudes[:, maxima]
    at = told(exact_at)
    size = np.exp(np.clip(told(np.log(exact_size)), -_LARGE, _LARGE))
    exact_at, exact_size = exact_at[~own], exact_size[~own]
    for row in range(len(at)):
        # Of two peaks of one height either is the highest: each is held against itself.
        best = _highest(at[row], size[row], low, high)
        height = exact_size[row, _highest(exact_at[row], exact_size[row], low, high)]
        worst = max(worst, abs(size[row, best] / height - 1.0) / _PEAKS)
        worst = max(worst, _apart(at[row, best], exact_at[row, best]) / _PEAKS)
    return worst


def _difference(
    sampler: _Sampler,
    variables: list[float],
    fitted: list[float],
    more: list[float],
    tracked: _Tracked,
    maxima: NDArray[np.bool_],
) -> float:
    """Return how far more points move the polynomials anywhere, in units of frequencies' error."""
    n, band = sampler.response.modes, sampler.response.band
    grid = np.linspace(fitted[0], fitted[-1], _BETWEEN)
    levels, heights = [], []
    for points in (fitted, fitted + more):
        own = np.isin(variables, points)
        matrix = interpolation_matrix(np.array(variables)[own], grid)
        levels.append(matrix @ tracked.log_frequencies[own, :n])
        at = matrix @ tracked.peak_frequencies[own][:, maxima]
        logarithms = matrix @ np.log(tracked.peak_magnitudes[own][:, maxima])
        size = np.exp(np.clip(logarithms, -_LARGE, _LARGE))
        heights.append(np.where(_within(at, *band), size, -1.0).max(axis=1))
    before, after = heights
    moved = float(np.abs(before / after - 1.0).max())
    return max(float(np.abs(levels[0] - levels[1]).max()), moved / _PEAKS)


def _notable(
    sampler: _Sampler, at: FloatArray, sizes: FloatArray, strict: bool
) -> NDArray[np.bool_] | None:
    """Which maxima tell the highest peak over some points of the stroke.

    A maximum serves if it is there at every point. As few as can be are taken, so that each point
    has its highest peak among them, and others that come near to it.

    Parameters
    ----------
    sampler : _Sampler
        Whose band and tolerance count.
    at, sizes : ndarray, (n, n_peaks)
        Hz and m/N of each maximum at each point, ascending; NaN where there is none.
    strict : bool
        Leave out none that nearly is the highest at a point, and might be between points.

    Returns
    -------
    ndarray of bool, (n_peaks,), or None
        None if maxima that are there all along do not suffice.
    """
    low, high = sampler.response.band
    level = 1.0 - min(_PEAKS * sampler.tolerance, 0.1)
    heights = np.where(_within(at, low, high), sizes, 0.0)
    highest = heights.max(axis=1, keepdims=True)
    if not (highest > np.finfo(float).tiny).all():
        raise TableError(
            f"{sampler.model.mechanism.name} does not respond at response.drive_point; choose "
            "another point."
        )
    whole = np.asarray(np.isfinite(sizes).all(axis=0), dtype=np.bool_)
    reached = (heights >= level * highest) & whole
    chosen: NDArray[np.bool_] = np.zeros_like(whole)
    missing: NDArray[np.bool_] = np.ones(len(at), dtype=np.bool_)
    while missing.any():
        # The band's ends stand last, and are smooth where a maximum runs into them.
        count = reached[missing].sum(axis=0)
        best = len(count) - 1 - int(count[::-1].argmax())
        if count[best] == 0:
            return None
        chosen[best] = True
        missing[reached[:, best]] = False

    def meets(row: int, peak: int) -> bool:
        """Whether a maximum is one of those chosen, or as good as one, at a point."""
        near = np.abs(at[row, chosen] - at[row, peak]) <= _SAME * high
        ratio = heights[row, chosen] / np.maximum(heights[row, peak], np.finfo(float).tiny)
        return bool((near & (ratio >= level) & (ratio * level <= 1.0)).any())

    rivals = heights >= _NOTABLE * highest
    for other in np.flatnonzero(whole & rivals.any(axis=0) & ~chosen).tolist():
        # One that runs into another is not smooth there, and not higher than that elsewhere.
        chosen[other] = not any(meets(row, other) for row in range(len(at)))
    left_out = np.argwhere((heights >= _RIVAL * highest) & ~chosen).tolist()
    if strict and not all(meets(row, peak) for row, peak in left_out):
        return None
    return chosen


def _highest(at: FloatArray, size: FloatArray, low: float, high: float) -> int:
    """Which of several maxima is the highest within a band."""
    return int(np.where(_within(at, low, high), size, -1.0).argmax())


def _within(at: FloatArray, low: float, high: float) -> NDArray[np.bool_]:
    """Which maxima are within a band, whose ends belong to it however they are rounded."""
    room = 1e-9 * high
    return np.asarray((low - room <= at) & (at <= high + room))


def _apart(found: float, exact: float) -> float:
    """Relative difference of a frequency, which may be 0."""
    return abs(found - exact) / abs(exact) if exact else abs(found)


def _assemble(sampler: _Sampler, pieces: list[_Piece]) -> tuple[Table, dict[float, FloatArray]]:
    """Make the table of some pieces, its errors not yet measured.

    Returns
    -------
    table : Table
    exact : dict of float to ndarray, (n_modes,)
        Tracked natural frequencies (Hz) at each stroke variable, also where it was not fitted.
    """
    every = sorted({x for piece in pieces for x in (*piece.fitted, *piece.held)})
    tracked = _follow(sampler, every)
    n = sampler.response.modes
    exact = np.exp(tracked.log_frequencies[:, :n])
    rows = [[every.index(x) for x in sorted(piece.fitted + piece.held)] for piece in pieces]
    notable = np.array(
        [
            _notable(sampler, tracked.peak_frequencies[own], tracked.peak_magnitudes[own], False)
            for own in rows
        ]
    )
    used = notable.any(axis=0)
    variables = sorted({x for piece in pieces for x in piece.fitted})
    told = tracked.only(np.isin(every, variables))
    samples = [sampler.at(x) for x in variables]
    ends = [variables.index(piece.fitted[0]) for piece in pieces] + [len(variables) - 1]
    none = np.isnan(told.peak_magnitudes)
    table = Table(
        alpha3=np.array([sample.alpha3 for sample in samples]),
        pieces=np.array(ends, dtype=np.int64),
        natural_frequencies=np.exp(told.log_frequencies[:, :n]),
        damping_ratios=told.ratios[:, :n],
        peak_frequencies=np.where(none, 0.0, told.peak_frequencies)[:, used],
        peak_magnitudes=np.where(none, np.finfo(float).tiny, told.peak_magnitudes)[:, used],
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
    return _with_frfs(table, sampler, samples, told), dict(zip(every, exact, strict=True))


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


def _measured(
    sampler: _Sampler, pieces: list[_Piece], tolerance: float
) -> tuple[Table, list[_Piece]]:
    """Make the table, and measure its errors at the points that it was not fitted to.

    Returns
    -------
    table : Table
    poor : list of _Piece
        Those that are not good enough.
    """
    table, frequencies = _assemble(sampler, pieces)
    n, band = table.n_modes, table.band
    errors, peak_errors, frf_errors = [], [], []
    for piece in pieces:
        worst, peak_error = piece.gap, 0.0
        for x in piece.held:
            sample = sampler.samples[x]
            values, at, size, _ = table.interpolate(sample.alpha3)
            exact = frequencies[x]
            worst = max(worst, float(np.abs(np.array(values[:n]) / exact - 1.0).max()))
            peak = sample.drive.peak(band)
            peak_error = max(peak_error, abs(size / peak.magnitude - 1.0))
            # Of two peaks of one height either is the highest.
            places, sizes = np.hstack([sample.peaks, sample.edges])
            rivals = [peak.frequency, *places[sizes >= (1.0 - 2.0 * peak_error) * peak.magnitude]]
            peak_error = max(peak_error, min(_apart(at, rival) for rival in rivals))
        errors.append(worst)
        peak_errors.append(peak_error)
        frf_errors.append(_frf_error(sampler, table, piece.held))
    told = replace(
        table,
        interpolation_error=np.array(errors),
        peak_error=max(peak_errors),
        frf_error=max(frf_errors) if table.places else math.nan,
    )
    most, most_frf = _LOOSER * tolerance, max(_LOOSER * tolerance, _FRF_FLOOR)
    poor = [
        piece
        for piece, own, peak, frf in zip(pieces, errors, peak_errors, frf_errors, strict=True)
        if own > tolerance or peak > most or frf > most_frf
    ]
    return told, poor


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
