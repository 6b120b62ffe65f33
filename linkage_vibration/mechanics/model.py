# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A mechanism ready to be solved at any input angle."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError, check_type
from linkage_vibration.mechanics.arrays import (
    BoolArray,
    ComplexArray,
    FloatArray,
    IntArray,
    Reals,
    real_numbers,
    rows_of,
    side_by_side,
)
from linkage_vibration.mechanics.assembly_poles import Assembly
from linkage_vibration.mechanics.compatibility import InterfaceMap, Joining
from linkage_vibration.mechanics.components import Component, FrfComponent
from linkage_vibration.mechanics.coupling import (
    CoupledSystem,
    UncoupledSystem,
    assembled_frf,
    couple,
    uncoupled_system,
)
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.fbs import couple_frfs, couple_frfs_with_error, held_frf
from linkage_vibration.mechanics.forces import Forces, is_force, magnitudes, reference, tyre_place
from linkage_vibration.mechanics.frf import Frf
from linkage_vibration.mechanics.identification import IdentifiedModes, identify
from linkage_vibration.mechanics.kinematics import Configuration, Kinematics, kinematics_of
from linkage_vibration.mechanics.lateral import LateralForces, LateralMap, lateral_components
from linkage_vibration.mechanics.modes import MECHANISM, DampedModes, Modes, damp_modes, solve_modes
from linkage_vibration.mechanics.regularisation import Blocks, MeasuredFrfs, noise_gain, receptances
from linkage_vibration.mechanics.response import (
    Peak,
    PoleResidue,
    far_poles,
    in_reach,
    oscillators,
    pole_residue,
)
from linkage_vibration.support.conversions import import_xarray

_STILL = 1e-6  # A DoF is held if it moves by less than this share of the largest response.
_NOISE = 0.5  # Coupled FRFs with a larger share of noise, root mean square over lines, are refused.
_ROUNDING = 1e-9  # Lines with a larger error, of the largest response, are solved again.

Place = tuple[str, str]
"""A point and a direction along the global axes, ("E1", "z"), or a force (see `forces`)."""

Places = Sequence[Place | str]
"""Where places are arguments, "E1.z" names ("E1", "z")."""


class ModelError(LinkageVibrationError):
    """The model cannot answer the request."""


def pairs(places: Places) -> list[Place]:
    """Return places as pairs, of which some may be written like "E1.z"."""
    split = [p.rpartition(".")[::2] if isinstance(p, str) else tuple(p) for p in places]
    for place, pair in zip(places, split, strict=True):
        if len(pair) != 2 or not pair[0]:
            hint = 'give a list of places, such as ["E1.z"] or [("E1", "z")]'
            raise ModelError(f"{place!r} is not a place; {hint}.")
    return [(point, direction) for point, direction in split]


def excite_lateral(outputs: Sequence[Place], inputs: Sequence[Place]) -> bool:
    """Return whether inputs excite the lateral half, as those along y do; refuse both kinds."""
    across = {direction == "y" for _, direction in inputs}
    if len(across) > 1:
        problem = "Inputs along y excite the lateral half, and others the vertical one"
        raise ModelError(f"{problem}; give one kind at a time.")
    if True not in across and any(direction == "y" for _, direction in outputs):
        problem = "Inputs along x and z act alike on both sides, so nothing moves along y"
        raise ModelError(f"{problem}; give inputs along y, or other outputs.")
    return True in across


