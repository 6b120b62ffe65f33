# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The predictor: numbers inside the range, a status for every other float."""

import math
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction import Predictor, Status
from linkage_vibration.resources import config_file
from linkage_vibration.table import load_table


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """Return a predictor on the shipped table."""
    return Predictor(load_table(config_file("tables/three_point_linkage.npz")))


@given(st.floats(math.pi / 2, math.pi))
def test_predictions_are_the_models(
    predictor: Predictor, model: LinkageModel, alpha3: float
) -> None:
    """Anywhere in the stroke frequencies come within 5e-7, the peak within 1e-6 of the model."""
    prediction, exact = predictor.predict(alpha3), model.solve(alpha3)
    assert prediction.status is Status.OK
    np.testing.assert_allclose(
        prediction.natural_frequencies, exact.natural_frequencies[:3], rtol=5e-7
    )
    np.testing.assert_allclose(prediction.damping_ratios, exact.damping_ratios[:3], rtol=5e-6)
    assert prediction.frf_peak_frequency == pytest.approx(
        exact.peak((0.0, 200.0)).frequency, rel=1e-6
    )
    assert prediction.frf_peak_magnitude == pytest.approx(
        exact.peak((0.0, 200.0)).magnitude, rel=1e-6
    )
    assert 0.0 < prediction.interpolation_error < 5e-7


@given(st.floats())
def test_any_float_is_answered(predictor: Predictor, alpha3: float) -> None:
    """No float raises; numbers come with OK only, and are finite then."""
    prediction = predictor.predict(alpha3)
    numbers = [
        *prediction.natural_frequencies,
        *prediction.damping_ratios,
        prediction.frf_peak_frequency,
        prediction.frf_peak_magnitude,
        prediction.interpolation_error,
    ]
    assert len(numbers) == 9
    good = prediction.status is Status.OK
    assert good == (math.pi / 2 <= alpha3 <= math.pi)
    assert all(math.isfinite(number) == good for number in numbers)
    assert prediction.table_id == predictor.table.table_id


def test_the_ends_belong_to_the_range(predictor: Predictor) -> None:
    """The end points are answered, one bit outside is out of range, and no number is one."""
    low, high = predictor.table.alpha3_range
    assert predictor.predict(low).status is Status.OK
    assert predictor.predict(high).status is Status.OK
    assert predictor.predict(math.nextafter(low, 0.0)).status is Status.OUT_OF_RANGE
    assert predictor.predict(math.nextafter(high, 9.0)).status is Status.OUT_OF_RANGE
    assert predictor.predict(sys.float_info.max).status is Status.OUT_OF_RANGE
    for invalid in (math.nan, math.inf, -math.inf):
        assert predictor.predict(invalid).status is Status.INVALID_ANGLE


def test_predictions_do_not_share_numbers(predictor: Predictor) -> None:
    """A later prediction leaves an earlier one as it was."""
    first = predictor.predict(2.0)
    before = first.natural_frequencies.copy()
    predictor.predict(3.0)
    np.testing.assert_array_equal(first.natural_frequencies, before)
