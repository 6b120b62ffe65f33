# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Implements by name over real DDS: parameter, topic, service, and what a restart remembers."""

from collections.abc import Callable
from pathlib import Path

import pytest
import rclpy.logging
import yaml
from mcap.reader import make_reader
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from linkage_vibration.bags.recorder import PROVENANCE_METADATA
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.prediction.answers import Implement, Implements
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.implements import read_implements
from linkage_vibration.ros.memory import Memory
from linkage_vibration_interfaces.srv import SetImplement
from test.support.ros_process import Peer, RunningNode, start_node, until

OWN = {"inertia": 300.0, "centre_of_gravity": [0.2, 1.0]}
IMPLEMENTS = {"plough": {"mass": 1200.0, **OWN}, "mower": {"mass": 500.0, **OWN}}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_from_start_to_restart(
    environment: dict[str, str], tmp_path: Path, meet: Callable[..., Peer], mechanism_file: Path
) -> None:
    """Topic and service choose; the last choice outlives the node, and logs name it."""
    path = tmp_path / "implements.yaml"
    path.write_text(yaml.safe_dump({"implements": IMPLEMENTS}))
    small = tmp_path / "small.yaml"
    small.write_text(small_linkage(mechanism_file))
    nodes: list[RunningNode] = []

    def begin() -> RunningNode:
        home = environment | {"ROS_HOME": str(tmp_path / "home")}
        files = {"mechanism_file": small, "implement_file": path, "log_directory": tmp_path}
        output = tmp_path / f"printed_{len(nodes)}.txt"
        nodes.append(start_node(output, home, name="hitched", record=True, **files))
        return nodes[-1]

    try:
        node = begin()
        node.wait_for("of three_point_linkage.")
        assert " % of the table is built." in node.printed
        peer = meet("hitched")
        own = peer.ask().natural_frequencies[0]
        latched = peer.node.create_publisher(String, "hitched_implement", LATCHED)
        latched.publish(String(data="drill"))
        peer.spin(lambda: "There is no implement 'drill'" in node.printed, "a warning")
        volatile = peer.node.create_publisher(String, "hitched_implement", 1)
        peer.spin(volatile.get_subscription_count, "a subscription")

        def publish() -> None:
            volatile.publish(String(data=" mower "))
            peer.pause(5.0, lambda: "with the implement mower from now on" in node.printed)

        until(lambda: "with the implement mower from now on" in node.printed, "it", publish)
        light = peer.ask().natural_frequencies[0]
        client = peer.node.create_client(SetImplement, "hitched/set_implement")
        answer = peer.request(client, SetImplement.Request(name="plough"))
        assert answer.success, answer.message
        assert peer.ask().natural_frequencies[0] < own < light
        assert node.stop() == 0
        again = begin()
        again.wait_for("used again: plough (delete ")
        again.wait_for("of three_point_linkage with the implement plough.")
        assert again.stop() == 0
    finally:
        for one in nodes:
            one.process.kill()
    logs = list(tmp_path.glob("*.mcap"))
    assert {in_use(log) for log in logs} == {
        ("", "", 800.0),
        ("plough", "plough", 1200.0),
        ("mower", "mower", 500.0),
    }


def small_linkage(file: Path) -> str:
    """Return the paper's linkage over a tenth of its stroke, whose table takes little time."""
    mapping = yaml.safe_load(file.read_text())
    mapping["input"]["range_deg"] = [112.0, 121.0]
    mapping["response"] |= {"band_hz": [0.0, 20.0], "modes": 1}
    for link in mapping["links"].values():
        link |= {"elements": 4, "modes": 1}
    return yaml.safe_dump(mapping, sort_keys=False)


def in_use(log: Path) -> tuple[str, str, float]:
    """Return the implement of a log in its metadata, its parameters, and by its mass."""
    with log.open("rb") as file:
        reader = make_reader(file)
        facts = next(m.metadata for m in reader.iter_metadata() if m.name == PROVENANCE_METADATA)
        attached = {a.name: a.data for a in reader.iter_attachments()}
    [section] = yaml.safe_load(attached["parameters.yaml"]).values()
    body = yaml.safe_load(attached["mechanism.yaml"])["rigid_bodies"]["implement"]
    return facts.get("implement", ""), section["ros__parameters"]["implement"], body["mass"]


@pytest.fixture
def implements(mechanism: Mechanism, mechanism_file: Path, tmp_path: Path) -> Implements:
    """Return the implements of a file."""
    path = tmp_path / "implements.yaml"
    path.write_text(yaml.safe_dump({"implements": IMPLEMENTS}))
    return Implements(mechanism, mechanism_file.read_text(), read_implements(path, mechanism))


def memory_in(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, implement: str = "", file: str = "i.yaml"
) -> Memory:
    """Return what a node remembers in a folder."""
    monkeypatch.setenv("ROS_HOME", str(folder))
    settings = Parameters(implement_file=file, implement=implement)
    return Memory("/farm/hitch", settings, rclpy.logging.get_logger("memory"))


def test_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, implements: Implements) -> None:
    """A name and properties are remembered; other parameters decide anew."""
    memory = memory_in(tmp_path, monkeypatch)
    assert memory.path == tmp_path / "linkage_vibration" / "farm.hitch.yaml"
    assert memory.recall(implements) is None
    memory.keep(implements.by_name["mower"])
    assert memory.recall(implements) == implements.by_name["mower"]
    unnamed = Implement("implement", 700.0, 150.0, (0.1, 0.9))
    memory.keep(unnamed)
    assert memory.recall(implements) == unnamed
    assert memory_in(tmp_path, monkeypatch, implement="plough").recall(implements) is None
    assert memory_in(tmp_path, monkeypatch, file="").recall(implements) is None
    assert [path.name for path in memory.path.parent.iterdir()] == ["farm.hitch.yaml"]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff\xfe",
        b"implement: [",
        b"{parameters: 3, implement: {name: mower}}",
        b"{parameters: {}, implement: 7}",
        b"{parameters: {mechanism_file: '', implement_file: i.yaml, implement: ''}}",
        b"{parameters: {mechanism_file: '', implement_file: i.yaml, implement: ''}, "
        b"implement: {name: gone, rigid_body: '', mass: 1, inertia: 3, centre_of_gravity: []}}",
        b"{parameters: {mechanism_file: '', implement_file: i.yaml, implement: ''}, "
        b"implement: {rigid_body: implement, mass: -1, inertia: 3, centre_of_gravity: [0, 0]}}",
        b"{parameters: {mechanism_file: '', implement_file: i.yaml, implement: ''}, "
        b"implement: {rigid_body: gone, mass: 1, inertia: 3, centre_of_gravity: [0, 0]}}",
    ],
)
def test_a_broken_memory_is_a_warning(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    implements: Implements,
    content: bytes,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """A damaged file is not used, and the warning names it once, with what is wrong."""
    memory = memory_in(tmp_path, monkeypatch)
    memory.path.parent.mkdir()
    memory.path.write_bytes(content)
    assert memory.recall(implements) is None
    printed = capfd.readouterr().err
    assert "The remembered implement is not used, but that of the parameters." in printed
    assert printed.count(str(memory.path)) == 1


def test_a_folder_that_cannot_be_written(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    implements: Implements,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """If the file cannot be written, a warning says so, and nothing else happens."""
    (tmp_path / "home").write_text("a file where a folder should be")
    memory = memory_in(tmp_path / "home", monkeypatch)
    memory.keep(implements.by_name["mower"])
    assert "will not be remembered over a restart" in capfd.readouterr().err
