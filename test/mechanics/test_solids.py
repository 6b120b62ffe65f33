# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid ties, and the sparse reduction against the dense one; `test_meshes` has whole solids."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

from linkage_vibration.mechanics.reduction import ReductionError, craig_bampton
from linkage_vibration.mechanics.solids import Pin, rigid_ties, sparse_craig_bampton

FloatArray = NDArray[np.float64]


def frame(nx: int, ny: int) -> tuple[FloatArray, FloatArray]:
    """Return mass and stiffness of a grid of masses on springs, each tied to the ground a little.

    The first six coordinates are the interface.
    """
    n = nx * ny
    stiffness = 1e-3 * np.eye(n)
    pairs = [(k, k + 1) for k in range(n) if (k + 1) % nx] + [(k, k + nx) for k in range(n - nx)]
    for a, b in pairs:
        spring = 1.0 + 0.1 * np.sin(7.0 * a + b)
        stiffness[[a, b], [a, b]] += spring
        stiffness[[a, b], [b, a]] -= spring
    return np.diag(1.0 + 0.5 * np.cos(np.arange(n)) ** 2), stiffness


@pytest.mark.parametrize(("shape", "modes"), [((12, 5), 7), ((30, 20), 7), ((12, 5), 1000)])
def test_sparse_reduction_is_the_dense_one(shape: tuple[int, int], modes: int) -> None:
    """Both give the same matrices but for the signs of modes: all at once, few, or all of them."""
    mass, stiffness = frame(*shape)
    dense = craig_bampton(mass, stiffness, 6, modes)
    matrices = sparse.csc_array(mass), sparse.csc_array(stiffness)
    reduced = sparse_craig_bampton(*matrices, 6, modes, sparse.identity(len(mass), format="csr"))
    assert reduced.mass.shape == dense.mass.shape
    for each, other in ((reduced.mass, dense.mass), (reduced.stiffness, dense.stiffness)):
        np.testing.assert_allclose(np.abs(each), np.abs(other), atol=1e-9)


def test_reflection_chooses_modes() -> None:
    """Of a symmetric chain the modes are kept that are their own mirror image, two alike included.

    Two equal chains side by side have every frequency twice, and modes that are mixed at will.
    """
    n = 20
    chain = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    stiffness = np.block([[np.eye(1), np.zeros((1, 2 * n))], [np.zeros((2 * n, 1)), np.eye(2 * n)]])
    stiffness[1:, 1:] = np.kron(np.eye(2), chain)
    mirror = np.eye(2 * n + 1)
    mirror[1:, 1:] = np.kron([[0.0, 1.0], [1.0, 0.0]], np.eye(n))  # one chain is the other's image
    reduced = sparse_craig_bampton(
        sparse.csc_array(np.eye(2 * n + 1)),
        sparse.csc_array(stiffness),
        1,
        6,
        sparse.csr_array(mirror),
    )
    expected = 2.0 - 2.0 * np.cos(np.arange(1, 7) * np.pi / (n + 1))
    np.testing.assert_allclose(np.diag(reduced.stiffness)[1:], expected, rtol=1e-9)
    shapes = reduced.transformation[1:, 1:]
    np.testing.assert_allclose(shapes[:n], shapes[n:], atol=1e-9)


def test_interior_that_can_move() -> None:
    """A mass on no spring is refused, however well rounding hides it."""
    mass, stiffness = frame(12, 5)
    stiffness[30] = stiffness[:, 30] = 0.0
    stiffness[30, [30, 31]] = stiffness[31, [31, 30]] = 0.1, -0.1
    stiffness[31] = stiffness[:, 31] = 0.0
    stiffness[[30, 31], [30, 31]], stiffness[[30, 31], [31, 30]] = 0.1, -0.1
    with pytest.raises(ReductionError, match="6 interface DoFs held the component can still move"):
        matrices = sparse.csc_array(mass), sparse.csc_array(stiffness)
        sparse_craig_bampton(*matrices, 6, 3, sparse.identity(len(mass), format="csr"))


def test_ties_move_as_rigid_bodies() -> None:
    """Pins move their nodes as u + omega x r in the plane, and leave other nodes to themselves."""
    rng = np.random.default_rng(0)
    nodes = rng.normal(size=(9, 3))
    pins = [
        Pin("A", (0.3, -0.2), np.array([7, 2, 4])),
        Pin("B", (-1.0, 0.5), np.array([0, 8, 3, 5])),
    ]
    ties, dofs = rigid_ties(nodes, pins, {"B"})
    assert [str(dof) for dof in dofs] == ["A x", "A z", "B x", "B z", "B theta"]
    assert ties.shape == (27, 6 + 6)
    q = rng.normal(size=12)
    moved = (ties @ q).reshape(9, 3)
    motions = (
        (q[0], q[1], q[5]),
        (q[2], q[3], q[4]),
    )  # the rotation that is no interface DoF is last
    for pin, (x, z, theta) in zip(pins, motions, strict=True):
        place = np.array([pin.place[0], 0.0, pin.place[1]])
        turned = np.cross([0.0, -theta, 0.0], nodes[pin.nodes] - place)  # from x towards z
        expected = [x, 0.0, z] + turned * [1.0, 0.0, 1.0]
        np.testing.assert_allclose(moved[pin.nodes], expected)
    np.testing.assert_array_equal(moved[[1, 6]], q[6:].reshape(2, 3))


def test_pins_that_share_a_node() -> None:
    """One node cannot follow two rigid bodies."""
    pins = [Pin("A", (0.0, 0.0), np.array([0, 1])), Pin("B", (0.0, 0.0), np.array([1, 2]))]
    with pytest.raises(ReductionError, match="Two pins share a node"):
        rigid_ties(np.zeros((4, 3)), pins)
