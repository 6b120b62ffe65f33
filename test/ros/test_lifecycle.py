# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's lifecycle: its transitions over real DDS, their costs, and their errors."""

import ctypes
import gc
import os
import shutil
import subprocess
import sys
import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from test.support.ros_process import JOINT, LIMIT, SENSOR, own_context, response, until

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


@pytest.fixture
def managed(environment: dict[str, str]) -> Iterator[Callable[..., Any]]:
    """Return a function that makes a node in this process, which waits for a manager."""
    from linkage_vibration.ros.lifecycle import LinkageVibrationNode

    nodes: list[Any] = []

    def make(*arguments: str) -> Any:
        rclpy.init(
            # Not the default name: rclpy leaves part of a lifecycle node in the graph.
            args=["--ros-args", "-r", "__node:=here", "-p", "autostart:=false", *arguments],
            signal_handler_options=SignalHandlerOptions.NO,
        )
        nodes.append(LinkageVibrationNode())
        return nodes[-1]

    yield make
    for node in nodes:
        node.close()
    rclpy.try_shutdown()


@pytest.fixture
def manager(domain: int) -> Iterator[tuple[Any, SingleThreadedExecutor]]:
    """Return another node and its executor."""
    with own_context(domain) as context:
        peer = rclpy.create_node("manager", context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(peer)
        yield peer, executor
        executor.shutdown()
        peer.destroy_node()


def open_files() -> int:
    """Return how many files and sockets this process has open."""
    return len(os.listdir("/proc/self/fd"))


def resident() -> int:
    """Return how many bytes of this process are in use in memory.

    Freed memory that the C library keeps for later is returned first; it is no leak.
    """
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def own_objects() -> Counter[str]:
    """Return how many objects of this package exist, by class."""
    gc.collect()
    kinds = (type(each) for each in gc.get_objects())
    return Counter(
        kind.__qualname__ for kind in kinds if str(kind.__module__).startswith("linkage_vibration.")
    )


def entities(node: Any) -> dict[str, int]:
    """Return how many entities of each kind a node has, with those of its readings' node."""
    kinds = ("publishers", "subscriptions", "services", "clients", "timers", "guards", "waitables")
    both = node, node._listener._node
    return {kind: sum(len(list(getattr(each, kind))) for each in both) for kind in kinds}


def test_levels_are_ready_before_the_first_reading(
    managed: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The transition to inactive computes all levels, while nothing is subscribed yet."""
    from linkage_vibration.ros import lifecycle

    read, subscribed = lifecycle.kept_levels, []

    def kept(*arguments: Any) -> Any:
        levels = read(*arguments)
        prepare = levels.prepare

        def prepared() -> None:
            prepare()
            subscribed.append(entities(node)["subscriptions"])

        monkeypatch.setattr(levels, "prepare", prepared)
        return levels

    monkeypatch.setattr(lifecycle, "kept_levels", kept)
    node = managed()
    before = entities(node)["subscriptions"]
    assert node.trigger_configure() is SUCCESS
    assert subscribed == [before]
    assert node.trigger_activate() is SUCCESS
    assert entities(node)["subscriptions"] > before


@pytest.mark.nightly(short="test_transitions_while_peers_come_and_go")
@pytest.mark.parametrize("count", [10, pytest.param(60, marks=pytest.mark.nightly)])
def test_many_lifecycles_leave_nothing_behind(
    managed: Callable[..., Any], tmp_path: Path, count: int
) -> None:
    """After many lifecycles the node has as many entities, objects, files and bytes as before.

    Bytes are compared in the longer run only, which has its process for itself: beside other tests
    the middleware and the C library keep some that have nothing to do with the node.
    """
    node = managed("-p", "record:=true", "-p", f"log_directory:={tmp_path}")
    before = entities(node)
    assert not list(node.timers)
    sizes = []
    for i in range(count):
        assert node.trigger_configure() is SUCCESS
        inactive = entities(node)
        assert node.trigger_activate() is SUCCESS
        assert entities(node)["subscriptions"] == inactive["subscriptions"] + 4
        assert node.trigger_deactivate() is SUCCESS
        assert entities(node) == inactive
        assert node.trigger_cleanup() is SUCCESS
        assert entities(node) == before
        for path in tmp_path.iterdir():
            path.unlink()
        if i % 5 == 4:
            sizes.append((open_files(), resident(), own_objects()))
    # The middleware opens and closes files of its own at any moment; a leak is one each time.
    assert sizes[-1][0] - sizes[0][0] < count - 5
    # Objects of the last configuration or two may wait for another thread; a leak has all of them.
    for kind, number in sizes[-1][2].items():
        assert number <= 3 * max(sizes[0][2][kind], 1), kind
    if count > 10:
        assert sizes[-1][1] - sizes[0][1] < 5 * 2**20  # a table alone has half of that, each time
    assert node.trigger_configure() is SUCCESS
    assert node.trigger_shutdown() is SUCCESS
    assert entities(node) == before


def test_name_that_is_too_long_is_refused(managed: Callable[..., Any]) -> None:
    """ROS 2 limits the length of a topic with its namespace; the node says so."""
    node = managed("-p", f"hitch_topic:={'a' * 247}")
    assert node.trigger_configure() is FAILURE
    assert "of 247 characters has an invalid name; use letters" in node.problem
    assert "report" not in node.problem
    [result] = node.set_parameters([Parameter("hitch_topic", value="a" * 246)])
    assert result.successful
    assert node.trigger_configure() is SUCCESS


def test_defects_are_reported(managed: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """An unexpected exception is reported and leaves nothing behind; another try succeeds."""
    node = managed()
    before = entities(node)
    with monkeypatch.context() as patch:
        patch.setattr("linkage_vibration.ros.lifecycle.Services", None)
        assert node.trigger_configure() is TransitionCallbackReturn.ERROR
    assert "TypeError" in node.problem
    assert entities(node) == before
    assert node.trigger_configure() is SUCCESS


def test_failed_activation_leaves_the_node_inactive(
    managed: Callable[..., Any], tmp_path: Path
) -> None:
    """A node whose log cannot be started stays inactive; without a log it can be activated."""
    logs = tmp_path / "logs"
    node = managed("-p", "record:=true", "-p", f"log_directory:={logs}")
    assert node.trigger_configure() is FAILURE
    assert "log_directory must be a folder" in node.problem
    logs.mkdir()
    assert node.trigger_configure() is SUCCESS
    logs.rmdir()
    inactive = entities(node)
    assert node.trigger_activate() is FAILURE
    assert str(logs) in node.problem
    assert entities(node) == inactive
    assert node.trigger_cleanup() is SUCCESS
    assert node.set_parameters([Parameter("record", value=False)])[0].successful
    logs.mkdir()
    assert node.trigger_configure() is SUCCESS
    assert node.trigger_activate() is SUCCESS


def test_later_failures_are_logged(
    managed: Callable[..., Any], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """After an automatic start, a transition that fails is logged."""
    logs = tmp_path / "logs"
    logs.mkdir()
    node = managed("-p", "autostart:=true", "-p", "record:=true", "-p", f"log_directory:={logs}")
    node.start()
    assert node.trigger_deactivate() is SUCCESS
    shutil.rmtree(logs)
    assert node.trigger_activate() is FAILURE
    assert f"[here]: {node.problem}" in capfd.readouterr().err


def test_without_autostart_the_node_says_what_it_waits_for(
    environment: dict[str, str], capfd: pytest.CaptureFixture[str]
) -> None:
    """The message names the command that configures the node."""
    from linkage_vibration.ros.spinning import run

    arguments = ["node", "--ros-args", "-r", "__node:=waits", "-p", "autostart:=false"]
    assert run(arguments, lambda: True) == 0
    [line] = [line for line in capfd.readouterr().err.splitlines() if "Waiting for" in line]
    assert "`ros2 lifecycle set /waits configure`" in line


@pytest.mark.parametrize(
    ("topic", "words"),
    [
        ("/here/resonance", "Topic /here/resonance is that of both an input and the output"),
        ("/parameter_events", "Topic /parameter_events cannot be read as std_msgs/msg/Float64"),
    ],
)
def test_topics_of_the_node_itself_are_refused(
    managed: Callable[..., Any], topic: str, words: str
) -> None:
    """DDS has one type for a topic in a process; a refused one leaves the node as it was."""
    node = managed()
    assert node.trigger_configure() is SUCCESS
    assert node.trigger_activate() is SUCCESS
    before, settings = entities(node), node._settings
    result = node.set_parameters_atomically(
        [Parameter("near_margin", value=0.2), Parameter("engine_topic", value=topic)]
    )
    assert not result.successful
    assert words in result.reason
    assert node.get_parameter("engine_topic").value == ""
    assert node.get_parameter("near_margin").value == 0.1
    assert (entities(node), node._settings) == (before, settings)
    assert node.set_parameters([Parameter("engine_topic", value="/rpm")])[0].successful


def test_topic_is_read_as_another_type(managed: Callable[..., Any]) -> None:
    """The topic of one input can become that of another, live and between two activations."""
    node = managed()
    assert node.trigger_configure() is SUCCESS
    assert node.trigger_activate() is SUCCESS
    topics = [("/other", "/joint_states"), ("", "")]  # of the hitch and of the engine

    def exchange(hitch: str, engine: str) -> Any:
        values = {"hitch_topic": hitch, "engine_topic": engine}
        return node.set_parameters_atomically([Parameter(n, value=v) for n, v in values.items()])

    for names in topics:
        assert exchange(*names).successful
    for names in topics:
        assert node.trigger_deactivate() is SUCCESS
        assert exchange(*names).successful
        assert node.trigger_activate() is SUCCESS, node.problem


def test_descriptors(managed: Callable[..., Any]) -> None:
    """`ros2 param describe` shows unit, range and meaning."""
    node = managed()
    margin = node.describe_parameter("near_margin")
    assert [(r.from_value, r.to_value) for r in margin.floating_point_range] == [(0.0, 1.0)]
    assert "Unit: 1." in margin.description
    assert node.describe_parameter("autostart").read_only
    assert "Read when the node is configured." in node.describe_parameter("record").description
    assert "configured" not in node.describe_parameter("joint_name").description


STORM = """
import sys
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from linkage_vibration_interfaces.msg import Resonance, TableInfo, VibrationPrediction
from linkage_vibration_interfaces.srv import PredictVibration

rclpy.init()
node = rclpy.create_node("storm")
wrong = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
topics = {
    "stormy/prediction": VibrationPrediction,
    "stormy/resonance": Resonance,
    "stormy/table_info": TableInfo,
}
client = node.create_client(PredictVibration, "stormy/predict")
while True:
    if client.service_is_ready():
        client.call_async(PredictVibration.Request(crank_angles=[2.0]))
    subscriptions = [
        node.create_subscription(kind, topic, print, qos)
        for topic, kind in topics.items()
        for qos in (wrong, 10, wrong, 10)
    ]
    rclpy.spin_once(node, timeout_sec=0.01)
    for subscription in subscriptions:
        node.destroy_subscription(subscription)
"""


@pytest.mark.parametrize("count", [1, pytest.param(30, marks=pytest.mark.nightly)])
def test_transitions_while_peers_come_and_go(
    start: Callable[..., Any], environment: dict[str, str], manager: Any, count: int
) -> None:
    """Peers that come and go, with right and wrong QoS, do not disturb the transitions.

    rclpy's events executor can end the process by a segmentation fault when a publisher that has
    QoS events is destroyed at such a time.
    """
    process = start(name="stormy", autostart=False)
    storms = [
        subprocess.Popen([sys.executable, "-c", STORM], env=environment, stdout=subprocess.DEVNULL)
        for _ in range(2)
    ]
    peer, executor = manager
    change: Any = peer.create_client(ChangeState, "stormy/change_state")
    asked: Any = peer.create_client(GetState, "stormy/get_state")

    def state() -> int:
        return int(response(asked, GetState.Request(), executor.spin_once).current_state.id)

    publisher = peer.create_publisher(JointState, "joint_states", SENSOR)
    message = JointState(name=[JOINT], position=array("d", [2.0]))
    sent: list[int] = []

    def publish() -> None:
        publisher.publish(message)
        sent.append(1)

    peer.create_timer(0.002, publish)
    try:
        assert change.wait_for_service(LIMIT)
        # From this answer to an invalid request on, the node knows the client; before, it may lose
        # an answer, and a request for a transition cannot be repeated.
        assert not response(change, ChangeState.Request(), executor.spin_once).success
        for _ in range(count):
            for transition, reached in (
                (Transition.TRANSITION_CONFIGURE, State.PRIMARY_STATE_INACTIVE),
                (Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_ACTIVE),
                (Transition.TRANSITION_DEACTIVATE, State.PRIMARY_STATE_INACTIVE),
                (Transition.TRANSITION_CLEANUP, State.PRIMARY_STATE_UNCONFIGURED),
            ):
                request = ChangeState.Request(transition=Transition(id=transition))
                future, late = change.call_async(request), time.monotonic() + 5.0

                def is_reached(future: Any = future, late: float = late, to: int = reached) -> bool:
                    # The storm can make DDS lose the answer, but not the state.
                    return future.done() or (time.monotonic() > late and state() == to)

                # With a timeout that changes, rclpy begins anew, always with the timer.
                until(is_reached, "the transition", lambda: executor.spin_once(0.02))
                assert not future.done() or future.result().success, process.printed
                enough = len(sent) + 50
                until(lambda n=enough: len(sent) > n, "messages", lambda: executor.spin_once(0.02))
        assert process.stop() == 0
        assert "Traceback" not in process.printed
    finally:
        for storm in storms:
            storm.kill()
            storm.wait()
