# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Lets readings take precedence over services: a thread that has served a request rests."""

import time

RESTING = 9.0  # times the processor time of the work, so that services take a tenth of a core
LONGEST_REST = 0.1  # s


def rest(worked: float) -> None:
    """Leave the processor and Python's lock to the readings after work of so many seconds."""
    time.sleep(min(RESTING * worked, LONGEST_REST))
