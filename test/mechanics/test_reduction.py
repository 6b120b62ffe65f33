# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Craig-Bampton: exact statics, frequencies from above, all modes for the whole truth."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from linkage_vibration.mechanics.bodies.beam import Beam, Segment, beam_matrices
from linkage_vibration.mechanics.description import Material
from linkage_vibration.mechanics.reduction import ReductionError, craig_bampton
from linkage_vibration.mechanics.sections.rectangle import rectangle

FloatArray = NDArray[np.float64]


@pytest.fixture(scope="module")
def matrices() -> tuple[FloatArray, FloatArray]:
    """Return a beam's mass and stiffness, its four end displacements first."""
    beam = Beam(Material(210e9, 7800.0, 0.3), (Segment(0.8, rectangle(0.02, 0.04, 0.3)),), 12)
    actual = beam_matrices(beam, (("A", (0.0, 0.0)), ("B", (0.8, 0.0))))
    assert len(actual.dofs) == 4
    return actual.mass, actual.stiffness


def held(mass: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Return eigenvalues with the first DoF's rigid motions held (u, w of one end, w of other)."""
    free = np.setdiff1d(np.arange(len(mass)), [0, 1, 3])
    return eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], eigvals_only=True)


def test_all_modes_lose_nothing(matrices: tuple[FloatArray, FloatArray]) -> None:
    """With every fixed-interface mode the eigenvalues are those of the full matrices."""
    reduction = craig_bampton(*matrices, n_interface=4, n_modes=10_000)
    assert reduction.mass.shape == matrices[0].shape
    np.testing.assert_allclose(
        held(reduction.mass, reduction.stiffness), held(*matrices), rtol=1e-9
    )


def test_frequencies_fall_from_above(matrices: tuple[FloatArray, FloatArray]) -> None:
    """Each further mode lowers the frequencies, none below the full ones."""
    full = held(*matrices)[:4]
    previous = np.full(4, np.inf)
    for n_modes in (3, 5, 8, 12, 20, 30):
        reduction = craig_bampton(*matrices, n_interface=4, n_modes=n_modes)
        actual = held(reduction.mass, reduction.stiffness)[:4]
        assert (actual >= full * (1 - 1e-9)).all()
        assert (actual <= previous * (1 + 1e-9)).all()
        previous = actual
    np.testing.assert_allclose(previous, full, rtol=1e-5)


def test_statics_on_the_interface_are_exact(matrices: tuple[FloatArray, FloatArray]) -> None:
    """The interface stiffness is the Schur complement, with any number of modes."""
    stiffness = matrices[1]
    b, i = slice(0, 4), slice(4, None)
    condensed = stiffness[b, b] - stiffness[b, i] @ np.linalg.solve(
        stiffness[i, i], stiffness[i, b]
    )
    reduction = craig_bampton(*matrices, n_interface=4, n_modes=2)
    scale = np.abs(condensed).max()
    np.testing.assert_allclose(reduction.stiffness[:4, :4], condensed, atol=1e-9 * scale)
    assert np.abs(reduction.stiffness[:4, 4:]).max() < 1e-9 * scale


def test_reduced_matrices_keep_their_signs(matrices: tuple[FloatArray, FloatArray]) -> None:
    """Reduced mass is positive definite and stiffness positive semi-definite, both symmetric."""
    reduction = craig_bampton(*matrices, n_interface=4, n_modes=7)
    assert (reduction.mass == reduction.mass.T).all()
    assert (reduction.stiffness == reduction.stiffness.T).all()
    assert np.linalg.eigvalsh(reduction.mass).min() > 0.0
    lowest = np.linalg.eigvalsh(reduction.stiffness)
    assert lowest.min() > -1e-9 * lowest.max()


def test_a_component_that_is_not_held_is_refused() -> None:
    """If the interface leaves a rigid motion free, the error says to hold more."""
    mass, stiffness = np.eye(3), np.zeros((3, 3))
    with pytest.raises(ReductionError, match="hold more"):
        craig_bampton(mass, stiffness, n_interface=1, n_modes=1)


def test_freedom_that_rounding_hides_is_refused() -> None:
    """A bar held at one pin can swing, though its stiffness factorises by rounding."""
    beam = Beam(Material(210e9, 7800.0, 0.3), (Segment(0.8, rectangle(0.02, 0.04, 0.3)),), 12)
    actual = beam_matrices(beam, (("A", (0.0, 0.0)), ("B", (0.8, 0.0))))
    with pytest.raises(ReductionError, match="hold more"):
        craig_bampton(actual.mass, actual.stiffness, n_interface=2, n_modes=3)
