# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How strongly the ground under the wheels shakes the response point and loads pins and cylinders.

The wheels of all mounts of the base follow one another on two tracks. The heights are random, with
the power spectral density G(n) over the wavenumber n, so that levels are sums over frequencies.
The mean of both tracks excites the vertical half, and half of their difference the lateral one.
Both do not correlate, so that mean squares of both halves add.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray, IntArray, normal_share
from linkage_vibration.mechanics.description import Mechanism, Mount
from linkage_vibration.mechanics.forces import is_force, tyre_place
from linkage_vibration.mechanics.model import LinkageModel, Place
from linkage_vibration.mechanics.response import PoleResidue
from linkage_vibration.prediction.level_cache import Arrays, Keep, computed
from linkage_vibration.table.interpolation import angles_in_table, stroke_angle, stroke_variable
from linkage_vibration.table.table import Table

Reals = NDArray[np.floating[Any]]  # Those of the ensemble have single precision
Reasons = NDArray[np.int8]
Spectrum = tuple[tuple[float, float], ...]  # wavenumbers, 1/m, ascending, and densities, m3

N_FREQUENCIES = 512  # Frequencies, even in their logarithm, over which levels are summed

SEGMENTS = 8  # A profile is divided into so many parts, and those that overlap them by half.

MAX_UNKNOWN_POWER, MAX_OFF_GROUND = 0.2, 0.2
"""Largest share of the power of the acceleration at wavelengths that are not known, and of the time
that a tyre is off the ground, with which a level is known, 1."""

REASONS = (
    "",
    "The mechanism has no base on two or more mounts, so the ground under them is not modelled.",
    "A tool is in the soil (`raised: false`), and forces of the soil are not modelled.",
    "The table has no FRFs at the mounts of the base up to the highest frequency of the terrain.",
    "Over a fifth of the acceleration's power lies above half of the frequency of the lugs.",
    "Over a fifth of the acceleration's power lies at waves that the measured profile lacks.",
    "A tyre is off the ground for more than a fifth of the time, so the tyres are not springs.",
    "The static loads of the mounts are not known, so a tyre may be off the ground.",
    "The crank angle is not known, or is outside the table.",
    "The ground speed is not known, or is not between 0 and 100 m/s.",
    "The damping ratio of a mode in the band of the terrain is too small for a level.",
)
"""Why a level of the ground is not known, by the numbers in `GroundLevels.reason`."""

_BASE, _SOIL, _FRFS, _LUGS, _PROFILE, _OFF, _STATIC, _ANGLE, _SPEED, _LIGHT = range(1, len(REASONS))
FASTEST, _SLOWEST = 100.0, 0.1  # m/s; slower, the mounts move as if they did not share a profile
_STEP, _PHASE = 0.02, 1.5  # largest steps between speeds: of ln(speed), and of a delay's phase, rad
_ANGLE_STEPS, _DEGREE = (32, 128), math.radians(1.0)  # least and most steps, and their size
_MAX_FREQUENCIES, _PER_HALF_WIDTH = 4096, 1.5  # most of them, and how many resolve a half-width
_FLATTEST = 0.1  # of exponents of coherence; tracks with a flatter spectrum are independent
_FARTHEST = 500.0  # of x, where the coherence is 0 in double precision
_OTHERS = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]  # of four neighbours
_PRODUCTS = np.array([[-6.0], [2.0], [-2.0], [6.0]])  # of the distances of each to the others
_BLOCK = 32, 256  # OpenBLAS multiplies two matrices of this shape with one thread.


class GroundError(LinkageVibrationError):
    """The vibration by the ground is not known."""


