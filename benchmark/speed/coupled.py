# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reduced links, coupled by their FRFs (LM-FBS) or on the null space of B."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from benchmark.speed.method import Method, counted
from benchmark.speed.scene import MODES, Rows, Scene, eleven
from linkage_vibration.mechanics.components import Component
from linkage_vibration.mechanics.fbs import component_frf, couple_frfs
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.mechanics.response import PoleResidue, far_poles, in_reach, pole_residue

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ALL_MODES = "null space, all modes"
NO_RESIDUAL = "null space, below 600 Hz"
RESIDUAL = "null space, below 600 Hz, static residual"
FAR_POLES = "null space, below 260 Hz, far poles"
BATCHED = "LM-FBS, batched"
AS_WRITTEN = "LM-FBS as written, eq. 19"
REDUCED_MESH = "null space, 20 modes, coarser mesh"
KEPT = 3.0  # modes are kept below this multiple of the highest line
NO_MODES = "LM-FBS couples FRFs; natural frequencies would have to be identified from them"


def methods(scene: Scene, modes: Sequence[int], elements: Sequence[int]) -> list[Method]:
    """Return every method, with these numbers of modes or elements per link."""
    result = []
    for n in modes:
        model = scene.model(elements=scene.fine, modes=n)
        setting = counted(n, "mode")
        blocks = component_frfs(model, scene.lines[1:])
        held = held_frfs(model, scene.lines[1:])
        full = np.stack([block_diag(*matrices) for matrices in zip(*blocks, strict=True)])
        result += [
            Method(
                ALL_MODES,
                setting,
                partial(natural_frequencies, model),
                partial(modal_frf, model, lines=scene.lines),
            ),
            Method(NO_RESIDUAL, setting, None, partial(truncated_frf, model, scene.lines, False)),
            Method(RESIDUAL, setting, None, partial(truncated_frf, model, scene.lines, True)),
            Method(FAR_POLES, setting, None, partial(condensed_frf, model, lines=scene.lines)),
            Method(BATCHED, setting, None, partial(batched, model, held), NO_MODES),
            Method(AS_WRITTEN, setting, None, partial(as_written, model, full), NO_MODES),
        ]
    for n in elements:
        model = scene.model(elements=n, modes=20)
        result.append(
            Method(
                REDUCED_MESH,
                counted(n, "element"),
                partial(natural_frequencies, model),
                partial(modal_frf, model, lines=scene.lines),
            )
        )
    return result


def natural_frequencies(model: LinkageModel, alpha3: float) -> FloatArray:
    """Return the first natural frequencies, (3,), Hz."""
    return model.solve(alpha3).natural_frequencies[:MODES]


def modal_frf(model: LinkageModel, alpha3: float, lines: FloatArray) -> ComplexArray:
    """Return the eleven FRFs as a sum over all modes of the assembly, (n_lines, 11)."""
    return eleven_functions(model, alpha3).frf(lines)[:, :, 0]


def eleven_functions(model: LinkageModel, alpha3: float, rows: Rows = eleven) -> PoleResidue:
    """Return the eleven FRFs in pole-residue form."""
    solution = model.solve(alpha3)
    outputs, inputs = rows(model, solution.configuration)
    shapes = solution.modes.shapes[: len(model.interface)]
    return pole_residue(solution.damped, outputs @ shapes, inputs @ shapes)


def truncated_frf(
    model: LinkageModel, lines: FloatArray, residual: bool, alpha3: float
) -> ComplexArray:
    """Return the eleven FRFs from modes up to three times the band, (n_lines, 11).

    The residual of the other modes is 1/(k - w^2 + i w c) = 1/k + (w^2 - i w c)/k^2 + ...
    """
    functions = eleven_functions(model, alpha3)
    kept = np.abs(functions.stiffness) < (2.0 * math.pi * KEPT * lines[-1]) ** 2
    near = replace(
        functions,
        stiffness=functions.stiffness[kept],
        decay=functions.decay[kept],
        residues=functions.residues[:, :, kept],
        rates=functions.rates[:, :, kept],
    )
    frf = near.frf(lines)[:, :, 0]
    if residual:
        w = 2.0 * math.pi * lines[:, np.newaxis]
        rest = functions.residues[:, 0, ~kept] / functions.stiffness[~kept]
        slope = rest / functions.stiffness[~kept]
        frf += rest.sum(axis=1) + w**2 * slope.sum(axis=1)
        frf -= 1j * w * (slope @ functions.decay[~kept])
    return frf


def condensed_frf(model: LinkageModel, alpha3: float, lines: FloatArray) -> ComplexArray:
    """Return the eleven FRFs with far poles for the modes above the band, (n_lines, 11)."""
    functions = eleven_functions(model, alpha3)
    band = (float(lines[0]), float(lines[-1]))
    kept = in_reach(functions.stiffness, band)
    far = far_poles(functions.stiffness[~kept], functions.decay[~kept], band)
    return functions.condensed(kept, far).frf(lines)[:, :, 0]


def component_frfs(model: LinkageModel, lines: FloatArray) -> list[ComplexArray]:
    """Return the FRFs of all components on their interface DoFs, one block each."""
    return [
        component_frf(c.mass, c.stiffness, c.damping, len(c.dofs), lines, c.loss_factor)
        for c in model.components
        if isinstance(c, Component)
    ]


def held_frfs(model: LinkageModel, lines: FloatArray) -> list[ComplexArray]:
    """Return the FRFs of all components, fixed where the ground holds them, on other DoFs."""
    blocks, start = [], 0
    for c in model.components:
        assert isinstance(c, Component)
        held = model.interface.held[start : start + len(c.dofs)]
        start += len(c.dofs)
        left = [*np.flatnonzero(~held), *range(len(c.dofs), len(c.mass))]
        at = np.ix_(left, left)
        matrices = c.mass[at], c.stiffness[at], c.damping[at]
        blocks.append(component_frf(*matrices, int((~held).sum()), lines, c.loss_factor))
    return blocks


def joints_left(model: LinkageModel, compatibility: FloatArray) -> FloatArray:
    """Return the rows of B that do not belong to the ground, on those DoFs."""
    on_free = compatibility[:, ~model.interface.held]
    return np.asarray(on_free[on_free.any(axis=1)])


def batched(
    model: LinkageModel, blocks: Sequence[ComplexArray], alpha3: float, rows: Rows = eleven
) -> ComplexArray:
    """Return the eleven FRFs by LM-FBS from `held_frfs`, all lines at once, (n_lines, 11)."""
    configuration = model.kinematics.at(alpha3)
    outputs, inputs = (given[:, ~model.interface.held] for given in rows(model, configuration))
    compatibility = joints_left(model, model.interface.join(configuration).compatibility)
    return couple_frfs(blocks, compatibility, outputs, inputs)[:, :, 0]


def as_written(model: LinkageModel, frf: ComplexArray, alpha3: float) -> ComplexArray:
    """Return the eleven FRFs by eq. 19 line by line, (n_lines, 11).

    H - H B^T (B H B^T)^-1 B H, with H the full block-diagonal matrix, (n_lines, n, n).
    """
    configuration = model.kinematics.at(alpha3)
    outputs, inputs = eleven(model, configuration)
    b = model.interface.join(configuration).compatibility
    values = np.empty((len(frf), len(outputs)), dtype=complex)
    for row, h in zip(values, frf, strict=True):
        coupled = h - h @ b.T @ np.linalg.inv(b @ h @ b.T) @ b @ h
        row[:] = outputs @ coupled @ inputs[0]
    return values