class LinkageModel:
    """The components of a mechanism, computed once, to be coupled in any configuration.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism to model.
    reduced : bool
        False keeps every DoF of the links, to check the reduction against.
    kinematics : Kinematics, optional
        Kinematics of a mechanism with the same points, pins and stroke, to be used again.
    half : {"vertical", "lateral"}
        The motions in the plane, or those odd about the middle: sway, roll and yaw. The lateral
        half needs the key `lateral`, whose `response` is that of its `mechanism`.
    vertical : LinkageModel, optional
        The vertical half of the same mechanism, whose kinematics and forces are used again.

    Raises
    ------
    MechanismError, ReductionError
        If the linkage cannot close over its stroke, or a link cannot be reduced.
    ModelError
        If the lateral half is not described, or `half` is neither.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        *,
        reduced: bool = True,
        kinematics: Kinematics | None = None,
        half: Literal["vertical", "lateral"] = "vertical",
        vertical: "LinkageModel | None" = None,
    ) -> None:
        check_type(mechanism, "read the file with `read_mechanism`", Mechanism)
        if half not in ("vertical", "lateral"):
            raise ModelError(f"half is {half!r}; give `vertical` or `lateral`.")
        self.mechanism, self.half = mechanism, half
        if vertical is not None:
            kinematics = vertical.kinematics
        self.kinematics: Kinematics = kinematics or kinematics_of(mechanism)
        self.components: tuple[Component | FrfComponent, ...]
        if half == "vertical":
            self.components = mechanism.components(reduced=reduced)
            self.interface = InterfaceMap(mechanism, self.components)
        else:
            if mechanism.lateral is None:
                raise ModelError(f"{mechanism.name} has no lateral half; describe it by `lateral`.")
            self.mechanism = replace(mechanism, response=mechanism.lateral.response)
            self.components = lateral_components(mechanism, reduced=reduced)
            plane = vertical.forces if vertical and mechanism.lateral.weight else None
            middle = self.kinematics.at(sum(mechanism.stroke) / 2.0)
            self.interface = LateralMap(mechanism, self.components, middle, plane)
        self._measured = [c for c in self.components if isinstance(c, FrfComponent)]
        # The frequencies at which FRFs of the components were computed last, and these FRFs.
        self._frfs: tuple[bytes | None, list[ComplexArray | MeasuredFrfs]] = None, []

    def __repr__(self) -> str:
        """Return the mechanism, in a line."""
        return f"LinkageModel({self.mechanism})"

    @cached_property
    def halves(self) -> "tuple[LinkageModel, ...]":
        """The model of the vertical half, and that of the lateral one if it is described."""
        if self.half == "lateral" or self.mechanism.lateral is None:
            return (self,)
        return self, LinkageModel(self.mechanism, half="lateral", vertical=self)

    @cached_property
    def system(self) -> UncoupledSystem:
        """The components side by side.

        Raises
        ------
        ModelError
            If a component has no matrices.
        """
        for component in self._measured:
            hint = "use `coupled_frf`, or `identify` the modes from FRFs"
            raise ModelError(f"links.{component.name} is known by its FRFs alone; {hint}.")
        return uncoupled_system([c for c in self.components if isinstance(c, Component)])

    def rows(self, places: Places, configuration: Configuration) -> FloatArray:
        """Return the displacements at places per interface DoF, (..., n_places, n_interface).

        Parameters
        ----------
        places, configuration
            Points and directions along the global axes; where the bodies are.

        Raises
        ------
        ModelError
            If a point or a direction does not exist, or if a place is one of a force, as a force
            inside the linkage does not excite it.
        """
        rows, moved = [], dict[str, FloatArray]()
        for point, direction in pairs(places):
            if is_force((point, direction)):
                problem = f"The {direction} at {point} is an output of FRFs of matrices, no input"
                raise ModelError(f"{problem}; give a point with a direction.")
            bodies = self.mechanism.owners(point)
            if not bodies:
                raise ModelError(f"There is no point {point}; check the names of the points.")
            directions = self.interface.directions
            if direction not in directions:
                hint = f"use {' or '.join(directions)}, as this is the {self.half} half"
                raise ModelError(f"Point {point} has no direction {direction}; {hint}.")
            if point not in moved:
                moved[point] = self.interface.displacement(bodies[-1], point, configuration)
            rows.append(moved[point][..., directions.index(direction), :])
        return side_by_side(rows, (*configuration.angles.shape[:-1], len(self.interface)), -2)

    @cached_property
    def forces(self) -> Forces:
        """The forces in the linkage.

        Raises
        ------
        ModelError
            If a link is known by its FRFs.
        """
        if isinstance(self.interface, LateralMap):
            return LateralForces(self.mechanism, self.system, self.interface)
        return Forces(self.mechanism, self.system, self.interface)

    @property
    def force_places(self) -> tuple[str, ...]:
        """Pins, springs, cylinders and tyres whose forces are known, such as "lower_link:E1".

        There are none if a link is known by its FRFs.
        """
        return () if self._measured else self.forces.names

    def static_forces(self, alpha3: float) -> FloatArray:
        """Return the forces at `force_places` under the weight, (n_force_places,), N.

        They are magnitudes; NaN where nothing carries the weight. Gravity points along -z with
        9.80665 m/s2.

        Parameters
        ----------
        alpha3 : float
            Input angle, rad.
        """
        return magnitudes(self.forces.places, self._at_rest(alpha3))

    def _at_rest(self, alpha3: float) -> FloatArray:
        """Return static forces at `Forces.places`, (n_places,), N."""
        configuration = self.kinematics.at(alpha3)
        return self.forces.at_rest(configuration, self.interface.join(configuration))

    def mount_loads(self, alpha3: float) -> FloatArray:
        """Return the vertical load of each mount of the base under all weight, (n_mounts,), N.

        It is NaN where nothing carries the weight, and negative where a mount would have to pull.
        """
        mounts = () if self.mechanism.base is None else self.mechanism.base.mounts
        at = dict(zip(self.forces.places, self._at_rest(alpha3).tolist(), strict=True))
        return np.array([-at.get(tyre_place(mount.name), 0.0) for mount in mounts])

    def reference_forces(self, alpha3: float) -> FloatArray:
        """Return what dynamic forces at `force_places` are compared with, (n_force_places,), N.

        It is the static force, but at least a tenth of the largest at this angle, as a pin that
        carries nearly nothing has no meaningful ratio. `response.reference_force` replaces all
        of them, or those of the places that it names. Of a tyre that would have to pull, it is
        negative.

        Parameters
        ----------
        alpha3 : float
            Input angle, rad.
        """
        given = self.mechanism.response.reference_force
        return reference(self.forces.places, self._at_rest(alpha3), given)

    def output_rows(
        self, places: Places, configuration: Configuration, joining: Joining | None = None
    ) -> NDArray[Any]:
        """Return displacements or forces at places per coordinate of the components.

        They are (3, n_places, n): constants, and factors of s = i w and of s^2, which displacements
        lack; complex if links have structural damping.

        Parameters
        ----------
        places, configuration
            Points with directions, or forces; where the bodies are.
        joining : Joining, optional
            What joins the components there, if it is known.
        """
        places = pairs(places)
        joining = joining or self.interface.join(configuration)
        loaded = [place for place in places if is_force(place)]
        forces = self.forces.rows(loaded, configuration, joining)
        of_force = np.array([is_force(place) for place in places], dtype=np.bool_)
        rows = np.zeros((*forces.shape[:-2], len(places), forces.shape[-1]), forces.dtype)
        rows[..., of_force, :] = forces
        moved = self.rows([place for place in places if not is_force(place)], configuration)
        rows[..., 0, ~of_force, : len(self.interface)] = moved
        return rows

    def solve(self, alpha3: float) -> "Solution":
        """Solve the assembly at an input angle in rad.

        Raises
        ------
        KinematicsError
            If the linkage cannot close there.
        CouplingError, ModelError
            If it cannot be assembled.
        """
        return self._solved(self.kinematics.at(alpha3))

    def stack(self, angles: Reals) -> "Solution":
        """Solve the assembly at input angles, (k,), rad, as one solution with an axis before.

        `Solution.rows` returns those at each angle. The errors are those of `solve`.
        """
        return self._solved(self.kinematics.stack(angles))

    def _solved(self, configuration: Configuration) -> "Solution":
        joining = self.interface.join(configuration)
        coupled = couple(self.system, joining)
        if joining.weight is not None:
            try:
                np.linalg.cholesky(coupled.stiffness + MECHANISM**2 * coupled.mass)
            except np.linalg.LinAlgError:
                name, angle = self.mechanism.name, math.degrees(np.ravel(configuration.alpha3)[0])
                problem = f"At {angle:.4g} deg {name} topples sideways under its weight; check "
                problem += "masses, y of points, chains, and the track, stiffness and contact of "
                hint = "axles, or write `weight: ignored` under `lateral`"
                raise ModelError(f"{problem}{hint}.") from None
        modes, vectors = solve_modes(coupled)
        return Solution(self, configuration, joining, coupled, modes, vectors)

    def coupled_frf(
        self, alpha3: float, frequencies: Reals, outputs: Places, inputs: Places
    ) -> Frf:
        """Couple the components by their FRFs (LM-FBS), whether they have matrices or FRFs.

        Parameters
        ----------
        alpha3 : float
            Input angle, rad.
        frequencies : ndarray, (n_freq,)
            Hz; where a component is known by FRFs, above 0 and among its frequencies. Where all
            have matrices, the assembly is solved at lines where LM-FBS loses digits: at and near
            0 Hz, and at an undamped resonance of a component; and wherever the weight stiffens it.
        outputs, inputs : sequence of (point, direction)
            Along the global axes; "E1.z" is ("E1", "z").

        Raises
        ------
        CouplingError
            If the receptance is infinite: an undamped resonance, a mechanism at 0 Hz.
        FbsError
            If the FRFs have too few digits for the result.
        """
        configuration = self.kinematics.at(alpha3)
        lines = real_numbers(frequencies, "frequencies")
        joining = self.interface.join(configuration)
        places = tuple(pairs(outputs)), tuple(pairs(inputs))
        left, right = (self.rows(each, configuration) for each in places)
        if self._measured:
            blocks, rows, compliance = self._blocks(joining, lines)
            self._check_noise(blocks, rows, right, compliance)
            frf = couple_frfs(receptances(blocks), rows, left, right, compliance, lines)
            gain = noise_gain(blocks, rows, left, right, compliance)
            with np.errstate(invalid="ignore"):  # of a place that does not move
                share = _size(gain * frf) / _size(frf)
            return Frf(lines, *places, frf, share * max(c.noise for c in self._measured))
        frf = np.empty((len(lines), len(left), len(right)), dtype=complex)
        # Forces at rest change the components with the angle, so they have no FRFs of their own.
        moving = (lines != 0.0) & (joining.weight is None)
        blocks, rows, compliance = self._blocks(joining, lines[moving])
        parts = receptances(blocks)
        frf[moving], error = couple_frfs_with_error(parts, rows, left, right, compliance)
        poor = ~moving
        poor[moving] = ~(error <= _ROUNDING * np.abs(frf[moving]).max(axis=(1, 2), initial=0.0))
        if poor.any():
            frf[poor] = assembled_frf(couple(self.system, joining), lines[poor], left, right)
        return Frf(lines, *places, frf, np.zeros(len(left)))

    @cached_property
    def measured_frequencies(self) -> FloatArray | None:
        """Frequencies (Hz, above 0) at which links are known by FRFs; None without such links.

        Raises
        ------
        ModelError
            If two such links do not share them.
        """
        if not self._measured:
            return None
        first, *others = self._measured
        for component in others:
            if not np.array_equal(component.frequencies, first.frequencies):
                both = f"links.{component.name} and links.{first.name}"
                hint = "measure or resample them on one axis"
                raise ModelError(f"{both} are known at different frequencies; {hint}.")
        return first.frequencies

    def identify(self, alpha3: float) -> "IdentifiedSolution":
        """Identify the modes in the response band from coupled FRFs.

        It needs no matrices: it replaces `solve` for links that are known by FRFs.

        Raises
        ------
        KinematicsError
            If the linkage cannot close there.
        IdentificationError
            If the FRFs do not show modes.
        ModelError
            If no link is known by FRFs.
        """
        frequencies = self.measured_frequencies
        if frequencies is None:
            raise ModelError("No link is known by FRFs; solve the assembly instead.")
        configuration = self.kinematics.at(alpha3)
        response = self.mechanism.response
        drive = self.rows([(response.point, response.direction)], configuration)
        every = np.vstack([drive, np.eye(len(self.interface))])
        joining = self.interface.join(configuration)
        blocks, rows, compliance = self._blocks(joining, frequencies)
        self._check_noise(blocks, rows, drive, compliance)
        blocks = [
            c.measured.fit.smooth() if isinstance(c, FrfComponent) else block
            for c, block in zip(self.components, blocks, strict=True)
        ]
        frf = couple_frfs(receptances(blocks), rows, every, drive, compliance, frequencies)
        # DoFs that the ground holds move by rounding alone, which is not a shape.
        size = np.linalg.norm(frf[:, :, 0], axis=0)
        moving = size > _STILL * size.max()
        assembly = Assembly(self.components, self._held, joining)
        identified = identify(frequencies, frf[:, moving], response.band, confirm=assembly.confirm)
        shapes = np.zeros((len(every), len(identified.poles)))
        shapes[moving] = identified.shapes
        poles, *stddev = map(np.array, zip(*assembly.modes, strict=True))
        place = response.point, response.direction
        return IdentifiedSolution(configuration, place, IdentifiedModes(poles, shapes), *stddev)

    def _check_noise(
        self, blocks: Blocks, rows: FloatArray, inputs: FloatArray, compliance: ComplexArray
    ) -> None:
        """Refuse measured FRFs whose noise dominates the coupled ones where the forces act."""
        link = max(self._measured, key=lambda c: c.noise)
        gain = noise_gain(blocks, rows, inputs, inputs, compliance)
        frf = couple_frfs_with_error(receptances(blocks), rows, inputs, inputs, compliance)[0]
        share = link.noise * float(np.linalg.norm(gain * frf) / np.linalg.norm(frf))
        if not share <= _NOISE:
            noise = f"Noise of {100.0 * link.noise:.2g} % in the FRFs of links.{link.name}"
            hint = "average more measurements, or measure up to higher frequencies"
            raise ModelError(f"{noise} becomes {100.0 * share:.0f} % in the coupled ones; {hint}.")

    def _blocks(
        self, joining: Joining, frequencies: FloatArray
    ) -> tuple[list[ComplexArray | MeasuredFrfs], FloatArray, ComplexArray]:
        """Return FRFs of the components, the rows that join them, and the rows' compliance."""
        omega = 2.0 * math.pi * frequencies[:, np.newaxis]
        springs = 1.0 / (joining.stiffness + 1j * omega * joining.damping)
        # Components are computed with those DoFs held that the ground holds at every angle.
        compatibility = joining.compatibility[joining.compatibility[:, ~self._held].any(axis=1)]
        rows = np.vstack([compatibility, joining.elongation])
        compliance = np.hstack([np.zeros((len(omega), len(compatibility))), springs])
        return self._component_frfs(frequencies), rows, compliance

    @cached_property
    def _held(self) -> BoolArray:
        """Interface DoFs, (n,), that the ground holds, of components that have matrices."""
        has_matrices = [np.full(len(c.dofs), isinstance(c, Component)) for c in self.components]
        return np.asarray(self.interface.held & np.concatenate(has_matrices))

    def _component_frfs(self, frequencies: FloatArray) -> list[ComplexArray | MeasuredFrfs]:
        """Return the FRFs of all components on their interface DoFs; the last ones are kept."""
        if self._frfs[0] != frequencies.tobytes():
            ends = np.cumsum([len(component.dofs) for component in self.components])
            parts = zip(self.components, np.split(self._held, ends[:-1]), strict=True)
            frfs = [_component_frf(component, frequencies, held) for component, held in parts]
            self._frfs = frequencies.tobytes(), frfs
        return self._frfs[1]


