# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a running node says about its log: faults that last and end, and logs that it deletes."""

import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from mcap.reader import make_reader
from std_srvs.srv import Trigger

from linkage_vibration.prediction.predictor import Status
from test.support.ros_process import JOINT, Peer, RunningNode, peer_of, until

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


@dataclass
class Watched:
    """A node with a log, and what it says about it."""

    process: RunningNode
    peer: Peer
    name: str
    status: dict[str, Any] = field(default_factory=dict)  # the last one of each part
    stamp: int = 0  # of the last diagnostics, ns

    def __post_init__(self) -> None:
        """Subscribe to the diagnostics."""
        self.clients = {
            word: self.peer.node.create_client(Trigger, f"{self.name}/{word}_recording")
            for word in ("start", "stop")
        }
        self.peer.node.create_subscription(DiagnosticArray, "/diagnostics", self._keep, 10)

    def _keep(self, message: Any) -> None:
        own = {s.name: s for s in message.status if s.name.startswith(f"/{self.name}: ")}
        self.status |= {name.split(": ")[1]: status for name, status in own.items()}
        if own:
            self.stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec

    def call(self, word: str) -> Any:
        """Start or stop the recording."""
        return self.peer.request(self.clients[word], Trigger.Request())

    def speak(self) -> None:
        """Publish readings for a moment."""
        for _ in range(4):
            self.peer.publish([JOINT], [2.0])
            self.peer.pause(0.02)

    def wait_for(self, level: bytes, words: str) -> None:
        """Wait for a status of the log that was made after this call."""
        after = time.time_ns()

        def arrives() -> bool:
            own = self.status.get("log")
            new = self.stamp > after
            return bool(new and own and own.level == level and re.search(words, own.message))

        until(arrives, f"the status {words!r} of the log; last: {self.status}", self.speak)

    def stays(self, level: bytes, seconds: int = 2) -> None:
        """Check the level of the log's status in each of some seconds."""
        for _ in range(seconds):
            before = self.stamp
            until(lambda: self.stamp > before, "diagnostics", self.speak)  # noqa: B023
            assert self.status["log"].level == level, self.status["log"]

    def value(self, key: str) -> str:
        """Return one of the values about the log."""
        values: list[Any] = self.status["predictions"].values
        return next(str(value.value) for value in values if value.key == key)


@pytest.fixture
def watch(start: Callable[..., Any], domain: int) -> Iterator[Callable[..., Any]]:
    """Return a function that starts a node with parameters; it ends the one before, if any."""
    with ExitStack() as stack:

        def begin(name: str, **parameters: Any) -> Watched:
            stack.close()
            process = start(name=name, **parameters)
            stack.callback(process.stop)
            return Watched(process, stack.enter_context(peer_of(name, domain)), name)

        yield begin


def count(path: Path) -> int:
    """Return the number of messages of a complete log, by the library mcap."""
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())


def test_fault_lasts_as_long_as_its_cause(watch: Callable[..., Watched], tmp_path: Path) -> None:
    """A lost folder is an ERROR until it is there again; what is missing is a WARN until a stop."""
    folder = tmp_path / "logs"
    folder.mkdir()
    node = watch("lost", record=True, log_directory=folder)
    node.wait_for(OK, f"Recording to {folder}")
    shutil.rmtree(folder)
    node.wait_for(ERROR, "was removed during the recording")
    node.stays(ERROR)
    assert node.process.printed.count("was removed during the recording") == 1
    folder.mkdir()
    node.wait_for(WARN, "[0-9]+ messages are missing in the log")
    node.stays(WARN)
    dropped = int(node.value("log messages dropped"))
    assert dropped > 0
    ended = node.call("stop")
    assert ended.success
    node.wait_for(OK, "No log is recorded")
    assert count(Path(ended.message)) > 0
    assert node.call("start").success
    node.wait_for(OK, "Recording to")


