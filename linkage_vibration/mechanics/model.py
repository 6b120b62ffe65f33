# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A mechanism ready to be solved at any input angle."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.compatibility import InterfaceMap
from linkage_vibration.mechanics.components import link_component, rigid_component
from linkage_vibration.mechanics.coupling import couple, uncoupled_system
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Configuration, Kinematics
from linkage_vibration.mechanics.modes import Modes, solve_modes
from linkage_vibration.mechanics.response import Peak, PoleResidue

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Solution:
    """The assembly solved in one configuration, every mode of it.

    Attributes
    ----------
    mechanism : Mechanism
        What was solved.
    configuration : Configuration
        Where.
    modes : Modes
        Ascending.
    drive_row : ndarray, (n_interface,)
        Turns interface DoFs into the response asked for, along the global axes.
    """

    mechanism: Mechanism
    configuration: Configuration
    modes: Modes
    drive_row: FloatArray

    @property
    def natural_frequencies(self) -> FloatArray:
        """Natural frequencies, (n_modes,), Hz."""
        return self.modes.omega / (2.0 * math.pi)

    @cached_property
    def drive_point(self) -> PoleResidue:
        """Receptance of the response point to a force there, in the response direction."""
        participation = self.drive_row @ self.modes.shapes[: len(self.drive_row)]
        ratios = damping_ratios(self.mechanism, self.modes.omega)
        return PoleResidue(self.modes.omega, ratios, participation**2)

    @cached_property
    def peak(self) -> Peak:
        """Where the drive-point receptance is largest within the mechanism's band."""
        return self.drive_point.peak(self.mechanism.response.band)


class LinkageModel:
    """Components of a mechanism, made once, to be coupled in any configuration.

    Parameters
    ----------
    mechanism : Mechanism
        What to model.
    reduced : bool
        False keeps every DoF of the links' elements, to check the reduction against.

    Raises
    ------
    MechanismError, ReductionError
        If the linkage cannot close over its stroke, or a link cannot be reduced.
    """

    def __init__(self, mechanism: Mechanism, *, reduced: bool = True) -> None:
        self.mechanism = mechanism
        self.kinematics = Kinematics(mechanism)
        components = [link_component(link, reduced=reduced) for link in mechanism.links]
        components += [rigid_component(body) for body in mechanism.rigid_bodies]
        self.system = uncoupled_system(components)
        self._interface = InterfaceMap(mechanism, components)

    def compatibility(self, configuration: Configuration) -> FloatArray:
        """Return B, (n_constraints, n_interface), of a configuration."""
        return self._interface.compatibility(configuration)

    def solve(self, alpha3: float) -> Solution:
        """Solve the assembly at an input angle in rad.

        Raises
        ------
        KinematicsError
            If the linkage cannot close there.
        """
        configuration = self.kinematics.at(alpha3)
        system = couple(self.system, self.compatibility(configuration))
        response = self.mechanism.response
        body = self.mechanism.owners(response.point)[-1]
        rows = self._interface.displacement(body, response.point, configuration)
        return Solution(
            mechanism=self.mechanism,
            configuration=configuration,
            modes=solve_modes(system),
            drive_row=rows["xz".index(response.direction)],
        )


def damping_ratios(mechanism: Mechanism, omega: FloatArray) -> FloatArray:
    """Modal damping ratios zeta = a / (2 w) + b w / 2 of Rayleigh damping, (n,), 1.

    A mechanism mode (w = 0) has no such ratio: NaN.
    """
    damping = mechanism.damping
    with np.errstate(divide="ignore"):
        ratios = (
            damping.mass_coefficient / (2.0 * omega) + damping.stiffness_coefficient * omega / 2
        )
    return np.where(omega > 0.0, ratios, np.nan)