@dataclass(frozen=True, eq=False)
class IdentifiedSolution:
    """The modes identified from coupled FRFs in one configuration.

    Attributes
    ----------
    configuration : Configuration
        Where the bodies are.
    response : (point, direction)
        The response point.
    identified : IdentifiedModes
        Modes in the response band, ascending; the rows of their shapes are the response, then all
        interface DoFs in their components' own axes.
    frequency_stddev, damping_ratio_stddev : ndarray, (n_modes,)
        Standard deviations by the noise of the measured FRFs, Hz and 1.
    """

    configuration: Configuration
    response: Place
    identified: IdentifiedModes
    frequency_stddev: FloatArray
    damping_ratio_stddev: FloatArray

    @property
    def natural_frequencies(self) -> FloatArray:
        """Undamped natural frequencies, (n_modes,), Hz."""
        return self.identified.omega / (2.0 * math.pi)

    @property
    def damping_ratios(self) -> FloatArray:
        """Modal damping ratios, (n_modes,), 1."""
        return self.identified.damping_ratios

    @property
    def modes(self) -> Modes:
        """The modes with shapes of unit length on the interface DoFs, for tracking."""
        shapes = self.identified.shapes[1:]
        return Modes(self.identified.omega, shapes / np.linalg.norm(shapes, axis=0))

    @property
    def drive_point(self) -> PoleResidue:
        """Receptance of the response point, of the identified modes."""
        modes = self.identified
        frf = oscillators(modes.omega, modes.damping_ratios, modes.shapes[0] ** 2)
        return replace(frf, outputs=(self.response,), inputs=(self.response,))

    def peak(self, band: tuple[float, float]) -> Peak:
        """Return the peak of the receptance of the identified modes within a band (Hz)."""
        return self.drive_point.peak(band)