@pytest.mark.nightly(short="test_fault_lasts_as_long_as_its_cause")
def test_stopping_ends_a_fault(watch: Callable[..., Watched], tmp_path: Path) -> None:
    """While the folder is lost, a stop ends the fault, a start that fails begins one again."""
    folder = tmp_path / "logs"
    folder.mkdir()
    node = watch("given_up", record=True, log_directory=folder)
    shutil.rmtree(folder)
    node.wait_for(ERROR, "was removed during the recording")
    ended = node.call("stop")
    assert not ended.success
    assert re.fullmatch(f"{folder}/.* was removed while it was being recorded.", ended.message)
    node.wait_for(OK, "No log is recorded")
    node.stays(OK)
    refused = node.call("stop")
    assert not refused.success
    assert "Nothing is being recorded" in refused.message
    assert not node.call("start").success
    node.wait_for(ERROR, "cannot be created: No such file")
    node.stays(ERROR)
    assert node.call("stop").success
    node.wait_for(OK, "No log is recorded")
    assert not node.call("start").success
    node.wait_for(ERROR, "cannot be created: No such file")
    folder.mkdir()
    begun = node.call("start")
    assert begun.success
    node.wait_for(OK, f"Recording to {begun.message}")
    again = node.call("start")
    assert "recorded already" in again.message
    node.stays(OK)
    ended = node.call("stop")
    assert (ended.success, ended.message) == (True, begun.message)
    assert count(Path(ended.message)) > 0


def test_full_folder_does_not_keep_the_node_from_predicting(
    watch: Callable[..., Watched], tmp_path: Path
) -> None:
    """With `record` and a folder at its limit, the node predicts, and the log is a fault."""
    old = tmp_path / "linkage_vibration_20991231-000000.mcap"
    old.write_bytes(bytes(24_000_000))
    node = watch("full", record=True, log_directory=tmp_path, disk_limit=24_000_000)
    node.wait_for(ERROR, "Nothing more is recorded, as the logs in .* have reached disk_limit")
    node.stays(ERROR)
    assert node.peer.ask([JOINT], [2.0]).status == Status.OK
    old.unlink()
    assert node.call("start").success
    node.wait_for(OK, "Recording to")


def test_full_disk_does_not_keep_the_node_from_predicting(
    watch: Callable[..., Watched], small_disk: Path
) -> None:
    """With `record` and a full disk, the node predicts, and records when there is room.

    A stop before that says why there is no log.
    """
    filler = small_disk / "filler"
    for name in ("given_up", "patient"):
        filler.write_bytes(bytes(4_100_000))
        node = watch(name, record=True, log_directory=small_disk)
        node.wait_for(ERROR, "could not be written any further: No space left on device")
        node.stays(ERROR)
        assert node.process.printed.count("No space left on device") == 1
        assert node.peer.ask([JOINT], [2.0]).status == Status.OK
        if name == "given_up":
            refused = node.call("stop")
            assert not refused.success
            assert "No space left on device" in refused.message
            node.wait_for(OK, "No log is recorded")
        filler.unlink()
    node.wait_for(OK, "Recording to")
    ended = node.call("stop")
    assert ended.success
    assert count(Path(ended.message)) > 0


@pytest.mark.nightly(short="test_full_folder_does_not_keep_the_node_from_predicting")
def test_deleted_logs_are_reported(watch: Callable[..., Watched], tmp_path: Path) -> None:
    """Logs that a clock has dated four days later go first; each is logged, and all are counted."""
    late = time.time() + 4 * 86_400
    old = [tmp_path / f"linkage_vibration_20991231-00000{k}.mcap" for k in range(4)]
    for path in old:
        path.write_bytes(bytes(8_000_000))
        os.utime(path, (late, late))
    limits = {"disk_limit": 24_000_000, "delete_oldest": True, "compression": "none"}
    node = watch("tidy", record=True, log_directory=tmp_path, **limits)
    node.wait_for(OK, "Recording to")
    for path in old:
        expected = f"{path}, the oldest log, was deleted, as disk_limit has been reached."
        assert (expected in node.process.printed) != path.exists()
    gone = [path for path in old if not path.exists()]
    # 32 MB are there, and a file of 6 MB needs room below 24 MB: two of 8 MB go.
    assert gone == old[:2]
    assert node.value("log files deleted") == "2"
    own = Path(node.call("stop").message)
    assert re.fullmatch(r"linkage_vibration_000001_\d{8}-\d{6}\.mcap", own.name)
    assert count(own) > 0
