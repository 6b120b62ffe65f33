# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The fit of a free link's receptances, whose exact ones are those of masses joined by springs."""

import math
from dataclasses import replace

import numpy as np
import pytest

from linkage_vibration.mechanics.arrays import ComplexArray, FloatArray
from linkage_vibration.mechanics.description import InterfaceDof
from linkage_vibration.mechanics.link_fit import Choice, LinkFit, _Law, _residues, _Shape
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


@pytest.mark.parametrize("noise", [1e-4, 1e-2])
def test_a_mode_has_one_shape(noise: float) -> None:
    """At its pole the fit is a multiple of the outer product of one shape, whatever the noise."""
    generator, lines = np.random.default_rng(3), np.linspace(4.0, 160.0, 40)
    fit = fitted(lines, 2.4, noise, generator)
    [pole] = fit.poles[fit.poles.imag < 2.0 * math.pi * 160.0]
    assert abs(pole) / (2.0 * math.pi) == pytest.approx(HERTZ, rel=noise)
    near = fit.at(np.array([pole * (1.0 + 1e-7)]))[0]
    values = np.linalg.svd(near)[1]
    assert values[1] < 1e-4 * values[0]


@pytest.mark.parametrize(
    ("second", "relative", "count"),
    [(1.0, 1e-3, 2), (0.0, 1e-3, 1), (0.03, 1e-3, 2), (0.03, 0.1, 1)],
)
def test_two_modes_at_one_frequency(second: float, relative: float, count: int) -> None:
    """Masses with equal springs across have two shapes at one pole; without those springs, one.

    A second shape that is weak is kept if the lines show it, and not if noise explains it.
    """
    random, lines = np.random.default_rng(4), np.linspace(4.0, 160.0, 40)
    along = receptances(2j * math.pi * lines, 2.4)
    across = np.ones((2, 2)) / (2.0 * MASS) / (2j * math.pi * lines[:, None, None]) ** 2
    exact = np.zeros((40, 4, 4), complex)
    exact[:, :2, :2], exact[:, 2:, 2:] = along, across + second * (along - across)
    noise = random.standard_normal((2, *exact.shape)) / math.sqrt(2.0)
    dofs = [InterfaceDof(point, direction) for direction in "xz" for point in "AB"]
    motions = np.kron(np.eye(2), np.ones((2, 1)))
    if not second:
        motions = np.column_stack([motions, [0.0, 0.0, 1.0, -1.0]])
    fit = regularise(
        dofs, lines, exact * (1.0 + relative * (noise[0] + 1j * noise[1])), motions
    ).fit
    [pole] = fit.poles[fit.poles.imag < 2.0 * math.pi * 160.0]
    values = np.linalg.svd(fit.at(np.array([pole * (1.0 + 1e-7)]))[0])[1]
    assert (values > 1e-2 * values[0]).sum() == count


def test_noise_adds_no_shape_to_two() -> None:
    """A third shape at the pole of two modes is noise of the rigid block, and is left out."""
    random, lines = np.random.default_rng(4), np.linspace(4.0, 160.0, 40)
    s = 2j * math.pi * lines
    exact = np.zeros((40, 6, 6), complex)
    exact[:, :2, :2] = exact[:, 2:4, 2:4] = receptances(s, 2.4)
    exact[:, 4:, 4:] = np.eye(2) / MASS / s[:, None, None] ** 2
    noise = random.standard_normal((2, *exact.shape)) / math.sqrt(2.0)
    dofs = [InterfaceDof(point, direction) for direction in ("x", "z", "theta") for point in "AB"]
    motions = np.zeros((6, 4))
    motions[:2, 0] = motions[2:4, 1] = motions[4, 2] = motions[5, 3] = 1.0
    noisy = exact * (1.0 + 1e-3 * (noise[0] + 1j * noise[1])) + 1e-9 * noise[1]
    fit = regularise(dofs, lines, noisy, motions).fit
    [pole] = fit.poles[fit.poles.imag < 2.0 * math.pi * 160.0]
    values = np.linalg.svd(fit.at(np.array([pole * (1.0 + 1e-7)]))[0])[1]
    assert values[1] > 0.5 * values[0]
    assert values[2] < 1e-4 * values[0]


