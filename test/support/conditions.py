# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A node that keeps its promises: idle, while a goal builds a table, and beside 1,000 readings/s.

The loads are processes of their own (`test.support.load`), which report what they really did; a
promise is only kept under a load that was there from its beginning to its end.
"""

import json
import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from test.support.ros_process import JOINT, Peer, RunningNode, until

IDLE, GOAL, KILOHERTZ = "idle", "during a goal", "beside 1 kHz"
CONDITIONS = (IDLE, GOAL, KILOHERTZ)
OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)
ROOT = Path(__file__).parents[2]
RATES = {IDLE: 50.0, GOAL: 50.0, KILOHERTZ: 1000.0}  # Hz, of readings that a test asks for
SPEED_RATE = 20.0  # Hz, of each speed
REALLY = 0.9  # share of 1,000 Hz that has to be published, and of the time that a goal has to run
FRESH = 1.0  # s, age of the last feedback by which a goal is known to run; it comes every 0.25 s
EARLY = 0.5  # finished share of a goal up to which a test begins
JOINT_STATE, SPEED = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"


def promise(place: str, **without: str) -> pytest.MarkDecorator:
    """Mark a test that shows a promise of a place, such as ``node.md#topics``.

    The first line of its docstring states the promise. `without` says why the test makes no sense
    in a condition, by ``goal`` and ``kilohertz``.
    """
    names = {"goal": GOAL, "kilohertz": KILOHERTZ}
    reasons = {names[condition]: reason for condition, reason in without.items()}
    return pytest.mark.promise(place, reasons)


class Load:
    """A process of `test.support.load`, and all that it has reported so far."""

    def __init__(self, environment: Mapping[str, str], *arguments: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "test.support.load", *arguments],
            cwd=ROOT,
            env={**environment, "PYTHONPATH": with_root(environment)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.reports: list[dict[str, Any]] = []
        self._number = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.reports.append(json.loads(line))

    def order(self, **topics: Any) -> None:
        """Let topics be published in another way, and wait until this is so."""
        assert self._process.stdin is not None
        self._number += 1
        self._process.stdin.write(json.dumps({"number": self._number, **topics}) + "\n")
        self._process.stdin.flush()
        self.wait_for(lambda report: report.get("number") == self._number)

    def wait_for(self, fits: Callable[[dict[str, Any]], bool]) -> None:
        """Return when a report fits, from the last one on."""
        first = max(len(self.reports) - 1, 0)
        until(
            lambda: any(map(fits, self.reports[first:])) or self._process.poll() is not None,
            "a report of the load",
        )
        assert self._process.poll() is None, "the load has ended"

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(20.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()


def with_root(environment: Mapping[str, str]) -> str:
    """Return a PYTHONPATH with this repository."""
    return ":".join(filter(None, [str(ROOT), environment.get("PYTHONPATH")]))


@dataclass
class Tractor:
    """Publishes what a tractor publishes at a rate, Hz, from a process of its own.

    In the condition with 1,000 Hz, readings that a test asks for come at that rate, too. `always`
    says whether healthy readings and speeds are also published while no test asks for any.
    """

    load: Load
    rate: float
    always: bool
    asked: set[str] = field(default_factory=set)
    topic: str = "joint_states"

    def publish(
        self,
        topic: str,
        kind: str,
        cycle: Sequence[Mapping[str, Any]],
        rate: float | None = None,
        stamp: float | None = None,
    ) -> None:
        """Publish messages with these fields in turn from now on, at `rate` by default."""
        rate = self.rate if rate is None else rate
        self.asked.add(topic)
        self.load.order(
            **{topic: {"type": kind, "cycle": list(cycle), "rate": rate, "stamp": stamp}}
        )

    def read(
        self,
        *angles: float,
        names: Sequence[str] = (JOINT,),
        stamp: float | None = 0.0,
        rate: float | None = None,
        **fields: Any,
    ) -> None:
        """Publish joint states with these angles in turn; a stamp of None is one of zero."""
        fields = {"header": {"frame_id": ""}, **fields}
        cycle = [{"name": list(names), "position": [a] * len(names), **fields} for a in angles]
        self.publish("joint_states", JOINT_STATE, cycle, rate, stamp)

    def healthy(self) -> None:
        """Publish readings of a hitch that hardly moves."""
        self.read(*(2.0 + 1e-4 * i for i in range(7)))

    def speed(self, **speeds: float) -> None:
        """Publish speeds at 20 Hz by the names of their inputs."""
        for name, value in speeds.items():
            self.publish(f"{name}_speed", SPEED, [{"data": value}], SPEED_RATE)

    def silence(self, *topics: str) -> None:
        """Publish nothing on some topics from now on."""
        for topic in topics:
            self.load.order(**{topic: self._nothing(topic)})
            self.asked.discard(topic)

    def _nothing(self, topic: str) -> dict[str, Any]:
        kind = {"joint_states": JOINT_STATE}.get(topic, SPEED)
        return {"type": kind, "cycle": [], "rate": 0.0, "stamp": None}

    def reset(self) -> None:
        """Return to what is published while no test asks for anything."""
        for topic in list(self.asked):
            if topic.endswith("_speed") or topic == "joint_states":
                self.silence(topic)
        if self.always:
            self.healthy()
            self.speed(engine=1500.0)
            self.asked.clear()


@dataclass
class Promised:
    """A node whose promises are tested in one condition, its statuses, and what sends it goals.

    `since` and `ended` are when the load has begun and when it has ended (monotonic).
    """

    condition: str
    name: str
    node: RunningNode
    peer: Peer
    tractor: Tractor
    goals: Load | None
    statuses: list[Any] = field(default_factory=list)
    since: float = 0.0
    ended: float = float("inf")
    clients: dict[str, Any] = field(default_factory=dict)
    listening: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Listen to the diagnostics, and wait for the load."""
        self.peer.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_status, 100)
        self.settle()
        self.since = time.monotonic()

    def _on_status(self, message: Any) -> None:
        self.statuses += [s for s in message.status if s.name.startswith(f"/{self.name}: ")]

    def settle(self) -> None:
        """Wait until the load is there, and a goal has just begun."""
        if self.goals is not None:
            until(lambda: 0.0 <= self._progress() <= EARLY, "feedback of a goal")
        elif self.condition == KILOHERTZ:
            self.tractor.load.wait_for(lambda report: report["published"].get(self.tractor.topic))

    def _progress(self) -> float:
        """Return the progress of the goal that runs; -1 without fresh feedback."""
        assert self.goals is not None
        last = (self.goals.reports or [{"event": "none"}])[-1]
        fresh = last["event"] == "progress" and time.monotonic() - last["time"] < FRESH
        return float(last["progress"]) if fresh else -1.0

    def check(self, began: float) -> None:
        """Fail unless the load was there between two moments (monotonic)."""
        began, ended = max(began, self.since), min(time.monotonic(), self.ended)
        if self.goals is not None:
            if self.ended == math.inf:  # A node that has ended gives no more feedback.
                until(lambda: self._progress() >= 0.0, "feedback of a goal at the end of the test")
            running = goal_time(self.goals.reports, began, ended)
            share = running / (ended - began)
            assert share >= REALLY, f"a goal ran for {100.0 * share:.0f} % of the time only"
        elif self.condition == KILOHERTZ:
            self.tractor.load.wait_for(lambda report: report["time"] > ended)
            rate = publishing_rate(self.tractor.load.reports, self.tractor.topic, began, ended)
            assert rate >= 1000.0 * REALLY, f"{rate:.0f} readings a second were published only"

    def ask(self, service: str, kind: Any, **fields: Any) -> Any:
        """Return the response of a service of the node, while the load is there."""
        return self.peer.request(self.client(service, kind), kind.Request(**fields))

    def client(self, service: str, kind: Any) -> Any:
        """Return a client of a service of the node."""
        if service not in self.clients:
            self.clients[service] = self.peer.node.create_client(kind, f"{self.name}/{service}")
        client = self.clients[service]
        self.peer.spin(client.service_is_ready, f"the service {service}")
        return client

    def wait_for_status(self, part: str, level: bytes, words: str) -> Any:
        """Return the next status of a part that has a level and words."""
        self.statuses.clear()

        def found() -> list[Any]:
            own = [s for s in self.statuses if s.name == f"/{self.name}: {part}"]
            return [s for s in own if s.level == level and words in s.message]

        self.peer.spin(found, f"{part}: {words}")
        return found()[0]

    def values(self) -> dict[str, str]:
        """Return the next numbers of the diagnostics."""
        status = self.next_status("predictions")
        return {value.key: value.value for value in status.values}

    def next_status(self, part: str) -> Any:
        """Return the next status of a part."""
        self.statuses.clear()

        def found() -> list[Any]:
            return [s for s in self.statuses if s.name == f"/{self.name}: {part}"]

        self.peer.spin(found, f"a status {part}")
        return found()[0]

    def listen(self, topic: str, kind: Any, qos: Any = 1000) -> list[Any]:
        """Return a list of the messages on a topic of the node from now to the end of a test."""
        received: list[Any] = []
        subscribe, topic = self.peer.node.create_subscription, f"{self.name}/{topic}"
        self.listening.append(subscribe(kind, topic, received.append, qos))
        return received

    def listen_no_more(self) -> None:
        """End what `listen` has begun, which would cost the node and the peer more in each test."""
        while self.listening:
            self.peer.node.destroy_subscription(self.listening.pop())

    def stop(self, *signals: Any) -> int:
        """End the node by a signal while the load is there, and return its exit code."""
        self.ended = time.monotonic()
        return self.node.stop(*signals)


def goal_time(reports: Sequence[Mapping[str, Any]], began: float, ended: float) -> float:
    """Return for how long goals ran between two moments, s."""
    total, accepted = 0.0, None
    for each in [*reports, {"event": "ended", "time": float("inf")}]:
        if each["event"] == "accepted":
            accepted = each["time"]
        elif each["event"] == "ended" and accepted is not None:
            total += max(min(each["time"], ended) - max(accepted, began), 0.0)
            accepted = None
    return total


def publishing_rate(
    reports: Sequence[Mapping[str, Any]], topic: str, began: float, ended: float
) -> float:
    """Return how many messages a second were published on a topic, by the reports around."""
    first = next((r for r in reversed(reports) if r["time"] < began), reports[0])
    last = next(r for r in reports if r["time"] > ended)
    count = last["published"].get(topic, 0) - first["published"].get(topic, 0)
    return float(count / (last["time"] - first["time"]))
