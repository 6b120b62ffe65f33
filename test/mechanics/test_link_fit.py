# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The fit of a free link's receptances, whose exact ones are those of masses joined by springs."""

import math

import numpy as np
import pytest

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.description import InterfaceDof
from linkage_vibration.mechanics.link_fit import LinkFit
from linkage_vibration.mechanics.regularisation import RegularisationError, regularise

MASS, STIFFNESS = 4.0, 2.5e5  # kg of each of two masses, N/m of the spring between them
HERTZ = math.sqrt(2.0 * STIFFNESS / MASS) / (2.0 * math.pi)  # 56.3 Hz
FORCE = np.array([1.0, 0.3j])


def receptances(s: ComplexArray, width: float) -> ComplexArray:
    """Return those at points s, (n,), by the rigid and the elastic mode, whose width is in Hz."""
    apart = np.array([[1.0, -1.0], [-1.0, 1.0]]) / 2.0
    elastic = 1.0 / (s**2 + 2.0 * math.pi * width * s + (2.0 * math.pi * HERTZ) ** 2)
    parts = np.multiply.outer(s**-2.0, abs(apart)) + np.multiply.outer(elastic, apart)
    return np.asarray(parts / MASS)


def fitted(
    lines: FloatArray, width: float, noise: float, generator: np.random.Generator
) -> LinkFit:
    """Return the fit of receptances at lines, Hz, with noise."""
    exact = receptances(2j * math.pi * lines, width)
    real, imaginary = generator.standard_normal((2, *exact.shape)) / math.sqrt(2.0)
    noisy = exact * (1.0 + noise * (real + 1j * imaginary))
    dofs = [InterfaceDof(point, "x") for point in "AB"]
    return regularise(dofs, lines, noisy, np.ones((2, 1))).fit


def errors(fit: LinkFit, places: ComplexArray, width: float, noise: float) -> FloatArray:
    """Return errors of real and imaginary parts over their standard deviations, (n_places, 2)."""
    turns = np.array([1.0, -1j])
    missed = np.array([FORCE @ h @ FORCE for h in fit.at(places) - receptances(places, width)])
    variances = [fit.variances(complex(s), FORCE + 0j, turns, noise) for s in places]
    return np.asarray(np.multiply.outer(missed, turns).real / np.sqrt(variances))


@pytest.mark.nightly(short="test_resonances_between_lines")
def test_variances_are_those_of_drawn_noise() -> None:
    """Fits of 50 drawings of noise scatter as each predicts, near the mode and below it."""
    generator, lines = np.random.default_rng(5), np.linspace(4.0, 160.0, 40)
    places = np.array([-5.0 + 350.0j, 120.0j])
    drawn = [errors(fitted(lines, 2.4, 1e-3, generator), places, 2.4, 1e-3) for _ in range(50)]
    # Each mean square has a standard error of 20 %, and the mean of all four less.
    assert np.mean(np.square(drawn)) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("width", [0.1, 0.5, 2.0, 8.0])
def test_resonances_between_lines(width: float) -> None:
    """Their flanks show those that are narrower than the spacing of the lines, 4 Hz, as well."""
    generator, lines = np.random.default_rng(1), np.linspace(4.0, 160.0, 40)
    places = 2j * math.pi * HERTZ * np.array([0.2, 0.7, 1.0])
    drawn = [errors(fitted(lines, width, 1e-3, generator), places, width, 1e-3) for _ in range(4)]
    assert np.abs(drawn).max() < 4.0


def test_too_few_lines() -> None:
    """Twenty-nine lines are refused, and thirty are enough."""
    generator = np.random.default_rng(2)
    with pytest.raises(RegularisationError, match="at least 30"):
        fitted(np.linspace(4.0, 120.0, 29), 2.4, 1e-3, generator)
    fit = fitted(np.linspace(4.0, 120.0, 30), 2.4, 1e-3, generator)
    assert abs(fit.poles[0]) / (2.0 * math.pi) == pytest.approx(HERTZ, rel=1e-3)
