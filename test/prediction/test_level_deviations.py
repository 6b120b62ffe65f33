# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Where variances of levels are known, and their terms, with values found on paper."""

import math

import numpy as np
import pytest

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.excitation import excitations_from_mapping
from linkage_vibration.prediction.levels import (
    LevelTable,
    _hides_a_peak,
    _Layout,
    _padded,
    _variance,
)
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import load_table


def variance(constant: float, slope: float, bend: float) -> float:
    """Return the variance of constant + slope x + bend x^2, where x has a deviation of 1."""
    reach = math.sqrt(3.0)
    sides = [[constant + sign * slope * reach + 3.0 * bend] for sign in (-1.0, 1.0)]
    return float(_variance(np.array(sides), np.array([constant]))[0])


def test_variance_of_a_parabola() -> None:
    """A normal x has the variances 1 of x, and 2 of its square, which are not correlated."""
    assert variance(10.0, 1.0, 0.1) == pytest.approx(1.0**2 + 2.0 * 0.1**2)
    assert variance(10.0, -2.0, 0.0) == pytest.approx(4.0)
    assert variance(10.0, 0.0, 0.0) == 0.0


def test_variances_of_several_modes_add() -> None:
    """Each mode deviates on its own."""
    sides = np.array([[9.0], [10.5], [11.0], [9.5]])  # two smaller and two larger values
    expected = (2.0**2 + 1.0**2) / 12.0
    assert _variance(sides, np.array([10.0]))[0] == pytest.approx(expected)


@pytest.mark.parametrize(("share", "known"), [(0.039, True), (0.041, False)])
def test_share_of_the_second_order(share: float, known: bool) -> None:
    """A variance is known if the bend gives 4 % of what the slope gives, or less."""
    assert math.isfinite(variance(10.0, 1.0, math.sqrt(share / 2.0))) == known


@pytest.mark.parametrize(("share", "known"), [(0.249, True), (0.251, False)])
def test_share_of_the_value(share: float, known: bool) -> None:
    """A variance is known up to a quarter of the square of the value."""
    assert math.isfinite(variance(10.0, 10.0 * math.sqrt(share), 0.0)) == known
    # What the second order adds counts, too.
    slope, bend = 10.0 * math.sqrt(share - 0.005), 10.0 * math.sqrt(0.005 / 2.0)
    assert math.isfinite(variance(10.0, slope, bend)) == known


def hides(
    *, distance: float = 0.0, width: float = 1.0, share: float = 0.9, hertz: float = 10.0
) -> bool:
    """Return whether a mode hides a peak, for a deviation of 1 % of its frequency.

    Parameters
    ----------
    distance, width : float
        Of the excitation from the mode, and the half-power half-width, in standard deviations.
    share : float
        The response of the mode at its peak, over the present response.
    hertz : float
        Natural frequency, Hz.
    """
    natural, stddev = 2.0 * math.pi * hertz, 0.01
    omega = natural * math.sqrt(1.0 - 2.0 * stddev * distance)
    decay = 2.0 * natural * stddev * width
    above = np.array([[[[0.6]]], [[[0.8]]]])  # of magnitude 1
    size = (1.0 / (decay * omega * share)) ** 2
    poles = np.array([natural**2, 0.0, decay]).reshape(3, 1, 1, 1)
    found = _hides_a_peak(
        above, np.array([[size]]), poles, np.array([[omega]]), np.array([[[stddev]]])
    )
    return bool(found.all())


def test_limits_of_a_hidden_peak() -> None:
    """A mode within three deviations hides a peak, if it is narrower than two and strong enough."""
    assert hides()
    assert (hides(distance=2.99), hides(distance=3.01)) == (True, False)
    assert (hides(distance=-2.99), hides(distance=-3.01)) == (True, False)
    assert (hides(width=1.99), hides(width=2.01)) == (True, False)
    assert (hides(share=0.51), hides(share=0.49)) == (True, False)


def test_terms_have_the_poles_and_the_response_of_the_model() -> None:
    """With s = i omega they add up to the FRF of the model, but for what is above the band."""
    name = "three_point_linkage_on_tractor"
    mechanism = read_mechanism(config_file(f"{name}.yaml"))
    predictor = Predictor(load_table(config_file(f"tables/{name}.npz")))
    order = {"speed": "pto", "orders": [1], "force": [1.0], "at": "E1.z", "at_speed": 540.0}
    table = LevelTable(predictor, mechanism, excitations_from_mapping({"rotor": order}))
    angles = np.array([1.7, 2.2, 2.9])
    (k_real, k_imaginary, c), (a_real, a_imaginary, b), inputs = table.terms(angles)
    assert inputs.tolist() == [0]
    for i, angle in enumerate(angles.tolist()):
        solution = LinkageModel(mechanism).solve(angle)
        n = predictor.table.n_modes
        natural = np.sqrt(k_real[:n, i]) / (2.0 * math.pi)
        np.testing.assert_allclose(natural, solution.natural_frequencies[:n], rtol=1e-5)
        zeta = c[:n, i] / (2.0 * np.sqrt(k_real[:n, i]))
        np.testing.assert_allclose(zeta, solution.damping_ratios[:n], rtol=1e-4)
        hertz = solution.natural_frequencies[:n]
        s = 2j * math.pi * hertz[:, np.newaxis]
        k, a = k_real[:, i] + 1j * k_imaginary[:, i], a_real[:, 0, i] + 1j * a_imaginary[:, 0, i]
        found = ((a + s * b[:, 0, i]) / (k + c[:, i] * s + s**2)).sum(axis=1)
        exact = solution.frf([("E1", "z")], [("E1", "z")]).frf(hertz)[:, 0, 0]
        np.testing.assert_allclose(found, exact, atol=0.02 * np.abs(exact).max())


def test_missing_terms_have_no_effect() -> None:
    """A piece with two terms gets a third one, whose numerators are 0, for each of two inputs."""
    layout = _Layout(n_terms=3, n_inputs=2, n_modes=1)
    poles = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])  # k (both parts) and c of two terms
    above = np.arange(10.0, 22.0).reshape(3, 2, 2)  # of each term and input
    rest = np.arange(30.0, 38.0)
    rows = np.array([[*poles.ravel(), *above.ravel(), *rest]])
    wide_poles = np.pad(poles, ((0, 0), (0, 1)), constant_values=1.0)
    wide_above = np.pad(above, ((0, 0), (0, 1), (0, 0)))
    expected = [*wide_poles.ravel(), *wide_above.ravel(), *rest]
    assert _padded(rows, layout).tolist() == [expected]
    same = _Layout(n_terms=2, n_inputs=2, n_modes=1)
    assert _padded(rows, same).tolist() == rows.tolist()
