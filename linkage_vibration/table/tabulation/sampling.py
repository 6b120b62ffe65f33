# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Solves the model at angles of the stroke, each once, and keeps the values for a table."""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.arrays import FloatArray
from linkage_vibration.mechanics.description import GROUND
from linkage_vibration.mechanics.model import LinkageModel, Place, Solution
from linkage_vibration.mechanics.modes import MECHANISM, ModesError
from linkage_vibration.mechanics.response import in_reach
from linkage_vibration.support.resources import command
from linkage_vibration.table.interpolation import stroke_angle, stroke_variable
from linkage_vibration.table.pole_cells import oscillating, values_of
from linkage_vibration.table.reduced import Numbers
from linkage_vibration.table.table import TableError
from linkage_vibration.table.tabulation.accuracy import COARSEST, LOOSER, Accuracy
from linkage_vibration.table.tabulation.subspaces import PoleSample, sample_identified, sample_poles

_REMEMBERED = 64  # So many solutions of the model are kept.
_MANY = 8  # Up to so many points of a mechanism all have FRFs by default.
_SILENT = float(np.finfo(float).tiny)  # m/N; a response that is not higher is none.
_UNDAMPED = 1e-12  # A damping ratio below it is only rounding.
MOST_SOLUTIONS = 3000  # of a model for one table; the most difficult shipped linkage needs a tenth

_CLEAR = 5.0  # Polynomials meet a tolerance of so many roundings.


@dataclass(frozen=True, slots=True)
class Rounding:
    """Relative errors that rounding causes in a solution."""

    values: float = 0.0  # of natural frequencies and damping ratios
    frf: float = 0.0  # of FRFs, L2 norm over the band


