# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Poles of a link that is known by its FRFs, which a spring or a pin joins to the ground."""

import math

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from linkage_vibration.mechanics.assembly_poles import Assembly
from linkage_vibration.mechanics.compatibility import Joining
from linkage_vibration.mechanics.components import FrfComponent
from linkage_vibration.mechanics.description import InterfaceDof
from linkage_vibration.mechanics.regularisation import regularise

MASSES = np.diag([3.0, 2.0, 5.0])  # kg
SPRINGS = 4e5 * np.array([[1.0, -1.0, 0.0], [-1.0, 3.0, -2.0], [0.0, -2.0, 2.0]])  # N/m
DAMPING = 1e-4  # s: over the stiffness
HERTZ = np.arange(2.0, 200.0, 0.5)
ENDS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def poles(stiffness: NDArray[np.float64], kept: slice = slice(None)) -> NDArray[np.complex128]:
    """Return those of the masses that are kept, without rigid motion, rad/s."""
    squares = scipy.linalg.eigh(stiffness[kept, kept], MASSES[kept, kept], eigvals_only=True)
    squares = squares[squares > 1.0]
    return np.asarray(
        -DAMPING * squares / 2.0 + 1j * np.sqrt(squares - (DAMPING * squares / 2.0) ** 2)
    )


def assembly(noise: float, seed: int, spring: float | None) -> Assembly:
    """Return three masses in a row: a spring, N/m, holds the first one, or pins both ends."""
    s = 2j * math.pi * HERTZ[:, np.newaxis, np.newaxis]
    frf = np.linalg.inv(MASSES * s**2 + SPRINGS * (1.0 + DAMPING * s))
    real, imaginary = np.random.default_rng(seed).standard_normal((2, *frf.shape)) / math.sqrt(2.0)
    noisy = frf * (1.0 + noise * (real + 1j * imaginary))
    dofs = tuple(InterfaceDof(point, "x") for point in "ABC")
    measured = regularise(dofs, HERTZ, noisy, np.ones((3, 1)))
    component = FrfComponent("link", dofs, HERTZ, measured, noise, 0.0)
    rigid, sprung = (ENDS, ENDS[:0]) if spring is None else (ENDS[:0], ENDS[:1])
    stiffness = np.full(len(sprung), spring or 0.0)
    joining = Joining(rigid, ("pin",) * len(rigid), sprung, stiffness, DAMPING * stiffness)
    return Assembly([component], np.zeros(3, dtype=np.bool_), joining)


def check(joined: Assembly, exact: NDArray[np.complex128]) -> None:
    """Check that what was kept is exact, within four standard deviations."""
    assert len(joined.modes) == len(exact)
    for expected, (pole, frequency, ratio) in zip(exact, joined.modes, strict=True):
        assert abs(abs(pole) - abs(expected)) < 4.0 * 2.0 * math.pi * frequency
        assert abs(pole.real / abs(pole) - expected.real / abs(expected)) < 4.0 * ratio


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_poles_of_the_free_link_are_left_out(seed: int) -> None:
    """Between two pins, only the middle mass moves; noise lets the link keep a pole as if free."""
    held = poles(SPRINGS, slice(1, 2))
    joined = assembly(1e-2, seed, None)
    kept = joined.confirm(np.concatenate([held, poles(SPRINGS)]))
    assert kept.tolist() == [True, False, False]
    check(joined, held)


@pytest.mark.parametrize(("noise", "separate"), [(1e-3, True), (1e-2, False)])
def test_a_pole_near_one_of_the_free_link(noise: float, separate: bool) -> None:
    """A soft spring moves poles by 0.14 and 0.0051 Hz, which is seen if noise moves them less."""
    softly = SPRINGS + np.diag([3e3, 0.0, 0.0])
    exact = poles(softly)[-2:]
    joined = assembly(noise, 0, 3e3)
    assert joined.confirm(exact).tolist() == [True, separate]
    check(joined, exact[: 1 + separate])
