# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The linkage that all methods solve, and the reference for their errors."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.mechanics.bodies.beam import Beam
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.kinematics import Configuration, Kinematics
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import pole_residue
from linkage_vibration.readers.mechanism import read_mechanism

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

MECHANISM = Path(__file__).parents[2] / "config" / "three_point_linkage.yaml"
LINES: FloatArray = np.linspace(0.0, 200.0, 2001)  # Hz, the paper's
SWEEP: FloatArray = np.radians(np.linspace(90.0, 180.0, 46))  # the paper's configurations
MODES = 3
FINE = 96  # elements per link of the reference
Rows = Callable[[LinkageModel, Configuration], tuple[FloatArray, FloatArray]]
"""Rows on the interface DoFs of responses, (n_out, n), and of the force, (1, n)."""
RESPONSES = tuple((point, direction) for point in ("V1", "V2", "E1", "E2") for direction in "xz")
FORCE = ("E1", "z")


def changed(
    mechanism: Mechanism, *, elements: int | None = None, modes: int | None = None
) -> Mechanism:
    """Return the mechanism with another number of elements or fixed-interface modes per link."""
    links = []
    for link in mechanism.links:
        body = link.body
        if elements is not None:
            assert isinstance(body, Beam)
            body = replace(body, elements=elements)
        links.append(replace(link, body=body, modes=link.modes if modes is None else modes))
    return replace(mechanism, links=tuple(links))


def eleven(model: LinkageModel, configuration: Configuration) -> tuple[FloatArray, FloatArray]:
    """Return the rows on the interface DoFs of eleven responses, (11, n), and a force, (1, n).

    The responses are x and z of V1, V2, E1 and E2, and x, z and the rotation of the implement's
    centre of gravity. The force is at E1 along z. The paper does not name its eleven responses.
    """
    n = len(model.interface)  # rigid bodies come last
    outputs = np.vstack([model.rows(RESPONSES, configuration), np.eye(n)[n - 3 :]])
    return outputs, model.rows([FORCE], configuration)


def worst_frequency(result: FloatArray, exact: FloatArray) -> float:
    """Return the largest relative error of the natural frequencies."""
    return float(np.abs(result / exact - 1.0).max())


def frf_error(result: ComplexArray, exact: ComplexArray) -> float:
    """Return the relative L2 error of FRFs, (n_lines, 11).

    LM-FBS omits 0 Hz, where floating links have no receptance, so the last lines are compared.
    """
    exact = exact[len(exact) - len(result) :]
    return float(np.linalg.norm(result - exact) / np.linalg.norm(exact))


@dataclass(frozen=True)
class Scene:
    """A linkage, and the angles at which it is solved.

    Attributes
    ----------
    mechanism : Mechanism
        The shipped linkage.
    lines : ndarray, (n_lines,), Hz
        Frequency lines of the FRFs, from 0 upwards.
    angles : ndarray, (n_angles,), rad
        Angles at which FRFs are compared.
    live_angles : ndarray, (n_live,), rad
        Angles at which predictions are compared; they are on no table's grid.
    fine : int
        Elements per link of the reference.
    """

    mechanism: Mechanism
    lines: FloatArray
    angles: FloatArray
    live_angles: FloatArray
    fine: int = FINE

    @cached_property
    def kinematics(self) -> Kinematics:
        """The kinematics of the linkage, the same for every method."""
        return Kinematics(self.mechanism)

    def model(
        self, *, elements: int | None = None, modes: int | None = None, reduced: bool = True
    ) -> LinkageModel:
        """Return the model with another number of elements or modes per link."""
        mechanism = changed(self.mechanism, elements=elements, modes=modes)
        return LinkageModel(mechanism, kinematics=self.kinematics, reduced=reduced)

    def reference(
        self, angles: FloatArray, step: Callable[[], object] = lambda: None
    ) -> tuple[FloatArray, ComplexArray]:
        """Solve the linkage with fine meshes, unreduced, with all modes.

        Returns
        -------
        frequencies : ndarray, (n_angles, 3)
            Hz.
        frfs : ndarray, (n_angles, n_lines, 11)
            m/N and rad/N.
        """
        model = self.model(elements=self.fine, reduced=False)
        frequencies, frfs = [], []
        for alpha3 in angles:
            solution = model.solve(float(alpha3))
            frequencies.append(solution.natural_frequencies[:MODES])
            outputs, inputs = eleven(model, solution.configuration)
            shapes = solution.modes.shapes[: len(model.interface)]
            residues = pole_residue(solution.damped, outputs @ shapes, inputs @ shapes)
            frfs.append(residues.frf(self.lines)[:, :, 0])
            step()
        return np.array(frequencies), np.array(frfs)


def standard_scene() -> Scene:
    """Return the paper's linkage and lines."""
    mechanism = read_mechanism(MECHANISM)
    return Scene(
        mechanism,
        lines=LINES,
        angles=np.radians([90.0, 113.7, 137.3, 158.9, 180.0]),
        live_angles=off_grid(mechanism.stroke, 200),
    )


def off_grid(stroke: tuple[float, float], n: int) -> FloatArray:
    """Return angles spread over the stroke by the golden ratio, which are on no even grid."""
    share = (np.arange(1, n + 1) * (math.sqrt(5.0) - 1.0) / 2.0) % 1.0
    return np.asarray(stroke[0] + (stroke[1] - stroke[0]) * share, dtype=float)
