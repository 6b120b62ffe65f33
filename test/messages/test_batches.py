# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Many predictions and resonances at once have the same bytes as one at a time."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linkage_vibration.messages.encoding import encode_columns, encode_message
from linkage_vibration.messages.topics import ASSESSED, PREDICTION
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Predictor, predict_many
from linkage_vibration.prediction.resonance import ReportedSpeed, ResonanceMonitor
from linkage_vibration.prediction.severity import WarningLimits
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.support.resources import DEFAULT_EXCITATIONS, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.served import turning_table

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
    """Compare the bytes of each row."""
    angles, stddevs, sec, nanosec = zip(*rows, strict=True)
    predictions = predict_many(predictor, np.array(angles, float), np.array(stddevs, float))
    stamps = np.array(sec, np.int32), np.array(nanosec, np.uint32)
    [(_, encoded)] = encode_columns(PREDICTION, predictions, *stamps, frame)
    for i, (angle, stddev, *stamp) in enumerate(rows):
        single = encode_message(PREDICTION, predictor.predict(angle, stddev), *stamp, frame)  # type: ignore[call-arg]
        assert encoded[i].tobytes() == single


@given(st.lists(ROWS, min_size=1, max_size=20), st.text(max_size=12))
def test_same_bytes(rows: list[tuple[float, float, int, int]], frame: str) -> None:
    """Any angle, in the range or outside, gives the bytes that the node publishes."""
    assert_same(SHIPPED, rows, frame.replace("\x00", ""))


def test_same_bytes_at_many_angles() -> None:
    """Twenty thousand angles across every cell of the table do so, too."""
    rng = np.random.default_rng(1)
    angles = rng.uniform(LOW - 0.01, HIGH + 0.01, 20_000).tolist()
    assert_same(SHIPPED, [(angle, 1e-3, 1, 2) for angle in angles], "base_link")


@pytest.fixture(scope="module")
def turning() -> Predictor:
    """Return the predictor of a crank that turns all the way."""
    return Predictor(turning_table())


@pytest.mark.nightly(short="test_same_bytes")
def test_same_bytes_of_a_crank_that_turns(turning: Predictor) -> None:
    """Angles of other turns give predictions, too."""
    low, high = turning.table.alpha3_range
    angles = np.linspace(low - 20.0, high + 20.0, 500)
    assert_same(turning, [(float(angle), 0.0, 0, 0) for angle in angles], "")


EXCITATIONS = read_excitations(config_file(DEFAULT_EXCITATIONS))
SECOND = 10**9  # ns
Reported = tuple[Source, float, int]  # speed, time (ns)
Asked = tuple[float, float, int]  # angle, velocity, time (ns)
ODD = [math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, 1e300]
TIMES = st.one_of(
    st.integers(0, 4 * SECOND),
    st.sampled_from([0, 10**6, SECOND - 1, SECOND, SECOND + 1, 2**63 - 1]),
)
SPEEDS = st.tuples(
    st.sampled_from(Source), st.one_of(st.floats(0.0, 3000.0), st.sampled_from(ODD)), TIMES
)
READINGS = st.tuples(ANGLES, st.one_of(st.floats(-1.0, 1.0), st.sampled_from(ODD)), TIMES)


def assert_same_resonances(
    monitors: Sequence[ResonanceMonitor],
    events: Sequence[Reported | Asked],
    predictor: Predictor = SHIPPED,
) -> list[int]:
    """Let one monitor answer one by one and another at once; return the states if bytes agree."""
    asked, reported, expected = [], [], []
    for event in events:
        first, value, time = event
        if isinstance(first, Source):
            monitors[0].set_speed(first, value, time)
            reported.append(ReportedSpeed(len(asked), first, value, time))
        else:
            asked.append(event)
            resonance = monitors[0].assess(predictor.predict(first), value, time)
            header = -len(asked), time % SECOND, "base_link"
            expected.append([encode_message(kind, resonance, *header) for kind in ASSESSED])
    angle, velocity, times = np.array(asked, object).reshape(-1, 3).T
    predictions = predict_many(predictor, angle.astype(float), np.zeros(len(asked)))
    resonances = monitors[1].assess_many(
        predictions, velocity.astype(float), times.astype(np.int64), reported, np.zeros(len(asked))
    )
    stamps = -1 - np.arange(len(asked), dtype=np.int32), (times % SECOND).astype(np.uint32)
    actual: list[list[bytes]] = [[] for _ in asked]
    for kind in ASSESSED:
        for which, rows in encode_columns(kind, resonances, *stamps, "base_link"):
            for i, row in zip(which, rows, strict=True):
                actual[i].append(row.tobytes())
    assert actual == expected
    return resonances.state.tolist()


@given(
    st.lists(st.lists(st.one_of(SPEEDS, READINGS), max_size=12), min_size=1, max_size=3),
    st.sampled_from([(0.1, 0.02, 1.0), (0.3, 0.3, 0.5), (1e300, 0.0, 1e300), (0.1, 0.02, 1e-9)]),
    st.booleans(),
)
def test_same_bytes_of_resonances(
    blocks: list[list[Reported | Asked]], limits: tuple[float, float, float], fixed: bool
) -> None:
    """Any speeds among any readings, block after block, give the bytes that the node publishes."""
    margins, stale_after = WarningLimits(near=limits[0], dwell=limits[1]), limits[2]
    monitors = [ResonanceMonitor(EXCITATIONS, margins, stale_after) for _ in range(2)]
    for monitor in monitors:
        if fixed:
            monitor.set_fixed(Source.PTO, 540.0)
    for events in blocks:
        assert_same_resonances(monitors, events)