@pytest.mark.parametrize("noise", [1e-6, 1e-3])
@pytest.mark.parametrize("gap", [0.5, 2.0])
def test_modes_nearer_than_their_half_width(gap: float, noise: float) -> None:
    """A mass inside, which A and B follow alike, has a mode 0.5 or 2 Hz above the elastic one.

    It deforms no link whose forces are in equilibrium, so that the rigid block alone shows it.
    """
    random, lines = np.random.default_rng(6), np.linspace(4.0, 160.0, 157)
    turns, width, together = np.array([1.0, -1j]), 4.0, np.ones((2, 2)) / 2.0

    def both(s: ComplexArray) -> ComplexArray:
        inner = 1.0 / (s**2 + 2.0 * math.pi * width * s + (2.0 * math.pi * (HERTZ + gap)) ** 2)
        return receptances(s, width) + np.multiply.outer(inner, together) / MASS

    exact = both(2j * math.pi * lines)
    real, imaginary = random.standard_normal((2, *exact.shape)) / math.sqrt(2.0)
    dofs = [InterfaceDof(point, "x") for point in "AB"]
    noisy = exact * (1.0 + noise * (real + 1j * imaginary))
    fit = regularise(dofs, lines, noisy, np.ones((2, 1))).fit
    among = fit.poles[fit.poles.imag < 2.0 * math.pi * 160.0]
    frequencies = np.sort(np.abs(among)) / (2.0 * math.pi)
    np.testing.assert_allclose(frequencies, [HERTZ, HERTZ + gap], rtol=max(noise, 1e-5))
    places = 2j * math.pi * HERTZ * np.array([0.2, 0.7, 1.0, 1.3])
    missed = np.array([FORCE @ h @ FORCE for h in fit.at(places) - both(places)])
    variances = [fit.variances(complex(s), FORCE + 0j, turns, noise) for s in places]
    assert (np.abs(np.multiply.outer(missed, turns).real) < 4.0 * np.sqrt(variances)).all()


@pytest.mark.parametrize("law", _Law)
def test_changes_with_what_is_fitted(law: _Law) -> None:
    """Differences have the same limits as how the fit changes with parameters and numerators.

    The numerators are those of two modes of one shape each, and their changes any symmetric ones.
    """
    random, step = np.random.default_rng(0), 1e-6
    parameters = np.array([0.3, 0.5, 0.02, 0.01, *([] if law is _Law.ANY else [0.03])])
    shape, s = _Shape(law, 2, parameters), np.array([[-0.01 + 0.6j]])
    for change, row in zip(np.eye(len(parameters)) * step, shape.derivatives(s), strict=True):
        ends = (replace(shape, parameters=parameters + sign * change).terms(s) for sign in (1, -1))
        np.testing.assert_allclose(row * 2.0 * step, np.subtract(*ends), atol=1e-6 * step)

    modes = random.standard_normal((2, 3)) + 1j * random.standard_normal((2, 3)) * shape.pairs
    wholes, poles = [np.outer(u, u) for u in modes], shape.poles()
    numerators = [whole.real for whole in wholes]
    if shape.pairs:
        pairs = list(zip(wholes, poles, strict=True))
        second = [whole.imag / pole.imag for whole, pole in pairs]
        first = [w.real - p.real * c for (w, p), c in zip(pairs, second, strict=True)]
        numerators = [*first, *second]
    given, forces = np.array(numerators), random.standard_normal(3) + 1j * random.standard_normal(3)
    change = random.standard_normal(given.shape)
    change = change + change.swapaxes(1, 2)

    def value(numerators: FloatArray) -> complex:
        kept = numerators - _residues(shape, numerators, np.full(2, np.inf)).excess
        return complex(forces @ np.tensordot(shape.modal_terms(s)[0], kept, axes=1) @ forces)

    residues = _residues(shape, given, np.full(2, np.inf))
    assert np.abs(residues.excess).max() < 1e-12
    actual = complex((residues.weights(s, forces) * change).sum())
    limit = (value(given + step * change) - value(given - step * change)) / (2.0 * step)
    assert actual == pytest.approx(limit, rel=1e-6)


