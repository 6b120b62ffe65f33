# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Solves the model at angles of the stroke, each once, and keeps what a table needs."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.description import GROUND
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution
from linkage_vibration.mechanics.modes import Modes
from linkage_vibration.mechanics.response import Peak, PoleResidue, in_reach, pole_residue
from linkage_vibration.table.interpolation import stroke_angle, stroke_variable
from linkage_vibration.table.table import TableError
from linkage_vibration.table.tabulation.peaks import SILENT, heights

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.intp]

_SPARE = 4  # modes beyond those in reach that may turn out to continue a tracked one
_MANY = 8  # points of a mechanism up to which all have FRFs in the table unless told otherwise
_SHORTEST = 1e-7  # of the stroke: 1e-5 deg of 90 deg, which no joint's sensor resolves


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """What the FRFs between the places are made of at one angle.

    Attributes
    ----------
    frf : PoleResidue
        Between all places, with every mode.
    rows : ndarray, (n_places, n_interface)
        What turns shapes into participations.
    complex_shapes : complex ndarray, (n_places, n_modes), or None
        Participations where viscous damping couples the modes.
    """

    frf: PoleResidue
    rows: FloatArray
    complex_shapes: ComplexArray | None


@dataclass(frozen=True, eq=False)
class Sample:
    """The model solved at one angle, as far as a table needs it.

    Attributes
    ----------
    alpha3 : float
        rad.
    modes : Modes
        The lowest elastic ones: those in reach of the band, and some to spare.
    frequencies, ratios : ndarray, (n,)
        Their natural frequencies (Hz) and damping ratios (1).
    peaks : ndarray, (2, n)
        Frequency (Hz) and magnitude (m/N) of the drive-point receptance's maximum beside each of
        them; NaN where there is none.
    edges : ndarray, (2, 2)
        The same at the band's ends.
    drive : PoleResidue
        The drive-point receptance.
    terms : Terms or None
        None where the model has no such terms.
    """

    alpha3: float
    modes: Modes
    frequencies: FloatArray
    ratios: FloatArray
    peaks: FloatArray
    edges: FloatArray
    drive: PoleResidue
    terms: Terms | None

    @cached_property
    def peak(self) -> Peak:
        """The highest of the drive-point receptance in the band, sought when it is asked for."""
        low, high = self.edges[0].tolist()
        return self.drive.peak((low, high))


class Sampler:
    """Solves a model at stroke variables (`interpolation.stroke_variable`).

    Parameters
    ----------
    model, points, solved
        As in `build_table`.

    Attributes
    ----------
    places : tuple of (point, direction)
        Between which the table is to hold FRFs.
    mass : ndarray, (n, n)
        Of the uncoupled components, by which shapes are compared; identified shapes have none.
    ends : tuple of float
        The stroke.
    samples : dict of float to Sample
        What has been solved.
    """

    def __init__(
        self, model: LinkageModel, points: Sequence[str] | None, solved: Callable[[], object]
    ) -> None:
        self.model = model
        self.response = model.mechanism.response
        self._from_frfs = model.measured_frequencies is not None
        self.places = () if self._from_frfs else _places(model, points)
        self.mass = np.eye(len(model.interface)) if self._from_frfs else model.system.mass
        toggles = model.kinematics.toggles
        self.toggles = None if toggles is None else (toggles[0].alpha3, toggles[1].alpha3)
        self.samples: dict[float, Sample] = {}
        self._solved = solved
        first, last = stroke_variable(np.array(model.mechanism.stroke), self.toggles).tolist()
        self.ends: tuple[float, float] = (first, last)
        # The stroke's ends to the last bit, which the variable does not give back.
        self._angles = dict(zip(self.ends, model.mechanism.stroke, strict=True))

    @property
    def length(self) -> float:
        """Of the stroke, in its variable."""
        return self.ends[1] - self.ends[0]

    @property
    def shortest(self) -> float:
        """Steps below this are not tried."""
        return _SHORTEST * self.length

    def angle(self, variable: float) -> float:
        """Angle of a stroke variable, rad."""
        if variable in self._angles:
            return self._angles[variable]
        return float(stroke_angle(np.array([variable]), self.toggles)[0])

    def at(self, variable: float) -> Sample:
        """Return the sample at a stroke variable, solved when it is asked for first.

        Raises
        ------
        TableError
            If the model shows too few modes there, has no damping, or does not respond.
        """
        if variable not in self.samples:
            self.samples[variable] = self._solve(self.angle(variable))
            self._solved()
        return self.samples[variable]

    def _solve(self, alpha3: float) -> Sample:
        if self._from_frfs:
            found = self.model.identify(alpha3)
            every = np.arange(len(found.modes.omega))
            return self._sample(
                alpha3, found.modes, found.damping_ratios, every, found.drive_point, None
            )
        solution = self.model.solve(alpha3)
        elastic = np.flatnonzero(~solution.modes.mechanism)
        terms, own = self._terms(solution), (self.response.point, self.response.direction)
        if terms is not None and own in self.places:
            drive = terms.frf.between(self.places.index(own), self.places.index(own))
        else:
            drive = solution.drive_point
        return self._sample(alpha3, solution.modes, solution.damping_ratios, elastic, drive, terms)

    def _sample(
        self,
        alpha3: float,
        modes: Modes,
        ratios: FloatArray,
        elastic: IntArray,
        drive: PoleResidue,
        terms: Terms | None,
    ) -> Sample:
        band, name = self.response.band, self.model.mechanism.name
        reach = int(in_reach(modes.omega[elastic] ** 2, band).sum())
        some = elastic[: max(self.response.modes, reach) + _SPARE]
        if len(some) < self.response.modes:
            raise TableError(
                f"response.modes asks for {self.response.modes} modes; {name} shows {len(some)} at "
                f"{math.degrees(alpha3):.3f} deg; ask for fewer, keep more modes a link, or widen "
                "response.band_hz where modes are identified from FRFs."
            )
        lost = len(modes.omega) - len(drive.decay)  # mechanism modes have no term there
        peaks = np.array(drive.local_peaks(some - lost, band))
        edges = np.abs(drive.frf(np.array(band))[:, 0, 0])
        edges = np.array([band, np.where(np.isfinite(edges), edges, 0.0)])
        if np.isinf(peaks).any():
            raise TableError(
                f"{name} is undamped, so that its receptance has no highest value; give its links "
                "damping."
            )
        if max(edges[1].max(), heights(peaks[0], peaks[1], band).max()) <= SILENT:
            raise TableError(
                f"{name} does not respond at response.drive_point; choose another point."
            )
        return Sample(
            alpha3,
            modes.select(some, np.ones(len(some))),
            modes.omega[some] / (2.0 * math.pi),
            ratios[some],
            peaks,
            edges,
            drive,
            terms,
        )

    def _terms(self, solution: Solution) -> Terms | None:
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
        return Terms(pole_residue(damped, undamped, undamped), rows, shapes)


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
