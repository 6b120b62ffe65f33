# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Does a recorded drive keep its limits? Run this file with pytest."""

from pathlib import Path

import linkage_vibration as lv

DRIVE = Path(__file__).parents[1] / "config" / "drives" / "hitch_duty_cycle.mcap"


def test_no_reading_is_missing(check_bag):
    """Every reading is within the table, and none is more than 50 ms after the one before."""
    check_bag(DRIVE, lv.Limits(statuses=(lv.Status.OK,), gap=0.05))


def test_loads_stay_below_the_limit():
    """No force in a pin or cylinder exceeds a third of the static force, as far as it is known.

    In this drive the ground is not known; without `known_share` the test would fail for that.
    """
    report = lv.check_bag(DRIVE, lv.Limits(load_ratio=0.33, known_share=0.0))
    assert report.passed, report
