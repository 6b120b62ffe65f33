# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Readings take precedence over services."""

import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import Any

import numpy as np
import pytest

from benchmark.latency.driver import Driver

FLOOD = [sys.executable, "-m", "benchmark.latency.flood", "/flooded"]
TARGET = 0.010  # s, of the 99th percentile
ROUNDS = 5  # other processes may disturb some of them


@pytest.mark.nightly(alone="whether it holds depends on what else the machine does")
def test_readings_take_precedence_over_services(
    start: Callable[..., Any], environment: dict[str, str]
) -> None:
    """While two clients flood the services, 99 % of the readings at 1 kHz take 10 ms or less."""
    node = start("-r", "joint_states:=/flooded/joint_states", name="flooded")
    path = os.pathsep.join([os.getcwd(), environment.get("PYTHONPATH", "")])
    with closing(Driver()) as driver, ExitStack() as stack:
        driver.meet("flooded")
        calm = driver.run("flooded", node.process.pid, 1000.0, 1000)
        if np.percentile(calm.latencies, 99.0) > TARGET:
            pytest.skip("other processes keep this machine too busy for 1000 readings a second")
        for _ in range(2):
            flood = subprocess.Popen(
                FLOOD, env={**environment, "PYTHONPATH": path}, stdout=subprocess.PIPE
            )
            stack.callback(flood.wait)
            stack.callback(flood.kill)
            assert flood.stdout is not None
            assert flood.stdout.readline() == b"flooding\n"
        flooded = [driver.run("flooded", node.process.pid, 1000.0, 1000) for _ in range(ROUNDS)]
    assert calm.lost == 0
    assert not any(run.lost for run in flooded)
    assert min(np.percentile(run.latencies, 99.0) for run in flooded) <= TARGET
    assert node.stop() == 0
