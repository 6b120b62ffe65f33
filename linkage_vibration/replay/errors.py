# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What is raised where a replay cannot be done."""

from linkage_vibration.errors import LinkageVibrationError


class ReplayError(LinkageVibrationError):
    """A replay cannot be done as asked."""