class Sampler:
    """Solves a model at stroke variables, each once; ``seen`` is the first of the outputs alone."""

    def __init__(
        self,
        model: LinkageModel,
        points: Sequence[str] | None,
        progress: Callable[[float], object],
        seen: Place | None = None,
    ) -> None:
        self.model = model
        # The names and the deviations of modes use the same solutions; each takes up to megabytes.
        self.solution = lru_cache(_REMEMBERED)(self._solve)
        self._ready: dict[float, Solution] = {}  # by the angle, rad
        self._powers: dict[float, Numbers] = {}
        self.response = model.mechanism.response
        self.measured = model.measured_frequencies is not None
        self.places, moved = ((), ()) if self.measured else _places(model, points)
        self.outputs = tuple(sorted(moved, key=lambda place: place != seen))
        toggles = model.kinematics.toggles
        self.toggles = None if toggles is None else (toggles[0].alpha3, toggles[1].alpha3)
        self._poles: dict[float, PoleSample] = {}
        self._roundings: dict[float, Rounding] = {}  # by the angle, rad
        self.free_modes = 0  # modes at 0 Hz, which are not sampled
        self._progress, self._unfinished, self._solved = progress, 1.0, 0
        first, last = stroke_variable(np.array(model.mechanism.stroke), self.toggles).tolist()
        self.ends: tuple[float, float] = (first, last)
        # The ends of the stroke to the last bit, which the variable does not return.
        self._angles = dict(zip(self.ends, model.mechanism.stroke, strict=True))

    def _solve(self, alpha3: float) -> Solution:
        return self._ready.pop(alpha3, None) or self.model.solve(alpha3)

    def prepare(self, variables: Sequence[float]) -> None:
        """Solve the model at all of some stroke variables together, which takes less time."""
        angles = [self.angle(x) for x in variables if x not in self._poles]
        if self.measured or not angles:
            return
        with suppress(LinkageVibrationError):  # `at` finds the angle of an error.
            stack = self.model.stack(angles)
            self._ready = dict(zip(angles, stack.rows, strict=True))
            powers = stack.powers([*self.pole_places, *self.rows])
            self._powers = dict(zip(angles, powers, strict=True))

    @cached_property
    def forces(self) -> tuple[Place, ...]:
        """The forces for which the table has FRFs; none of a linkage that moves freely."""
        if self.measured or self.solution(self.angle(self.ends[0])).modes.mechanism.any():
            return ()
        return self.model.forces.places if self.model.force_places else ()

    @property
    def rows(self) -> tuple[Place, ...]:
        """Places and forces that are outputs alone."""
        return (*self.outputs, *self.forces)

    @property
    def pole_places(self) -> tuple[Place, ...]:
        """The places for which reduced models are sampled: that of the highest peak first."""
        drive = (self.response.point, self.response.direction)
        return (drive, *(place for place in self.places if place != drive))

    @property
    def length(self) -> float:
        """Length of the stroke, in its variable."""
        return self.ends[1] - self.ends[0]

    def angle(self, variable: float) -> float:
        """Return the angle of a stroke variable, rad."""
        if variable in self._angles:
            return self._angles[variable]
        return float(stroke_angle(np.array([variable]), self.toggles)[0])

    def at(self, variable: float) -> PoleSample:
        """Return the poles at a stroke variable, which are found once."""
        if variable not in self._poles:
            alpha3 = self.angle(variable)
            sample = self._identified(alpha3) if self.measured else self._solved_at(alpha3)
            self._poles[variable] = sample
            self._check(sample)
            self._progress(1.0 - self._unfinished)
        return self._poles[variable]

    def _identified(self, alpha3: float) -> PoleSample:
        """Return the poles at an angle, rad, by the FRFs of links."""
        self._count(alpha3)
        identified = self.model.identify(alpha3)
        self._check_count(len(identified.identified.poles), alpha3)
        return sample_identified(identified, self.response)

    def _solved_at(self, alpha3: float) -> PoleSample:
        """Return the poles at an angle, rad, by the matrices of links."""
        solution = self._checked_solution(alpha3)
        powers = self._powers.pop(alpha3, None)
        if powers is None:
            powers = solution.powers([*self.pole_places, *self.rows])
        try:
            sample = sample_poles(solution, self._mass_root, powers, len(self.pole_places))
        except ModesError as error:
            raise TableError(f"At alpha3 = {math.degrees(alpha3):.3f} deg: {error}") from None
        self._note_rounding(solution, values_of(oscillating(sample.poles))[1])
        return sample

    def rounding(self, variables: Sequence[float]) -> Rounding:
        """Return the largest errors by rounding at some of the points that are solved."""
        roundings = [self._roundings.get(self.angle(x), Rounding()) for x in variables]
        return Rounding(max(each.values for each in roundings), max(each.frf for each in roundings))

    def check_rounding(self, accuracy: Accuracy) -> None:
        """Refuse an accuracy of which rounding is more than a fifth at a point that is solved."""
        if self._roundings:  # links that are known by FRFs have more noise than rounding
            alpha3, worst = max(self._roundings.items(), key=lambda item: item[1].values)
            worst = worst if self.places else Rounding(worst.values)
            self.refuse_rounding(worst, alpha3, accuracy, 1.0 / _CLEAR)

    def too_short(self, variable: float, reason: str) -> TableError:
        """Return the error that a piece at a stroke variable cannot be halved, and why it must."""
        fix = "give a larger tolerance, use fewer modes in response.modes, or end the stroke before"
        if self.free_modes:
            fix += "; or hold it (nothing does), or begin response.band_hz well above 0 Hz"
        at = f"at alpha3 = {math.degrees(self.angle(variable)):.4f} deg"
        return TableError(f"{self.model.mechanism.name}: {reason} {at}; {fix}.")

    def refuse_rounding(
        self, rounding: Rounding, alpha3: float, accuracy: Accuracy, share: float
    ) -> None:
        """Refuse errors by rounding at an angle (rad) above a share of the accuracy to be met."""
        if rounding.values <= share * accuracy.frequency and rounding.frf <= share * accuracy.frf:
            return
        least = 1.1 * max(rounding.values, rounding.frf / LOOSER) / share
        by = command("build FILE --tolerance")
        larger = f"a tolerance of at least {least:.1e} (by `{by}`), " if least < COARSEST else ""
        raise TableError(
            f"Rounding changes a natural frequency or damping ratio of {self.model.mechanism.name} "
            f"by {rounding.values:.0e} at alpha3 = {math.degrees(alpha3):.3f} deg, too much for "
            f"{accuracy.frequency:g}; give {larger}more damping, a range_deg that ends before it, "
            "a band_hz that ends nearer to the lowest mode, or move apart two points of a link "
            "that nearly coincide."
        )

    def _note_rounding(self, solution: Solution, ratios: FloatArray) -> None:
        """Keep the errors by rounding of a solution, whose elastic modes have damping ratios."""
        omega = solution.modes.omega
        count = max(self.response.modes, int(in_reach(omega**2, self.response.band).sum()))
        lowest = np.flatnonzero(omega >= MECHANISM)[:count]
        relative = solution.rounding(lowest).max(initial=0.0)
        damped = ratios[:count][ratios[:count] > _UNDAMPED]
        # By the derivative of a Lorentzian, as `accuracy.LOOSER` says.
        frf = relative / (math.sqrt(2.0) * damped.min()) if len(damped) else relative
        self._roundings[solution.configuration.alpha3] = Rounding(float(relative), float(frf))

    def _count(self, alpha3: float) -> None:
        """Refuse to solve the model more often than a table may need."""
        if self._solved >= MOST_SOLUTIONS:
            raise TableError(
                f"{self.model.mechanism.name} was solved {MOST_SOLUTIONS} times, and still changes "
                f"too quickly near alpha3 = {math.degrees(alpha3):.4f} deg; give a larger "
                "tolerance, less response.band_hz or response.modes, or end the stroke before it."
            )
        self._solved += 1

    def finish(self, length: float) -> None:
        """Count a part of the stroke, in its variable, as finished; a negative one is reopened."""
        self._unfinished = min(max(self._unfinished - length / self.length, 0.0), 1.0)

    @property
    def solved(self) -> list[float]:
        """Stroke variables at which the model is solved."""
        return list(self._poles)

    @cached_property
    def _mass_root(self) -> FloatArray:
        """R with R^T R = M, the mass of the uncoupled components, (n, n)."""
        values, vectors = np.linalg.eigh(self.model.system.mass)
        return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, np.newaxis] * vectors.T)

    def _checked_solution(self, alpha3: float) -> Solution:
        """Solve the model at an angle, rad, and count its modes at 0 Hz."""
        self._count(alpha3)
        solution = self.solution(alpha3)
        elastic = solution.modes.omega[~solution.modes.mechanism]
        self.free_modes = max(self.free_modes, len(solution.modes.omega) - len(elastic))
        self._check_count(len(elastic), alpha3)
        low, highest = self.response.band[0], float(elastic.max()) / (2.0 * math.pi)
        if highest < low:
            raise TableError(
                f"response.band_hz begins at {low:g} Hz, above all {len(elastic)} modes of "
                f"{self.model.mechanism.name} (the highest is at {highest:.4g} Hz); give a lower "
                "band, or keep more modes in each link."
            )
        return solution

    def _check_count(self, count: int, alpha3: float) -> None:
        """Refuse fewer modes at an angle, rad, than a table is to have."""
        if count < self.response.modes:
            raise TableError(
                f"response.modes is {self.response.modes}, but {self.model.mechanism.name} has "
                f"{count} modes at {math.degrees(alpha3):.3f} deg; use fewer, keep more modes in "
                "each link, or widen response.band_hz if modes are identified from FRFs."
            )

    def _check(self, sample: PoleSample) -> None:
        """Refuse a linkage with an undamped mode in the band, or one that does not respond."""
        poles, name = sample.poles[sample.poles.imag > MECHANISM], self.model.mechanism.name
        poles = poles[np.abs(poles) < 2.0 * math.pi * self.response.band[1]]
        if (-poles.real <= _UNDAMPED * np.abs(poles)).any():
            problem = f"{name} has an undamped mode, so its receptance has no highest value"
            raise TableError(f"{problem}; give its links damping.")
        if np.abs(sample.totals[:, 0]).max() <= _SILENT:
            problem = f"{name} does not respond at response.drive_point"
            raise TableError(f"{problem}; choose another point.")


