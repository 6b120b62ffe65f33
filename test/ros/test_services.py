# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The services over real DDS, on a node that nothing else wakes."""

import math
import multiprocessing
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future

from linkage_vibration.prediction.answers import LoadedModel
from linkage_vibration.prediction.levels import LevelTable, kept_levels
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.ros.lifecycle import _table_info
from linkage_vibration.ros.services import Services
from linkage_vibration.support.resources import config_file, share_directory
from linkage_vibration.table.table import load_table
from linkage_vibration_interfaces.action import SetImplement
from linkage_vibration_interfaces.srv import (
    Advise,
    GetFrf,
    GetGroundLevels,
    GetModeShapes,
    GetTable,
    PredictVibration,
)
from test.support.ros_process import LIMIT, own_context, until
from test.support.served import shipped

NODE = "serving"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # statuses of action_msgs/msg/GoalStatus
SERVICES = {
    "predict": PredictVibration,
    "get_frf": GetFrf,
    "get_ground_levels": GetGroundLevels,
    "get_mode_shapes": GetModeShapes,
    "get_table": GetTable,
    "advise": Advise,
}


@dataclass
class Bench:
    """A node with the services, spun in a thread, and a client of each."""

    served: list[LoadedModel]
    services: Services
    spinning: Callable[[], bool]
    spin: Callable[[float], None]
    run: Callable[[Callable[[], None]], None]
    peer: Any
    clients: dict[str, Any] = field(default_factory=dict)

    def ask(self, service: str, **fields: Any) -> Any:
        """Send a request and return the future of its answer."""
        return self.clients[service].call_async(SERVICES[service].Request(**fields))

    def goal(self, **fields: Any) -> Any:
        """Send the goal to use another implement, and return the future of its result."""
        client: Any = ActionClient(self.peer, SetImplement, f"{NODE}/set_implement")
        until(client.server_is_ready, "the action", lambda: self.spin(0.05))
        handle = self.wait(client.send_goal_async(SetImplement.Goal(**fields)))
        return handle.get_result_async()

    def call(self, service: str, **fields: Any) -> Any:
        """Return the answer to a request."""
        return self.wait(self.ask(service, **fields))

    def wait(self, future: Any) -> Any:
        """Return an answer when it arrives."""
        ended = lambda: future.done() or not self.spinning()  # noqa: E731
        until(ended, "an answer", lambda: self.spin(0.05))
        assert future.done(), "the node's executor has ended"
        return future.result()


