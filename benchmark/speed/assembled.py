# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The assembled finite-element model, unreduced, with sparse eigenvalue and direct solvers."""

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.sparse import block_diag, csc_matrix, eye
from scipy.sparse.linalg import eigsh, splu

from benchmark.speed.method import Method, counted
from benchmark.speed.scene import MODES, Scene, eleven
from linkage_vibration.mechanics.kinematics import Configuration
from linkage_vibration.mechanics.model import LinkageModel

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

FAMILY = "assembled, unreduced, sparse"
_SHIFT = (2.0 * math.pi) ** 2  # (rad/s)^2


def methods(scene: Scene, elements: tuple[int, ...]) -> list[Method]:
    """Return the assembly with these numbers of elements per link."""
    result = []
    for n in elements:
        model = scene.model(elements=n, reduced=False)
        result.append(
            Method(
                FAMILY,
                counted(n, "element"),
                partial(sparse_frequencies, model),
                partial(sparse_frf, model, lines=scene.lines),
            )
        )
    return result


def sparse_frequencies(model: LinkageModel, alpha3: float) -> FloatArray:
    """Return the first natural frequencies by shift-invert Lanczos, (3,), Hz."""
    mass, stiffness, _, _ = _assemble(model, model.kinematics.at(alpha3))
    squared = eigsh(stiffness, MODES, mass, sigma=-_SHIFT, return_eigenvectors=False)
    return np.asarray(np.sqrt(np.sort(squared)) / (2.0 * math.pi))


def sparse_frf(model: LinkageModel, alpha3: float, lines: FloatArray) -> ComplexArray:
    """Return the eleven FRFs, (n_lines, 11), with one sparse factorisation per line."""
    configuration = model.kinematics.at(alpha3)
    mass, stiffness, damping, basis = _assemble(model, configuration)
    outputs, inputs = eleven(model, configuration)
    n = len(model.interface)
    outputs, force = outputs @ basis[:n], basis[:n].T @ inputs[0]
    # All three matrices share one pattern, so each line only adds numbers.
    pattern = (abs(mass) + abs(stiffness) + abs(damping)).tocoo()
    dynamic = csc_matrix((np.ones(pattern.nnz, dtype=complex), (pattern.row, pattern.col)))
    at = dynamic.tocoo()
    m, k, c = (np.asarray(a.tocsr()[at.row, at.col]).ravel() for a in (mass, stiffness, damping))
    frf = np.empty((len(lines), len(outputs)), dtype=complex)
    for row, w in zip(frf, 2.0 * math.pi * lines, strict=True):
        dynamic.data[:] = k - w**2 * m + 1j * w * c
        row[:] = outputs @ splu(dynamic).solve(force.astype(complex))
    return frf


def _assemble(
    model: LinkageModel, configuration: Configuration
) -> tuple[csc_matrix, csc_matrix, csc_matrix, csc_matrix]:
    """Return mass, stiffness, damping and their basis, without springs."""
    joining = model.interface.join(configuration)
    mass, stiffness, damping = _matrices(model)
    inner = eye(mass.shape[0] - len(model.interface))
    basis = block_diag([null_space(joining.compatibility), inner], format="csc")
    mass, stiffness, damping = (basis.T @ a @ basis for a in (mass, stiffness, damping))
    return mass.tocsc(), stiffness.tocsc(), damping.tocsc(), basis


def _matrices(model: LinkageModel) -> tuple[csc_matrix, csc_matrix, csc_matrix]:
    """Return the uncoupled matrices, which are cached for each model."""
    kept = model.__dict__
    if "_sparse" not in kept:
        system = model.system
        kept["_sparse"] = tuple(
            csc_matrix(a) for a in (system.mass, system.stiffness, system.damping)
        )
    result: tuple[csc_matrix, csc_matrix, csc_matrix] = kept["_sparse"]
    return result