def _places(
    model: LinkageModel, points: Sequence[str] | None
) -> tuple[tuple[Place, ...], tuple[Place, ...]]:
    """Return the places between which the table has FRFs, and others that are outputs alone."""
    mechanism = model.mechanism
    mounts = () if mechanism.base is None else mechanism.base.mounts
    if points is None:
        moving = {p for body in mechanism.bodies for p in mechanism.local_points(body.name)}
        held = set(mechanism.local_points(GROUND)).difference(mount.name for mount in mounts)
        names = sorted((moving | {mount.name for mount in mounts}).difference(held))
        points = names if len(names) <= _MANY else [mechanism.response.point]
    for point in points:
        if not mechanism.owners(point):
            raise TableError(f"{mechanism.name} has no point {point} for FRFs; check the name.")
        if mechanism.base is None and point in mechanism.local_points(GROUND):
            problem = f"{point} is a point of the ground, which does not move"
            raise TableError(f"{mechanism.name}: {problem}; leave it out of the points for FRFs.")
    directions = model.interface.directions
    every = [(point, direction) for point in points for direction in directions]
    if model.half == "vertical":
        return tuple(every), ()
    # What is in the middle moves along y alone.
    moves = model.rows(every, model.kinematics.at(mechanism.stroke[0]))
    every = [every[i] for i in np.flatnonzero(moves.any(axis=1)).tolist()]
    drive = mechanism.response.point, mechanism.response.direction
    loaded = {drive, *((mount.name, "z") for mount in mounts)}
    places = [place for place in every if place[1] == "y" or place in loaded]
    return tuple(places), tuple(place for place in every if place not in places)