@dataclass(frozen=True, eq=False)
class Solution:
    """The assembly solved in one configuration, every mode of it.

    Attributes
    ----------
    model : LinkageModel
        The model that was solved.
    configuration : Configuration
        Where the bodies are.
    joining : Joining
        What joins the components there.
    coupled : CoupledSystem
        The assembled matrices.
    modes : Modes
        Undamped, ascending.
    vectors : ndarray, (m, m)
        Their shapes on the generalised coordinates.
    """

    model: LinkageModel
    configuration: Configuration
    joining: Joining
    coupled: CoupledSystem
    modes: Modes
    vectors: FloatArray

    def __repr__(self) -> str:
        """Return the mechanism and the angle, in a line."""
        angle = math.degrees(self.configuration.alpha3)
        return f"Solution({self.model.mechanism.name} at {angle:g} deg)"

    @property
    def rows(self) -> list["Solution"]:
        """The solutions at the angles of a stack, in their order."""
        stacks = self.configuration, self.joining, self.coupled, self.modes
        parts = zip(*map(rows_of, stacks), self.vectors, strict=True)
        return [Solution(self.model, *part) for part in parts]

    @cached_property
    def natural_frequencies(self) -> FloatArray:
        """Natural frequencies, Hz, ascending: one for each of the `modes`, 0 Hz for a mechanism.

        They are abs(lambda) / 2 pi of poles, as in a table. Where damping couples the modes, these
        are the oscillating ones: an overdamped mode and a mechanism mode have none.
        """
        if self.damped.shapes is None:
            return np.asarray(np.sqrt(np.abs(self.damped.stiffness)) / (2.0 * math.pi))
        return np.abs(self.damped.oscillating) / (2.0 * math.pi)

    def rounding(self, modes: IntArray) -> FloatArray:
        """Return by how much rounding changes frequencies and modal damping, relative, (k,).

        A number of magnitude a is known within eps a, so phi^T K phi is known within
        eps abs(phi)^T abs(K) abs(phi), which is much more where parts of it cancel.

        Parameters
        ----------
        modes : ndarray of int, (k,)
            Which of the undamped modes; not those of a mechanism.
        """
        shapes, squared = self.vectors[:, modes], self.modes.omega[modes] ** 2
        size, coupled = np.abs(shapes), self.coupled

        def added(matrix: FloatArray) -> FloatArray:
            return np.asarray((size * (np.abs(matrix) @ size)).sum(axis=0))

        decay = np.abs((shapes * (coupled.damping @ shapes)).sum(axis=0))
        damping = added(coupled.damping)
        damping = np.divide(damping, decay, out=np.zeros(len(modes)), where=decay > 0.0)
        frequency = (added(coupled.stiffness) / squared + added(coupled.mass)) / 2.0
        return np.asarray(np.finfo(float).eps * np.maximum(frequency, damping))

    @cached_property
    def damped(self) -> DampedModes:
        """The damped modes."""
        return damp_modes(self.coupled, self.modes.omega, self.vectors)

    @property
    def damping_ratios(self) -> FloatArray:
        """Damping ratios that belong to `natural_frequencies`, 1; NaN at 0 Hz."""
        return self.damped.damping_ratios

    def mode_shapes(self, places: Places) -> FloatArray:
        """Displacement of the shape of each of the `natural_frequencies`, (n_places, n).

        Where damping couples the modes, it is the real part of the complex shape.
        """
        shapes = self.participation(places)
        return shapes if self.damped.shapes is None else shapes @ self.damped.real_shapes

    def participation(self, places: Places) -> FloatArray:
        """Displacement or force of each undamped, mass-normalised shape, (n_places, n_modes)."""
        constant, _, inertia = np.moveaxis(self.powers(places).real, -3, 0)
        return np.asarray(constant - self.modes.omega[..., np.newaxis, :] ** 2 * inertia)

    def powers(self, places: Places) -> NDArray[Any]:
        """Return what undamped shapes cause at places, (3, n_places, n_modes).

        It is constant, and factors of s = i w and of s^2, as `LinkageModel.output_rows` has them.
        """
        rows = self.model.output_rows(places, self.configuration, self.joining)
        return np.asarray(rows @ self.modes.shapes[..., np.newaxis, :, :])

    def frf(
        self, outputs: Places, inputs: Places, band: tuple[float, float] | None = None
    ) -> PoleResidue:
        """Receptances between points, or forces at places per force at points.

        Parameters
        ----------
        outputs, inputs : sequence of (point, direction)
            Along the global axes; "E1.z" is ("E1", "z"). An output may also be a force, such as
            "lower_link:E1.force_x" or "lift_cylinders.force".
        band : tuple of float, optional
            Hz. With a band, `FarPoles` replace the modes above it, which is faster for many lines
            and valid within the band only; without, the sum has every mode.
        """
        outputs, inputs = pairs(outputs), pairs(inputs)
        rows = self.model.rows(inputs, self.configuration)  # refuses forces
        into = rows @ self.modes.shapes[: rows.shape[1]]
        frf, error = pole_residue(self.damped, self.powers(outputs), into), 0.0
        if band is not None:
            real_numbers(band, "band")
            kept, error = in_reach(frf.stiffness, band, frf.decay), math.nan
            frf = frf.condensed(kept, far_poles(frf.stiffness[~kept], frf.decay[~kept], band))
        return replace(frf, outputs=tuple(outputs), inputs=tuple(inputs), error=np.array([error]))

    @cached_property
    def drive_point(self) -> PoleResidue:
        """Receptance of the response point to a force there, in the response direction."""
        response = self.model.mechanism.response
        place = [(response.point, response.direction)]
        return self.frf(place, place)

    def peak(self, band: tuple[float, float]) -> Peak:
        """Return the peak of the drive-point receptance within a band (Hz)."""
        return self.drive_point.peak(band)

    def shape(self, mode: int) -> "ModeShape":
        """Return an undamped mode, counted from 0, whose shape `linkage_vibration.plot` draws.

        Raises
        ------
        ModelError
            If there is no such mode, or the solution is a stack.
        """
        check_type(mode, "count the modes from 0", int, np.integer)
        if self.vectors.ndim == 3:
            raise ModelError("A stack of solutions has no single shape; take one of its `rows`.")
        if not 0 <= mode < len(self.modes.omega):
            valid = f"0 to {len(self.modes.omega) - 1}"
            raise ModelError(f"The solution has no mode {mode}; count from 0, {valid}.")
        return ModeShape(self, int(mode))

    def to_xarray(self) -> Any:
        """Return frequencies, damping ratios and mode shapes over mode as an `xarray.Dataset`.

        ``shapes`` are those of `mode_shapes` at all points, 1/sqrt(kg), with arbitrary signs;
        ``mode`` is counted from 1. A stack has the dimension ``alpha3``. It needs the extra
        `xarray`.

        Raises
        ------
        LinkageVibrationError
            If xarray is not installed.
        """
        xarray = import_xarray()
        if self.vectors.ndim == 3:
            return xarray.concat([each.to_xarray() for each in self.rows], "alpha3")
        points, directions = self.model.mechanism.moving_points, self.model.interface.directions
        places = [f"{point}.{direction}" for point in points for direction in directions]
        columns = {
            "natural_frequencies": ("mode", self.natural_frequencies, {"units": "Hz"}),
            "damping_ratios": ("mode", self.damping_ratios, {"units": "1"}),
            "shapes": (("place", "mode"), self.mode_shapes(places), {"units": "1/sqrt(kg)"}),
        }
        modes = np.arange(1, 1 + len(self.natural_frequencies))
        alpha3 = self.configuration.alpha3
        return xarray.Dataset(columns, {"alpha3": alpha3, "mode": modes, "place": places})


