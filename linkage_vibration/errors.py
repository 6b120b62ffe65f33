# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The base of every error that this package raises on purpose."""


class LinkageVibrationError(Exception):
    """What went wrong, where, and how to mend it, in one sentence fit to show a person.

    Command lines and nodes catch this class and print its text; any other exception is a defect.
    """
