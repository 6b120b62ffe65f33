# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Where variances of levels are known: limits of the rules, with values found on paper."""

import math

import numpy as np
import pytest

from linkage_vibration.prediction.levels import _hides_a_peak, _variance


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
