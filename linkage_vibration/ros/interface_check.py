# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Checks that the installed messages are those that this package encodes."""

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.definitions import OWN_PACKAGE, differing_types
from linkage_vibration.support.version import VERSION


class InterfaceError(LinkageVibrationError):
    """The installed package of messages has another version than this package."""


def check_interfaces() -> None:
    """Raise an `InterfaceError` if installed messages, services or actions are not ours."""
    if different := differing_types():
        raise InterfaceError(
            f"The installed {', '.join(different)} differs, so {OWN_PACKAGE} has another version "
            f"than linkage_vibration {VERSION}; install {OWN_PACKAGE} {VERSION}, or rebuild the "
            "workspace."
        )
