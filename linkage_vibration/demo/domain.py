# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses a ROS domain that nothing else on this machine uses."""

import os
import socket
from contextlib import suppress

from linkage_vibration.errors import LinkageVibrationError

DOMAINS = range(1, 102)  # the ports of higher ones overlap with those that Linux gives to clients


class DomainError(LinkageVibrationError):
    """No ROS domain is free."""


def reserve_domain() -> int:
    """Return a free ROS domain, which no other caller gets while this process runs."""
    for offset in range(len(DOMAINS)):
        domain = DOMAINS[(os.getpid() + offset) % len(DOMAINS)]
        with (
            suppress(OSError),
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe,
            socket.socket(socket.AF_UNIX) as lock,
        ):
            # DDS-RTPS 9.6.2.3: the participants of a domain listen on this port.
            probe.bind(("", 7400 + 250 * domain))
            lock.bind(f"\0linkage_vibration_domain_{domain}")  # a name that is not a file
            lock.detach()  # It stays open, and so keeps the name, until the process ends.
            return domain
    first, last = DOMAINS[0], DOMAINS[-1]
    raise DomainError(f"ROS domains {first} to {last} are all in use; set ROS_DOMAIN_ID yourself.")
