# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings that do not flood."""

import time

from rclpy.impl.rcutils_logger import RcutilsLogger

WARN_PERIOD = 5.0  # s, between warnings about the same thing


class Throttle:
    """Warns, but not again about the same thing within WARN_PERIOD.

    rclpy's own throttle takes longer to keep silent than a whole prediction takes.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._next: dict[str, float] = {}

    def warn(self, about: str, text: str) -> None:
        """Warn of something; ``about`` tells what is the same thing."""
        now = time.monotonic()
        if now >= self._next.get(about, 0.0):
            self._next[about] = now + WARN_PERIOD
            self._logger.warning(text)
