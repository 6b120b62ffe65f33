# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes in processes of their own, and peers of them, on a ROS domain of this test run."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import count

import pytest

from linkage_vibration.demo.domain import reserve_domain
from test.support.ros_process import Peer, RunningNode, peer_of, start_node


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Set and return the environment in which nodes and peers find each other.

    Nodes run without OPENBLAS_NUM_THREADS, as on a machine where nobody has set it.
    """
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
    os.environ.setdefault("ROS_LOG_DIR", str(tmp_path_factory.mktemp("ros_log")))
    return {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}


@pytest.fixture(scope="session")
def domain(environment: dict[str, str]) -> int:
    """Return the ROS domain of this run."""
    return int(environment["ROS_DOMAIN_ID"])


@pytest.fixture(scope="module")
def start(
    environment: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., RunningNode]]:
    """Return a function that starts a node; every node ends with the tests of the module."""
    nodes: list[RunningNode] = []

    def begin(*arguments: str, **options: object) -> RunningNode:
        output = tmp_path_factory.mktemp("node") / "printed.txt"
        nodes.append(start_node(output, environment, *arguments, **options))  # type: ignore[arg-type]
        return nodes[-1]

    yield begin
    for node in nodes:
        if node.process.poll() is None:
            node.process.kill()
            node.process.wait()


@pytest.fixture(scope="module")
def meet(domain: int) -> Iterator[Callable[..., Peer]]:
    """Return a function that makes a peer of the node of a name."""
    numbers = count()
    with ExitStack() as stack:

        def find(name: str = "linkage_vibration") -> Peer:
            return stack.enter_context(peer_of(name, domain, next(numbers)))

        yield find
