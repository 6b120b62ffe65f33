# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses a ROS domain that nothing else on this machine uses."""

import fcntl
import os
import socket
import tempfile
from pathlib import Path

from linkage_vibration.errors import LinkageVibrationError

DOMAINS = range(1, 102)  # the ports of higher ones overlap with those that Linux gives to clients


class DomainError(LinkageVibrationError):
    """No ROS domain is free."""


def reserve_domain() -> int:
    """Return a free ROS domain, which no other caller gets while this process runs."""
    for offset in range(len(DOMAINS)):
        domain = DOMAINS[(os.getpid() + offset) % len(DOMAINS)]
        lock = Path(tempfile.gettempdir()) / f"linkage_vibration_domain_{domain}.lock"
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                # DDS-RTPS 9.6.2.3: the participants of a domain listen on this port.
                probe.bind(("", 7400 + 250 * domain))
            descriptor = os.open(lock, os.O_CREAT | os.O_RDWR, 0o666)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                os.close(descriptor)
                raise
        except OSError:
            continue
        # The file stays open, and so locked, until the process ends.
        return domain
    first, last = DOMAINS[0], DOMAINS[-1]
    raise DomainError(f"ROS domains {first} to {last} are all in use; set ROS_DOMAIN_ID yourself.")
