# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The choice of a ROS domain."""

import socket
import subprocess
import sys

import pytest

from linkage_vibration.demo import domain as module
from linkage_vibration.demo.domain import DomainError, reserve_domain


def test_domain_in_use_is_avoided(monkeypatch: pytest.MonkeyPatch) -> None:
    """A domain is not chosen twice, nor if something listens on its port."""
    first = reserve_domain()
    assert reserve_domain() != first
    probe = "from linkage_vibration.demo.domain import reserve_domain as r; print(r())"
    command = [sys.executable, "-c", f"{probe}; print(r())"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    second, third = map(int, printed.split())
    assert first not in (second, third)
    monkeypatch.setattr(module, "DOMAINS", [second])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 7400 + 250 * second))
        with pytest.raises(DomainError, match="are all in use; set ROS_DOMAIN_ID"):
            reserve_domain()
    assert reserve_domain() == second  # its process has ended
