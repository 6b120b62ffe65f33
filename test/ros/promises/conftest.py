# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Runs each promise three times: idle, while a goal builds a table, and beside 1,000 readings/s."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from test.support.conditions import CONDITIONS, GOAL, KILOHERTZ, RATES, Load, Promised, Tractor
from test.support.ros_process import peer_of, start_node

# Each condition takes minutes, so that two of them are tested with the nightly set.
NIGHTLY = [pytest.param(each, marks=pytest.mark.nightly) for each in CONDITIONS[1:]]


@pytest.fixture(scope="module", params=[CONDITIONS[0], *NIGHTLY])
def condition(request: pytest.FixtureRequest) -> str:
    """Return what the nodes of a module work beside."""
    return str(request.param)


@pytest.fixture(scope="module")
def variables(environment: dict[str, str]) -> dict[str, str]:
    """Return the environment of the nodes and the loads of a module."""
    return environment


@pytest.fixture(scope="module")
def tractor(condition: str, variables: dict[str, str]) -> Iterator[Tractor]:
    """Return a tractor, which always publishes readings in one of the conditions."""
    load = Load(variables, "topics")
    yield Tractor(load, RATES[condition], always=condition == KILOHERTZ)
    load.close()


@pytest.fixture(scope="module")
def begun(condition: str) -> list[Promised]:
    """Return the nodes of a module in a condition."""
    return []


@pytest.fixture(scope="module")
def begin(
    condition: str,
    tractor: Tractor,
    variables: dict[str, str],
    tmp_path_factory: pytest.TempPathFactory,
    domain: int,
    begun: list[Promised],
) -> Iterator[Callable[..., Promised]]:
    """Return a function that starts a node and its load, which end with the condition."""
    with ExitStack() as stack:

        def start_one(
            name: str, *arguments: str, reads: bool = True, **parameters: Any
        ) -> Promised:
            output = tmp_path_factory.mktemp("node") / "printed.txt"
            node = start_node(output, variables, *arguments, name=name, **parameters)
            stack.callback(node.stop, signal.SIGKILL)
            number = 100 * CONDITIONS.index(condition) + len(begun)
            peer = stack.enter_context(peer_of(name, domain, number, own=True, reads=reads))
            if not begun:  # they meet in peace
                tractor.reset()
            goals = Load(variables, "goals", name) if condition == GOAL else None
            if goals is not None:
                stack.callback(goals.close)
            begun.append(Promised(condition, name, node, peer, tractor, goals))
            return begun[-1]

        yield start_one
        for each in begun:
            each.node.stop()


def pytest_runtest_setup(item: pytest.Function) -> None:
    """Skip a promise that makes no sense in a condition, before a node is started for it."""
    [marker] = item.iter_markers("promise")
    condition = item.callspec.params["condition"]
    if reason := marker.args[1].get(condition):
        pytest.skip(f"{condition}: {reason}")


@pytest.fixture(autouse=True)
def beside(condition: str, tractor: Tractor, begun: list[Promised]) -> Iterator[None]:
    """Let a test begin under its load, and fail it if the load was not there until its end."""
    for each in begun:
        if each.ended == float("inf"):
            each.settle()
    began = time.monotonic()
    yield
    for each in begun:
        if each.ended > began:
            each.check(began)
        each.listen_no_more()
    tractor.reset()
