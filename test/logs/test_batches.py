# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predictions by the thousand have the bytes of single ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from linkage_vibration.logs.batches import encode_predictions, predict_many
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages import encode_prediction
from linkage_vibration.prediction import Predictor
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.resources import DEFAULT_TABLE, config_file
from linkage_vibration.table import load_table
from linkage_vibration.tabulation import build_table

SHIPPED = Predictor(load_table(config_file(DEFAULT_TABLE)))
LOW, HIGH = SHIPPED.table.alpha3_range
SPECIAL = [LOW, HIGH, np.nextafter(LOW, 0), np.nextafter(HIGH, 9), *SHIPPED.table.alpha3.tolist()]
ANGLES = st.one_of(st.floats(LOW, HIGH), st.floats(), st.sampled_from(SPECIAL))
ROWS = st.tuples(
    ANGLES,
    st.one_of(st.just(0.0), st.floats(0.0, 1.0), st.just(float("nan"))),
    st.integers(-(2**31), 2**31 - 1),
    st.integers(0, 2**32 - 1),
)


def assert_same(
    predictor: Predictor, rows: list[tuple[float, float, int, int]], frame: str
) -> None:
    """Compare each row's bytes."""
    angles, stddevs, sec, nanosec = zip(*rows, strict=True)
    predictions = predict_many(predictor, np.array(angles, float), np.array(stddevs, float))
    stamps = np.array(sec, np.int32), np.array(nanosec, np.uint32)
    encoded = encode_predictions(predictions, *stamps, frame)
    for i, (angle, stddev, *stamp) in enumerate(rows):
        single = encode_prediction(predictor.predict(angle, stddev), *stamp, frame)
        assert encoded[i].tobytes() == single


@settings(max_examples=300)
@given(st.lists(ROWS, min_size=1, max_size=20), st.text(max_size=12))
def test_same_bytes(rows: list[tuple[float, float, int, int]], frame: str) -> None:
    """Any angle, in the range or not, gives the bytes that the node publishes."""
    assert_same(SHIPPED, rows, frame.replace("\x00", ""))


def test_same_bytes_at_many_angles() -> None:
    """So do a hundred thousand angles across every cell of the table."""
    rng = np.random.default_rng(1)
    angles = rng.uniform(LOW - 0.01, HIGH + 0.01, 100_000).tolist()
    assert_same(SHIPPED, [(angle, 1e-3, 1, 2) for angle in angles], "base_link")


@pytest.fixture(scope="module")
def turning() -> Predictor:
    """Return the predictor of a crank that turns all the way."""
    return Predictor(build_table(LinkageModel(read_mechanism(config_file("four_bar.yaml"))), 1e-3))


def test_same_bytes_of_a_crank_that_turns(turning: Predictor) -> None:
    """Angles of other turns are predicted for, too."""
    low, high = turning.table.alpha3_range
    angles = np.linspace(low - 20.0, high + 20.0, 500)
    assert_same(turning, [(float(angle), 0.0, 0, 0) for angle in angles], "")