@pytest.fixture
def bench(domain: int) -> Iterator[Bench]:
    """Return a node that has just started, and clients that have found its services."""
    with own_context(domain) as context, own_context(domain) as peer_context:
        node = rclpy.create_node(NODE, context=context, start_parameter_services=False)
        peer = rclpy.create_node("asking", context=peer_context, start_parameter_services=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        peer_executor = SingleThreadedExecutor(context=peer_context)
        peer_executor.add_node(peer)
        served = [shipped()]
        excitations = read_excitations(config_file("excitations.yaml"))
        levels = kept_levels(served[0].predictor, served[0].mechanism, excitations)

        def swap(new: LoadedModel, levels: LevelTable) -> None:
            speeds = np.array([[2000.0], [500.0], [1.0]])
            columns = levels.at(np.array([2.3]), speeds)
            assert columns.total_velocity.shape == (1,)
            served.append(new)

        services = Services(node, lambda: served[-1], excitations, swap, levels, lambda: 0.01)
        ended: Future[None] = Future(executor=executor)
        thread = threading.Thread(target=executor.spin_until_future_complete, args=[ended])
        thread.start()

        def run(work: Callable[[], None]) -> None:
            """Call a function in the executor's thread, as a callback calls it, and wait."""
            called = threading.Event()

            def call() -> None:
                timer.cancel()
                work()
                called.set()

            timer = node.create_timer(0.01, call)
            assert called.wait(LIMIT)

        bench = Bench(served, services, thread.is_alive, peer_executor.spin_once, run, peer)
        for name, kind in SERVICES.items():
            bench.clients[name] = peer.create_client(kind, f"{NODE}/{name}")
            assert bench.clients[name].wait_for_service(LIMIT)
        yield bench
        # A shutdown may destroy what wakes the executor before that waits for it.
        executor.create_task(lambda: ended.set_result(None))
        thread.join(LIMIT)
        assert not thread.is_alive()
        executor.shutdown()
        node.executor = None
        services.close()
        node.destroy_node()
        peer.destroy_node()


def test_advise(bench: Bench) -> None:
    """The answer has the present load, the map row by row, and why a question is refused."""
    present = {"crank_angle": math.radians(165.0), "ground_speed": -8.0}
    present["engine_speed"] = 1800.0 * math.pi / 30.0
    answer = bench.call("advise", **present, ground_speed_min=2.0, ground_speed_max=10.0)
    assert (answer.success, answer.advice.table_id) == (True, bench.served[0].table.table_id)
    served, excitations = bench.served[0], read_excitations(config_file("excitations.yaml"))
    levels = kept_levels(served.predictor, served.mechanism, excitations)

    def load(angle: float, speed: float) -> float:
        speeds = np.array([[1800.0], [0.0], [speed]])
        return float(levels.at(np.array([angle]), speeds).total_load_ratio[0])

    advice, grid = answer.advice, np.reshape(answer.load_ratios, (91, 17))
    assert advice.places[advice.NOW].load_ratio == load(present["crank_angle"], 8.0)
    assert grid[30, 5] == load(answer.crank_angles[30], answer.ground_speeds[5])
    assert advice.places[advice.BOTH].load_ratio == np.nanmin(grid)
    assert 0.5 < advice.places[advice.BOTH].quieter_probability < 1.0
    assert "That is not enough: " in advice.sentence
    assert "would be loaded" in advice.sentence
    reversed_range = bench.call("advise", **present, ground_speed_min=5.0, ground_speed_max=1.0)
    assert not reversed_range.success
    assert "ground speeds are 5 to 1" in reversed_range.message


def test_more_than_can_wait(bench: Bench) -> None:
    """While both threads are busy, sixteen requests wait, and one more says what to do."""
    free = threading.Event()
    for _ in range(2):
        bench.services._threads.submit(free.wait, LIMIT)
    futures = list[Any]()
    for _ in range(16):
        futures.append(bench.ask("get_mode_shapes", crank_angle=2.0))
        until(lambda: bench.services._waiting == len(futures), "a request")
        assert bench.services.busy
    refused = bench.call("get_mode_shapes", crank_angle=2.0)
    free.set()
    assert refused.message == "16 requests are waiting already; ask again later."
    assert bench.wait(futures[-1]).success
    until(lambda: not bench.services.busy, "the other answers")


SERVING_NODE = """
import signal

import rclpy
from rclpy.executors import ExternalShutdownException
from linkage_vibration.prediction.levels import LevelTable, kept_levels
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.ros.services import Services
from linkage_vibration.support.resources import config_file
from test.support.served import shipped

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # only rclpy acts on it
    rclpy.init()
    node, served = rclpy.create_node("serving"), [shipped()]
    excitations = read_excitations(config_file("excitations.yaml"))
    levels = kept_levels(served[0].predictor, served[0].mechanism, excitations)
    swap = lambda new, levels: served.append(new)
    services = Services(node, lambda: served[-1], excitations, swap, levels, lambda: 0.01)
    try:
        rclpy.spin(node)
    except ExternalShutdownException:
        pass
    finally:
        services.close()
        node.destroy_node()
        rclpy.try_shutdown()
"""


def serving_node(
    environment: dict[str, str], folder: Path, *arguments: str
) -> "subprocess.Popen[str]":
    """Start a node in a process of its own."""
    script = folder / "node.py"
    script.write_text(SERVING_NODE)
    return subprocess.Popen(
        [sys.executable, script, *arguments],
        env=environment | {"PYTHONPATH": str(share_directory())},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_close_while_building(bench: Bench) -> None:
    """A waiting caller gets an answer; the building process and the services end."""
    assert not bench.services.busy
    future = bench.goal(mass=1200.0, inertia=300.0)
    while not multiprocessing.active_children() and not future.done():
        bench.spin(0.01)
    assert bench.services.busy
    bench.run(bench.services.close)
    answer = bench.wait(future).result
    assert not answer.success
    assert answer.message.startswith("The table is unchanged: ")
    assert not multiprocessing.active_children()
    assert len(bench.served) == 1


def test_answers_are_sent_before_services_end(bench: Bench) -> None:
    """Who waits while the node is cleaned up gets an answer, also a large one."""
    angles = np.linspace(1.6, 3.1, 1000).tolist()
    futures = [bench.ask("predict", crank_angles=angles, shares=True) for _ in range(2)]
    until(lambda: bench.services.busy, "a request")
    bench.run(bench.services.close)
    for future in futures:
        answer = bench.wait(future)
        assert answer.success or "being cleaned up" in answer.message


def test_table_that_comes_too_late(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """A table that is complete only after another configuration is not used."""

    def rebuild(*_: object) -> tuple[Predictor, None]:
        bench.served.append(shipped())  # as if the node was configured again meanwhile
        return shipped().predictor, None

    monkeypatch.setattr("linkage_vibration.ros.services.call_in_process", rebuild)
    answer = bench.wait(bench.goal(mass=1200.0, inertia=300.0)).result
    assert answer.message.endswith("The node was configured again; ask again.")
    assert len(bench.served) == 2


def test_manual(environment: dict[str, str], domain: int, tmp_path: Path) -> None:
    """The example of the manual prints the answers of the node."""
    script = Path(__file__).parents[2] / "examples" / "ask_the_node.py"
    node = serving_node(environment, tmp_path, "--ros-args", "-r", "__node:=linkage_vibration")
    try:
        with own_context(domain) as context:  # The examples wait for 20 s only.
            peer = rclpy.create_node("asking", context=context, start_parameter_services=False)
            assert peer.create_client(
                PredictVibration, "/linkage_vibration/predict"
            ).wait_for_service(LIMIT)
            peer.destroy_node()
        done = subprocess.run(
            [sys.executable, script],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=LIMIT,
        )
        assert done.returncode == 0, done.stderr
    finally:
        node.kill()
        node.wait()
    old = shipped().table.table_id
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines[:3]] == [old] * 3
    assert [line.split()[0] for line in lines[3:7]] == ["parameters", "angle", "links", "table"]
    assert lines[7].startswith("E1.z peaks at ")
    assert [line.split(" at ")[0] for line in lines[8:10]] == ["E1 moves", "E1 shakes most"]
    assert len(lines) == 29
    read = load_table(tmp_path / f"{old}.npz", read_mechanism(tmp_path / f"{old}.yaml"))
    assert read.table_id == old
    assert lines[25].startswith("now in use: ")
    assert old not in lines[25]
    now, smallest = (float(line.split()[-1]) for line in lines[27:])
    assert 0.0 < smallest <= now


def test_unknown_deviations_have_a_reason(bench: Bench) -> None:
    """If the table does not know some standard deviations, a successful answer says why."""
    served = bench.served[-1]
    known = bench.call("predict", crank_angles=[2.0])
    assert (known.success, known.message) == (True, "")
    deviations = served.table.parameter_stddev.copy()
    deviations[0] = math.nan
    table = replace(served.table, parameter_stddev=deviations)
    bench.served.append(replace(served, predictor=Predictor(table)))
    answer = bench.call("predict", crank_angles=[2.0])
    assert answer.success
    assert answer.message.startswith("Standard deviations are not known where modes veer")
    info = _table_info(bench.served[-1], (), Time())
    assert info.unknown_deviations == answer.message
    failed = bench.call("predict", crank_angles=[5.0])
    assert not failed.success
    assert "crank_angles[0]" in failed.message