def test_a_pole_that_does_not_oscillate_keeps_all_shapes() -> None:
    """Its numerators count as they are, whatever noise explains."""
    random, s = np.random.default_rng(1), np.array([[0.6j]])
    shape = _Shape(_Law.ANY, 1, np.array([0.3, 0.4, 2.0, 0.02]))
    assert shape.poles()[0].imag == 0.0
    given = random.standard_normal((4, 3, 3))
    residues = _residues(shape, given + given.swapaxes(1, 2), np.full(2, np.inf))
    assert not residues.excess[[0, 2]].any()
    assert residues.excess[[1, 3]].any()
    forces = np.array([1.0, 2.0, 0.5j])
    weights, whole = residues.weights(s, forces), np.outer(forces, forces)
    value = 1.0 / (s[0, 0] ** 2 + 2.0 * s[0, 0] + 0.3)
    np.testing.assert_allclose(weights[0], value * whole, rtol=1e-12)
    np.testing.assert_allclose(weights[2], s[0, 0] * value * whole, rtol=1e-12)


@pytest.mark.parametrize("law", _Law)
@pytest.mark.parametrize("order", [1, 2, 3])
def test_wider_fits_have_a_further_power(law: _Law, order: int) -> None:
    """Both fits that show what the number of terms decides follow the next even power of s."""
    parameters = np.array([0.3, 0.02, *([] if law is _Law.ANY else [0.0])])
    shape, s = _Shape(law, order, parameters), 1j * np.linspace(0.1, 1.0, 30)[:, np.newaxis]
    left = []
    for each in (shape, shape.with_one_more(), shape.of_any_law()):
        above = each.above(s)
        values = np.linalg.lstsq(above, s ** (2.0 * order), rcond=None)[0]
        left.append(np.abs(above @ values - s ** (2.0 * order)).max())
    # Without damping, the last power of any law is s^(2 order - 2) as well.
    assert left[0] > 1e-4
    assert max(left[1:]) < 1e-9


def test_variances_contain_the_larger_change_of_both_wider_fits() -> None:
    """Either of them can be the larger; the one that leaves less hid the other."""
    generator, lines = np.random.default_rng(7), np.linspace(4.0, 160.0, 40)
    turns, larger = np.array([1.0, -1j]), set[bool]()
    for _ in range(6):
        fit = fitted(lines, 2.4, 1e-2, generator)
        best = fit.parts[Choice.BEST]
        alone = [
            replace(fit, parts={**fit.parts, without: best})
            for without in (Choice.WIDER, Choice.FREER)
        ]
        for s in 2j * math.pi * HERTZ * np.array([0.3, 1.5, 2.5]):
            both, freer, wider = (
                each.variances(complex(s), FORCE + 0j, turns, 1e-2) for each in (fit, *alone)
            )
            np.testing.assert_allclose(both, np.maximum(freer, wider), rtol=1e-9)
            larger |= set((freer > 1.01 * wider).tolist()) if (freer != wider).any() else set()
    assert larger == {False, True}


def test_too_few_lines() -> None:
    """Twenty-nine lines are refused, and thirty are enough."""
    generator = np.random.default_rng(2)
    with pytest.raises(RegularisationError, match="at least 30"):
        fitted(np.linspace(4.0, 120.0, 29), 2.4, 1e-3, generator)
    fit = fitted(np.linspace(4.0, 120.0, 30), 2.4, 1e-3, generator)
    assert abs(fit.poles[0]) / (2.0 * math.pi) == pytest.approx(HERTZ, rel=1e-3)
