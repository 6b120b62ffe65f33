# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a load has done is read from its reports."""

import pytest

from test.support.conditions import goal_time, publishing_rate

GOALS = [
    {"time": 1.0, "event": "accepted"},
    {"time": 1.5, "event": "progress", "progress": 0.2},
    {"time": 4.0, "event": "ended"},
    {"time": 5.0, "event": "accepted"},
]


@pytest.mark.parametrize(
    ("began", "ended", "running"),
    [(0.0, 0.9, 0.0), (0.0, 2.0, 1.0), (2.0, 3.0, 1.0), (3.0, 6.0, 2.0), (4.2, 4.8, 0.0)],
)
def test_time_of_goals(began: float, ended: float, running: float) -> None:
    """A goal runs from its acceptance to its end, or until now."""
    assert goal_time(GOALS, began, ended) == pytest.approx(running)
    assert goal_time([], began, ended) == 0.0


def test_rate_of_readings() -> None:
    """The rate is that between the reports around a test; before the first reading it is zero."""
    reports = [{"time": float(i), "published": {"a": 500 * i} if i else {}} for i in range(4)]
    assert publishing_rate(reports, "a", 1.2, 2.5) == pytest.approx(500.0)
    assert publishing_rate(reports, "a", -1.0, 0.5) == pytest.approx(500.0)
    assert publishing_rate(reports, "b", 0.5, 2.5) == 0.0
