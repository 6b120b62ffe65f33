# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings that come again and again."""

import time
from unittest.mock import Mock

import pytest

from linkage_vibration.ros.endpoints import LONGEST_REST, WARN_PERIOD, Throttle, rest


@pytest.mark.parametrize(("later", "lines"), [(0.99 * WARN_PERIOD, 1), (1.01 * WARN_PERIOD, 2)])
def test_problem_that_comes_and_goes(
    monkeypatch: pytest.MonkeyPatch, later: float, lines: int
) -> None:
    """A problem is logged once while it lasts, and not again within the period of warnings."""
    logger, now = Mock(), [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    throttle = Throttle(logger)
    for _ in range(3):
        throttle.report("hitch", "There is no number.")
    for _ in range(3):
        now[0] += later / 3.0
        throttle.report("hitch", "")
        throttle.report("hitch", "There is no number.")
    assert logger.warning.call_count == lines


def test_problem_that_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A problem is logged once, however long it lasts."""
    logger, now = Mock(), [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    throttle = Throttle(logger)
    for _ in range(3):
        throttle.report("hitch", "There is no number.")
        now[0] += 2.0 * WARN_PERIOD
    assert logger.warning.call_count == 1


def test_rest_leaves_nine_tenths_of_a_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work takes a tenth of the time with the rest that follows, which is never long."""
    rests = list[float]()
    monkeypatch.setattr(time, "sleep", rests.append)
    for worked in (1e-3, 5.0):
        rest(worked)
    assert 1e-3 / (1e-3 + rests[0]) == pytest.approx(0.1)
    assert rests[1] == LONGEST_REST