@dataclass(frozen=True, slots=True)
class Terrain:
    """The ground as a random surface, on which each of both wheels of an axle has its own track.

    The one-sided density of a track over wavenumbers n, 1/m, is roughness (n / reference)^-exponent
    in m3 (ISO 8608: exponent 2, reference 0.1 1/m).
    """

    roughness: float
    exponent: float = 2.0
    reference: float = 0.1
    band: tuple[float, float] = (0.3, 20.0)  # that counts, Hz
    lug_pitch: float | None = None  # m, on the circumference; None without lugs
    raised: bool = True  # no tool is in the soil
    relative_stddev: float = 0.0  # of ln(amplitude)
    spectrum: Spectrum | None = None  # measured on one track, or of the mean of two
    difference: Spectrum | None = None  # of half the difference of two measured tracks
    track: float | None = None  # m, between the wheels of every axle; None: `Mount.track`

    def psd(self, frequency: FloatArray, speed: FloatArray) -> FloatArray:
        """Return the density of the height over frequencies in Hz, m2/Hz, at speeds in m/s."""
        n = frequency / speed
        if self.spectrum is None:
            return np.asarray(self.roughness * (n / self.reference) ** -self.exponent / speed)
        return self._measured(self.spectrum, n) / speed

    def _measured(self, spectrum: Spectrum, n: FloatArray) -> FloatArray:
        """Return a measured density at wavenumbers, 1/m, with the exponent beyond its ends, m3."""
        at, density = np.log(np.array(spectrum)).T
        beyond = np.log(n) - np.clip(np.log(n), at[0], at[-1])
        inside = np.interp(np.log(n), at, density)
        return np.asarray(np.exp(inside - self.exponent * beyond))

    def coherence(self, n: FloatArray, apart: float) -> FloatArray:
        """Return the cross density of parallel tracks, apart by m, over the density of one.

        On an isotropic plane, whose density is (n^2 + m^2)^-(w + 1)/2, with m across, it follows by
        a Fourier transform over m: 2^(1-v) x^v K_v(x) / Gamma(v), with v = w / 2, x = 2 pi n apart.
        """
        if apart == 0.0:
            return np.ones_like(n)
        order = max(self.exponent, _FLATTEST) / 2.0
        x = np.minimum(2.0 * math.pi * apart * n, _FARTHEST)
        size = 2.0 ** (1.0 - order) / math.gamma(order)
        bessel = scipy.special.k1(x) if order == 1.0 else scipy.special.kv(order, x)
        return np.asarray(size * x**order * bessel)

    def share(
        self, n: FloatArray, tracks: tuple[float, float], *, difference: bool = False
    ) -> FloatArray:
        """Return the cross density of means or half differences of two axles, over `psd`."""
        if self.spectrum and self.difference:
            one = np.ones_like(n)
            return self._measured(self.difference, n) / self.psd(n, one) if difference else one
        near, far = (self.coherence(n, abs(tracks[0] + side * tracks[1]) / 2) for side in (-1, 1))
        return (near - far if difference else near + far) / 2.0

    def tracks(self, mounts: Sequence[Mount]) -> list[float]:
        """Return the distance between the wheels of each mount, m."""
        return [mount.track if self.track is None else self.track for mount in mounts]

    @property
    def wavenumbers(self) -> tuple[float, float]:
        """Least and largest wavenumber at which the motion of the mounts is known, 1/m."""
        ends = (self.spectrum[0][0], self.spectrum[-1][0]) if self.spectrum else (1e-9, 1e9)
        return ends[0], ends[1] if self.lug_pitch is None else min(ends[1], 0.5 / self.lug_pitch)