@dataclass(frozen=True, slots=True, eq=False)
class ModeShape:
    """The shape of an undamped mode of a solution.

    Attributes
    ----------
    solution : Solution
        The linkage at an angle.
    mode : int
        The index of the mode, counted from 0.
    """

    solution: Solution
    mode: int


def _size(frf: NDArray[Any]) -> FloatArray:
    """Return the norms of FRFs, (n_freq, n_out, n_in), over lines and inputs, (n_out,)."""
    return np.asarray(np.linalg.norm(frf, axis=(0, 2)))


def _component_frf(
    component: Component | FrfComponent, frequencies: FloatArray, held: BoolArray
) -> ComplexArray | MeasuredFrfs:
    """Return the FRFs of a component; DoFs that are held, (n_dofs,), do not respond."""
    if isinstance(component, Component):
        return held_frf(component, frequencies, held)
    at = np.abs(np.subtract.outer(component.frequencies, frequencies)).argmin(axis=0)
    off = np.abs(component.frequencies[at] - frequencies)
    if (off > 1e-9 * frequencies).any():
        worst = float(frequencies[int(off.argmax())])
        available = f"its own ({component.frequencies[0]:g} to {component.frequencies[-1]:g} Hz)"
        raise ModelError(f"links.{component.name} has no FRF at {worst:g} Hz; use {available}.")
    measured = component.measured
    return MeasuredFrfs(measured.frf[at], measured.kept, measured.leverage[at])
