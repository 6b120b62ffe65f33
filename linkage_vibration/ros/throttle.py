# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings that are not repeated too often."""

import time

from rclpy.impl.rcutils_logger import RcutilsLogger

WARN_PERIOD = 5.0  # s, between two warnings about the same subject


class Throttle:
    """Logs warnings, at most one in WARN_PERIOD about each subject.

    The throttle of rclpy takes longer to suppress a message than a whole prediction takes.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._next: dict[str, float] = {}

    def warn(self, subject: str, text: str) -> None:
        """Log a warning, unless there was one about the same subject just before.

        Parameters
        ----------
        subject : str
            Identifies warnings that replace each other.
        text : str
            The warning.
        """
        now = time.monotonic()
        if now >= self._next.get(subject, 0.0):
            self._next[subject] = now + WARN_PERIOD
            self._logger.warning(text)