def profile_spectrum(distance: FloatArray, height: FloatArray) -> Spectrum:
    """Return wavenumbers, 1/m, and power spectral densities, m3, of a profile by Welch's method.

    They are means over a sixth of an octave, up to half of what the spacing shows, as shorter waves
    may be folded. Distances, (n,), m, ascend.
    """
    spacing = float(np.median(np.diff(distance)))
    even = np.arange(distance[0], distance[-1], spacing)
    heights, length = np.interp(even, distance, height), len(even) // SEGMENTS
    n, density = _mean_spectrum(heights, spacing, length)
    kept = slice(2, 1 + length // 4)  # A straight line is removed, with most of the first.
    n, density = n[kept], density[kept]
    part = np.floor(6.0 * np.log2(n / n[0]))
    means = [(np.exp(np.log(n[part == i]).mean()), density[part == i].mean()) for i in set(part)]
    return tuple(sorted((float(at), float(mean)) for at, mean in means))


def _mean_spectrum(
    heights: FloatArray, spacing: float, length: int
) -> tuple[FloatArray, FloatArray]:
    """Return wavenumbers, 1/m, and densities, m3, by segments that overlap by half."""
    segments = sliding_window_view(heights, length)[:: length - length // 2]
    line, _ = np.linalg.qr(np.vander(np.arange(length) / length, 2))
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    spectra = np.fft.rfft(window * (segments - segments @ line @ line.T))
    density = 2.0 * spacing * (np.abs(spectra) ** 2).mean(axis=0) / (window @ window)
    return np.asarray(np.fft.rfftfreq(length, spacing)), np.asarray(density)


def power_law(spectrum: Spectrum, reference: float) -> tuple[float, float]:
    """Return the roughness, m3, at a reference, 1/m, and the exponent that fit a spectrum best."""
    at, density = np.log(np.array(spectrum)).T
    slope, offset = np.polyfit(at - math.log(reference), density, 1)
    return math.exp(offset), -float(slope)


@dataclass(frozen=True, slots=True, eq=False)
class GroundSquares:
    """Coefficients from which mean squares at any speed follow (`mean_squares`)."""

    terrain: Terrain
    frequencies: FloatArray  # (n_f,), Hz, even in their logarithm
    tracks: tuple[tuple[float, float], ...]  # m: of mounts with one track, then of each pair
    apart: FloatArray  # (n_pairs,), m: by how much the first mount of each pair is behind
    values: NDArray[np.float32]  # (n_out, n_tracks + 2 n_pairs, n_f): of 1, cosines and sines
    difference: bool = False  # whether half the difference of the tracks excites, not their mean


@dataclass(frozen=True, slots=True, eq=False)
class GroundLevels:
    """Levels at n angles and speeds; NaN where they are not known."""

    velocity: FloatArray  # (n,), of the response point, rms, m/s
    acceleration: FloatArray  # (n,), rms, m/s2
    forces2: FloatArray  # (n_outputs, n): mean squares of the forces, N2
    tyres2: FloatArray  # (n_mounts, n): those of tyres, also where these are off the ground
    loads: FloatArray  # (n_mounts, n): static loads of the mounts, N
    off_ground_share: FloatArray  # (n,), largest share of the time a tyre is off the ground, 1
    reason: Reasons  # (n,): why they are not known, of `REASONS`

    def rows(self, which: IntArray) -> "GroundLevels":
        """Return the levels with these indices."""
        return GroundLevels(*(getattr(self, each.name)[..., which] for each in fields(self)))

    def with_share(self, share: FloatArray) -> "GroundLevels":
        """Return the levels with the largest share of the time that a tyre is off the ground, 1."""
        off = np.where(share > MAX_OFF_GROUND, _OFF, np.where(np.isnan(share), _STATIC, 0))
        reason = np.where(self.reason > 0, self.reason, off).astype(np.int8)
        names = ("velocity", "acceleration", "forces2") if reason.any() else ()
        known = {name: np.where(reason > 0, math.nan, getattr(self, name)) for name in names}
        return replace(self, off_ground_share=share, reason=reason, **known)


def off_ground_share(loads: Reals, forces2: Reals) -> FloatArray:
    """Return the largest share of the time that a tyre is off the ground, (n,), 1."""
    if not len(loads):
        return np.full(loads.shape[1], math.nan)
    # The sum of the forces by all excitations is taken as normally distributed.
    with np.errstate(divide="ignore", invalid="ignore"):  # no force
        least = (loads / np.sqrt(forces2)).min(axis=0)
    return normal_share(-least)


def vertical_mounts(mechanism: Mechanism) -> tuple[Mount, ...]:
    """Return the mounts of the base through which the ground moves it along z."""
    mounts = () if mechanism.base is None else mechanism.base.mounts
    return tuple(mount for mount in mounts if mount.stiffness[1] or mount.damping[1])


def lateral_mounts(mechanism: Mechanism) -> tuple[Mount, ...]:
    """Return those of `vertical_mounts` whose axles do not pivot, and so roll the base."""
    mounts = vertical_mounts(mechanism)
    if mechanism.base is None or mechanism.lateral is None:
        return ()
    axles = zip(mechanism.base.mounts, mechanism.lateral.axles, strict=True)
    return tuple(mount for mount, axle in axles if axle.track and mount in mounts)


@dataclass(frozen=True, slots=True, eq=False)
class Half:
    """A half of a linkage, and the mounts through which the mean or the difference excites it."""

    source: Table | LinkageModel
    mounts: tuple[Mount, ...]
    difference: bool

    @property
    def inputs(self) -> list[Place]:
        """The places of forces of the mounts; in the lateral half, at left wheels."""
        return [(mount.name, "z") for mount in self.mounts]

    def knows(self, place: Place) -> bool:
        """Return whether a place responds in this half."""
        if isinstance(self.source, Table):
            return place in self.source.frf_outputs
        directions = self.source.interface.directions
        return place[1] in directions or place in self.source.forces.places


def halves_of(source: Table | LinkageModel, mechanism: Mechanism) -> list[Half]:
    """Return the vertical half of a mechanism, and the lateral one if the ground excites it."""
    both, mounts = [Half(source, vertical_mounts(mechanism), False)], lateral_mounts(mechanism)
    if mounts and isinstance(source, LinkageModel):
        other = LinkageModel(mechanism, half="lateral", vertical=source)
        both.append(Half(other, mounts, True))
    elif mounts and isinstance(source, Table) and source.lateral is not None:
        both.append(Half(source.lateral, mounts, True))
    return both


def _refusal(mounts: Sequence[Mount], terrain: Terrain) -> int:
    """Return why the ground under mounts is not modelled, of `REASONS`, or 0."""
    if len(mounts) < 2:
        return _BASE
    return 0 if terrain.raised else _SOIL


def ground_lines(terrain: Terrain, count: int = N_FREQUENCIES) -> FloatArray:
    """Return frequencies of the band of a terrain, even in their logarithm, (count,), Hz."""
    return np.asarray(np.geomspace(*terrain.band, count))


def ground_transfer(
    frf: PoleResidue, mounts: Sequence[Mount], frequencies: FloatArray, outputs: Sequence[Place]
) -> ComplexArray:
    """Return responses per displacement of the soil under each mount, (n_out, n_mounts, n_f)."""
    stiffness, damping = np.array([(m.stiffness[1], m.damping[1]) for m in mounts]).T
    impedance = stiffness[:, np.newaxis] + 2j * math.pi * np.multiply.outer(damping, frequencies)
    # A tyre is compressed by the motion of the soil under it, too.
    own = np.array([[[tyre_place(mount.name) == each] for mount in mounts] for each in outputs])
    return np.asarray((frf.frf(frequencies).transpose(1, 2, 0) - own) * impedance)


def ground_squares(
    transfer: ComplexArray,
    orders: Sequence[int],
    mounts: Sequence[Mount],
    terrain: Terrain,
    frequencies: FloatArray,
    difference: bool = False,
) -> GroundSquares:
    """Return coefficients of mean squares of a `ground_transfer`, whose derivatives have orders."""
    transfer = transfer * (2.0 * math.pi * frequencies) ** np.reshape(orders, (-1, 1, 1))
    tracks, pairs = terrain.tracks(mounts), list(combinations(range(len(mounts)), 2))
    crossed = [2.0 * transfer[:, i] * transfer[:, j].conj() for i, j in pairs]
    # |T_i exp(-i w t_i) + T_j exp(-i w t_j)|^2, with t_i - t_j = (x_j - x_i) / speed
    power, widths = np.abs(transfer) ** 2, sorted(set(tracks))
    values = [power[:, np.equal(tracks, width)].sum(axis=1) for width in widths]
    values += [*(x.real for x in crossed), *(x.imag for x in crossed)]
    apart = np.array([mounts[j].at[0] - mounts[i].at[0] for i, j in pairs])
    both = *((each, each) for each in widths), *((tracks[i], tracks[j]) for i, j in pairs)
    rows = np.stack(values, axis=1).astype(np.float32)
    return GroundSquares(terrain, frequencies, both, apart, rows, difference)


def mean_squares(
    squares: GroundSquares, speeds: FloatArray, *, uncovered: bool = False, wheels: bool = False
) -> FloatArray:
    """Return mean squares at speeds above 0 m/s, (n_out, n_speeds).

    They are those of the wavelengths that the terrain knows, or if `uncovered` those of all others;
    and those by the mean of both tracks, or if `wheels` by the tracks of the wheels on one side.
    """
    weights = line_weights(squares, speeds, uncovered=uncovered, wheels=wheels)
    return weighted(squares, weights)


def weighted(squares: GroundSquares, weights: NDArray[np.float32]) -> FloatArray:
    """Return mean squares, (n_out, n_speeds), by the `line_weights` of the same lines."""
    values = squares.values.reshape(len(squares.values), -1)
    # The last bits of a large product depend on the number of threads of BLAS.
    pairs = zip(_blocks(values), _blocks(weights), strict=True)
    product = sum(rows[:, np.newaxis] @ columns.swapaxes(1, 2) for rows, columns in pairs)
    whole = np.swapaxes(product, 1, 2).reshape(_BLOCK[0] * len(product), -1)
    return np.asarray(whole[: len(values), : len(weights)], np.float64)


def _blocks(matrix: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return blocks of a matrix, filled with zeros: (n_across, n_down, *_BLOCK)."""
    height, width = _BLOCK
    down, across = (-size % of for size, of in zip(matrix.shape, _BLOCK, strict=True))
    filled = np.pad(matrix, ((0, down), (0, across)))
    return filled.reshape(-1, height, filled.shape[1] // width, width).transpose(2, 0, 1, 3)


def line_weights(
    squares: GroundSquares, speeds: FloatArray, *, uncovered: bool = False, wheels: bool = False
) -> NDArray[np.float32]:
    """Return what coefficients are multiplied with at speeds, (n_speeds, n), in their order."""
    f, terrain, speeds = squares.frequencies, squares.terrain, speeds[:, np.newaxis]
    step = math.log(f[1] / f[0])
    # A limit between two lines cuts a part of what the nearer one stands for.
    low, high = (np.log(n * speeds) - np.log(f) for n in terrain.wavenumbers)
    covered = np.clip(0.5 + high / step, 0.0, 1.0) * np.clip(0.5 - low / step, 0.0, 1.0)
    size = terrain.psd(f, speeds) * f * step * (1.0 - covered if uncovered else covered)
    size[:, [0, -1]] /= 2.0
    shares = {
        tracks: terrain.share(f / speeds, tracks, difference=squares.difference)
        for tracks in set(squares.tracks)
    }
    if wheels:  # The height under one wheel is the sum of the mean and of half the difference.
        for tracks, share in shares.items():
            share += terrain.share(f / speeds, tracks, difference=True)
    every = [shares[tracks] for tracks in squares.tracks]
    first = len(every) - len(squares.apart)
    parts = [size * share for share in every[:first]]
    angles = 2.0 * math.pi * f * (squares.apart[:, np.newaxis, np.newaxis] / speeds)
    # Lines that are too far apart for a delay count as if it were long, which it then is.
    near = np.clip(2.0 - 2.0 / math.pi * step * np.abs(angles), 0.0, 1.0)
    coherent = size * np.reshape(every[first:], angles.shape) * near
    parts += [*(coherent * np.cos(angles)), *(coherent * np.sin(angles))]
    return np.concatenate(parts, axis=1, dtype=np.float32)


def ground_spectrum(
    source: Table | LinkageModel,
    mechanism: Mechanism,
    terrain: Terrain,
    place: Place,
    alpha3: float,
    speed: float,
) -> tuple[FloatArray, FloatArray]:
    """Return frequencies, Hz, and a density, m2/s2/Hz or N2/Hz; NaN at waves that are not known."""
    halves, f = halves_of(source, mechanism), ground_lines(terrain)
    if refused := _refusal(halves[0].mounts, terrain) or (0 if 0.0 < speed < math.inf else _SPEED):
        raise GroundError(REASONS[refused])
    density = np.zeros(len(f))
    for half in [each for each in halves if each.knows(place)] or halves[:1]:
        mounts, tracks = half.mounts, terrain.tracks(half.mounts)
        if isinstance(half.source, Table):
            frf = half.source.frf(alpha3, [place], half.inputs)
        else:
            frf = half.source.solve(alpha3).frf([place], half.inputs)
        behind = np.array([[mount.at[0]] for mount in mounts])
        delayed = np.exp(2j * math.pi * f * (behind - behind.max()) / speed)
        parts = ground_transfer(frf, mounts, f, [place])[0] * delayed
        response = parts.sum(axis=0)
        if not is_force(place):
            parts, response = (each * 2.0 * math.pi * f for each in (parts, response))
        # Where its roll is not modelled, a tyre feels half of the difference of both tracks, too.
        own = mechanism.lateral is None and place in [tyre_place(mount.name) for mount in mounts]
        shares = sum(
            np.array(
                [
                    [terrain.share(f / speed, (a, b), difference=each) for b in tracks]
                    for a in tracks
                ]
            )
            for each in {half.difference, half.difference or own}
        )
        lost = np.einsum("if,jf,ijf->f", parts, parts.conj(), 1.0 - shares).real
        density += np.abs(response) ** 2 - lost
    low, high = terrain.wavenumbers
    height = np.where(
        (f >= low * speed) & (f <= high * speed), terrain.psd(f, np.array(speed)), math.nan
    )
    return f, density * height


class GroundTable:
    """Levels of vibration by the ground at any angle of a table and any speed."""

    def __init__(
        self,
        table: Table,
        mechanism: Mechanism,
        terrain: Terrain,
        outputs: Sequence[Place] = (),  # forces of either half whose mean squares are wanted
        point: Place | None = None,  # that moves; by default the response point
        keep: Keep = computed,
    ) -> None:
        self._table, self._terrain, self._keep = table, terrain, keep
        self._mounts = mounts = vertical_mounts(mechanism)
        self._halves = halves_of(table, mechanism)
        # If the roll of the base is not modelled, it relieves a tyre as heave and pitch do.
        self._wheels = mechanism.lateral is None
        response = point or (mechanism.response.point, mechanism.response.direction)
        tyres = [[tyre_place(mount.name) for mount in half.mounts] for half in self._halves]
        self._outputs = [response, response, *outputs, *tyres[0]]
        given = terrain.track is not None or terrain.difference or any(terrain.tracks(mounts))
        self.lacks_track = bool(mounts) and not given
        """Whether nothing says how far apart the wheels of an axle are."""
        self.refusal = _refusal(mounts, terrain)  # why no level is ever known, of `REASONS`, or 0
        if self.refusal:
            return
        tables = [each.source for each in self._halves if isinstance(each.source, Table)]
        # A point in the middle, of which a table of the lateral half knows y, moves along y alone.
        known = {point for point, _ in tables[-1].frf_outputs}
        moved = [x for x in self._outputs if not is_force(x) and x[0] not in known]
        needed = [*self._halves[0].inputs], [*moved, *self._halves[-1].inputs, *tyres[-1]]
        if terrain.band[1] > table.band[1] or not all(
            set(places) <= {*each.frf_outputs} for places, each in zip(needed, tables, strict=False)
        ):
            self.refusal = _FRFS
        elif not set(tyres[0]) <= set(table.forces):
            self.refusal = _STATIC
        else:
            self.lines = max(_count(each, terrain.band) for each in tables)
            self.refusal = _LIGHT if self.lines > _MAX_FREQUENCIES else 0
        if self.refusal:
            return
        low, high = table.alpha3_range
        self._count = round(min(max(_ANGLE_STEPS[0], (high - low) / _DEGREE), _ANGLE_STEPS[1]))
        first, last = stroke_variable(np.array([low, high]), table.toggles).tolist()
        self._ends = first, last
        self._longest = max(m.at[0] for m in mounts) - min(m.at[0] for m in mounts)
        self._origin = np.array([[first], self._column(np.array([FASTEST]))])
        self._steps = np.array([[(last - first) / self._count], [1.0]])

    @cached_property
    def values(self) -> NDArray[np.float32]:
        """What is interpolated, (n_angles, n_speeds, n_rows), computed when it is first needed."""
        return np.asarray(self._keep("ground", self._tabulated)["values"])

    def _tabulated(self) -> Arrays:
        """Compute the `values`."""
        table, terrain, mounts, count = self._table, self._terrain, self._mounts, self._count
        angles = stroke_angle(np.linspace(*self._ends, count + 1), table.toggles)
        angles[[0, -1]] = table.alpha3_range
        speeds, n_rows = self._speeds(), len(self._outputs)
        tyres = self._outputs[n_rows - len(mounts) :]
        felt = [output in tyres for output in self._outputs]
        values = np.zeros((count + 1, n_rows + 1, len(speeds)))
        for half in self._halves:
            parts = self._squares(half, angles)
            every = replace(parts[0], values=np.concatenate([part.values for part in parts]))
            # The acceleration has the largest share of its power at short waves, like forces.
            sharpest = replace(parts[0], values=np.stack([part.values[1] for part in parts]))
            squares, wheels = (
                mean_squares(every, speeds, wheels=each).reshape(count + 1, n_rows, -1)
                for each in (False, self._wheels)
            )
            # A tyre feels all of its own track.
            squares[:, felt] = wheels[:, felt]
            lost = mean_squares(sharpest, speeds, uncovered=True)[:, np.newaxis]
            values += np.concatenate([squares, lost], axis=1)
        values *= speeds ** (1.0 - terrain.exponent)
        which = [table.force_places.index(name) for name, _ in tyres]
        loads = table.reference_forces(angles)[which].T[..., np.newaxis]
        rows = np.concatenate([values, loads.repeat(len(speeds), axis=2)], axis=1)
        return {"values": np.ascontiguousarray(rows.transpose(0, 2, 1), np.float32)}

    def _squares(self, half: Half, angles: FloatArray) -> list[GroundSquares]:
        """Return the coefficients at each angle, of the response and of forces."""
        f, outputs = ground_lines(self._terrain, self.lines), self._outputs
        assert isinstance(half.source, Table)
        known = [i for i, place in enumerate(outputs) if half.knows(place)]
        places, squares = [outputs[i] for i in known], []
        orders = [1, 2, *[0] * (len(outputs) - 2)]
        for frf in half.source.frf_at_each(angles, places, half.inputs):
            transfer = np.zeros((len(outputs), len(half.mounts), len(f)), complex)
            transfer[known] = ground_transfer(frf, half.mounts, f, places)
            of = self._terrain, f, half.difference
            squares.append(ground_squares(transfer, orders, half.mounts, *of))
        return squares

    def _column(self, speeds: FloatArray) -> FloatArray:
        """Return the places of speeds, in steps: even in ln(speed) and, if slow, in the delay."""
        slowness = 1.0 / speeds
        low, high = self._terrain.band
        period = self._longest * high
        coherent = self.lines / (max(period, 1e-9) * math.log(high / low))
        delays = np.minimum(slowness, coherent) * (2.0 * math.pi * period / _PHASE)
        return np.asarray(np.log(slowness) / _STEP + delays)

    def _speeds(self) -> FloatArray:
        """Return the speeds of the table, m/s, descending."""
        fine = np.geomspace(FASTEST, _SLOWEST, 100_001)
        columns = self._column(fine)
        steps = np.arange(columns[0], columns[-1] + 1.0)
        return np.asarray(np.exp(np.interp(steps, columns, np.log(fine))))

    def at(self, alpha3: FloatArray, speed: FloatArray) -> GroundLevels:
        """Return the levels at n angles and speeds, rad and m/s; NaN where they are not known."""
        alpha3, speed = np.atleast_1d(alpha3), np.atleast_1d(speed)
        if 1 not in (len(alpha3), len(speed)) and len(alpha3) != len(speed):
            problem = f"{len(alpha3)} angles do not belong to {len(speed)} speeds"
            raise GroundError(f"{problem}; give one for each, or one for all.")
        alpha3, speed = np.broadcast_arrays(alpha3, speed)
        levels = self.at_table_angles(angles_in_table(alpha3, self._table.alpha3_range), speed)
        return levels.with_share(off_ground_share(levels.loads, levels.tyres2))

    def at_table_angles(self, angles: FloatArray, speed: FloatArray) -> GroundLevels:
        """Return the levels at angles of the table, or NaN, before `GroundLevels.with_share`."""
        speed = speed + 0.0  # -0.0 would be faster than all speeds
        outside, unknown = np.isnan(angles), ~((speed >= 0.0) & (speed <= FASTEST))
        n, m, lost = len(self._outputs), len(self._mounts), outside | unknown
        rows, reason = np.full((n + m, len(angles)), math.nan), np.full(len(angles), self.refusal)
        if not (self.refusal or lost.all()):
            angles = np.where(outside, self._table.alpha3_range[0], angles)
            rows, reason = self._looked_up(angles, np.where(unknown, 1.0, speed))
        if lost.any() and not self.refusal:
            rows[:, lost] = math.nan
            reason = np.where(outside, _ANGLE, np.where(unknown, _SPEED, reason))
        rows[: n - m, reason > 0] = math.nan
        velocity, acceleration = np.sqrt(rows[:2])
        parts = rows[2 : n - m], rows[n - m : n], rows[n:], np.full(len(angles), math.nan)
        return GroundLevels(velocity, acceleration, *parts, reason.astype(np.int8))

    def _looked_up(self, angles: FloatArray, speed: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return mean squares, then loads of the mounts, (n_outputs + n_mounts, n), and reasons."""
        moving = np.minimum(np.maximum(speed, _SLOWEST), FASTEST)
        place = np.stack([stroke_variable(angles, self._table.toggles), self._column(moving)])
        first, weights = _cubic((place - self._origin) / self._steps, self.values.shape[:2])
        around = self._four[first[0] + np.arange(4)[:, np.newaxis], first[1]].astype(float)
        around *= weights[0][..., np.newaxis, np.newaxis]
        around = np.add.reduce(around) * weights[1].T[..., np.newaxis]
        # The order of a sum must not depend on the number of rows, as it does beyond eight terms.
        sums, n = np.add.reduce(around, axis=1).T, len(self._outputs)
        size = speed ** (self._terrain.exponent - 1.0)
        rows = np.concatenate([np.maximum(sums[:n], 0.0) * size, sums[n + 1 :]])
        lost = (sums[n] > MAX_UNKNOWN_POWER * (sums[1] + sums[n])) & (speed > 0.0)
        pitch, finest = self._terrain.lug_pitch, self._terrain.wavenumbers[1]
        lugs = pitch is not None and finest == 0.5 / pitch
        which = np.where(lugs & (speed * finest < self._terrain.band[1]), _LUGS, _PROFILE)
        return rows, np.where(lost, which, 0)

    @cached_property
    def _four(self) -> NDArray[np.float32]:
        """The `values` of four speeds at a time, (n_angles, n_speeds - 3, 4, n_rows)."""
        return sliding_window_view(self.values, 4, axis=1).swapaxes(2, 3)


def _count(table: Table, band: tuple[float, float]) -> int:
    """Return how many frequencies, `N_FREQUENCIES` 2^k, show the sharpest resonance in a band."""
    at = table.natural_frequencies
    ratios = table.damping_ratios[(at >= band[0]) & (at <= band[1])]
    sharpest = max(float(np.fmin.reduce(ratios, initial=1.0)), 1e-9)
    needed = _PER_HALF_WIDTH * math.log(band[1] / band[0]) / sharpest
    return N_FREQUENCIES << max(0, math.ceil(math.log2(needed / N_FREQUENCIES)))


def _cubic(place: FloatArray, counts: tuple[int, ...]) -> tuple[IntArray, FloatArray]:
    """Return the first of 4 neighbours, (n_axes, n), and weights, (n_axes, 4, n), of a cubic."""
    first = np.minimum(np.maximum(np.floor(place) - 1.0, 0.0), np.reshape(counts, (-1, 1)) - 4.0)
    apart = (place - first)[:, np.newaxis] - np.arange(4.0)[:, np.newaxis]
    weights = np.multiply.reduce(apart[:, _OTHERS], axis=2) / _PRODUCTS
    return first.astype(np.int64), weights
