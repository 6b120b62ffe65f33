# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node promises about its services and the logs, in each condition."""

import math
import time
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rcl_interfaces.srv import SetParameters
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.integrate import trapezoid
from std_srvs.srv import Trigger

from linkage_vibration.prediction.answers import LoadedModel
from linkage_vibration.prediction.predictor import Status
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.table.table import load_table
from linkage_vibration_interfaces.action import SetImplement
from linkage_vibration_interfaces.msg import TableInfo
from linkage_vibration_interfaces.srv import (
    Advise,
    GetFrf,
    GetGroundLevels,
    GetModeShapes,
    GetTable,
    PredictVibration,
)
from test.ros.promises.message_fields import advised_loads, numbers, present
from test.ros.test_implements import small_linkage
from test.support.conditions import GOAL, Promised, promise
from test.support.messages import read_messages
from test.support.ros_process import JOINT
from test.support.served import shipped

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6  # statuses of action_msgs/msg/GoalStatus
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OWN = {"inertia": 300.0, "centre_of_gravity": [0.2, 1.0]}
IMPLEMENTS = {"plough": {"mass": 1200.0, **OWN}, "mower": {"mass": 500.0, **OWN}}
ANGLE = 2.3
A_GOAL = "its own goal builds a table already"


@pytest.fixture(scope="module")
def served() -> LoadedModel:
    """Return what the node serves."""
    return shipped()


@pytest.fixture(scope="module")
def logs(condition: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the node's logs."""
    return tmp_path_factory.mktemp("logs")


@pytest.fixture(scope="module")
def node(begin: Callable[..., Promised], logs: Path) -> Promised:
    """Return a node with the shipped table, which knows two implements."""
    path = logs / "implements.yaml"
    path.write_text(yaml.safe_dump({"implements": IMPLEMENTS}))
    return begin("serving", implement_file=path, log_directory=logs)


@pytest.fixture(scope="module")
def small(begin: Callable[..., Promised], logs: Path, mechanism_file: Path) -> Promised:
    """Return a node with a small linkage, whose table takes little time."""
    implements, mechanism = logs / "implements.yaml", logs / "small.yaml"
    implements.write_text(yaml.safe_dump({"implements": IMPLEMENTS}))
    mechanism.write_text(small_linkage(mechanism_file))
    return begin("small", mechanism_file=mechanism, implement_file=implements)


def complex_numbers(answer: Any) -> Any:
    """Return the FRFs of an answer, (n_frequencies, n_outputs, n_inputs)."""
    shape = len(answer.frequencies), len(answer.outputs), len(answer.inputs)
    return (np.array(answer.real) + 1j * np.array(answer.imaginary)).reshape(shape)


class Goals:
    """Sends goals to the node of a peer, and keeps the feedback of the last one."""

    def __init__(self, node: Promised) -> None:
        self._node, self.progress = node, list[float]()
        self.client: Any = ActionClient(node.peer.node, SetImplement, f"{node.name}/set_implement")
        node.peer.spin(self.client.server_is_ready, "the action")

    def send(self, **fields: Any) -> Any:
        """Return a goal that the node has accepted, and the future of its result."""
        self.progress.clear()
        compare_sensor = lambda message: self.progress.append(message.feedback.progress)  # noqa: E731
        goal = SetImplement.Goal(**fields)
        handle = self._wait(self.client.send_goal_async(goal, feedback_callback=compare_sensor))
        assert handle.accepted
        return handle, handle.get_result_async()

    def result(self, **fields: Any) -> Any:
        """Return the status and the result of a goal."""
        return self.ended(self.send(**fields)[1])

    def ended(self, future: Any) -> Any:
        """Return the status and the result of a goal when it has ended."""
        answer = self._wait(future)
        return answer.status, answer.result

    def _wait(self, future: Any) -> Any:
        self._node.peer.spin(future.done, "an answer of the action")
        return future.result()


@promise("services.md#predict")
def test_predict(node: Promised, served: LoadedModel) -> None:
    """A request for 1,000 angles has as many predictions, bit for bit, in their order."""
    angles = np.linspace(1.6, 3.1, 1000)
    answer = node.ask("predict", PredictVibration, crank_angles=array("d", angles))
    assert (answer.success, answer.message) == (True, "")
    expected = [numbers(served.predictor.predict(angle)) for angle in angles]
    assert [numbers(each) for each in answer.predictions] == expected
    assert {each.table_id for each in answer.predictions} == {served.table.table_id}


@promise("services.md#predict")
def test_bad_angles(node: Promised) -> None:
    """The message names the first angle without a prediction; all angles have a status."""
    answer = node.ask("predict", PredictVibration, crank_angles=array("d", [2.0, 5.0, math.nan]))
    assert not answer.success
    assert "2 of 3" in answer.message
    assert "crank_angles[1]" in answer.message
    statuses = [each.status for each in answer.predictions]
    assert statuses == [Status.OK, Status.OUT_OF_RANGE, Status.INVALID_ANGLE]


@promise("services.md#predict")
def test_too_many_angles(node: Promised) -> None:
    """More than 1,000 angles, and none, are refused with the limit."""
    for count in (0, 1001):
        answer = node.ask("predict", PredictVibration, crank_angles=array("d", [2.0] * count))
        assert (answer.success, len(answer.predictions)) == (False, 0)
        assert f"crank_angles has {count} angles; give 1 to 1000" in answer.message


@promise("services.md#predict")
def test_shares(node: Promised, served: LoadedModel) -> None:
    """With shares, the answer has what each cause contributes to the standard deviations."""
    asked = {"crank_angles": array("d", [ANGLE]), "crank_angle_stddev": 0.01}
    answer = node.ask("predict", PredictVibration, shares=True, **asked)
    shares = served.predictor.shares(ANGLE, 0.01)
    parts = np.array([shares.parameters, shares.angle, shares.links, shares.table])
    np.testing.assert_array_equal(answer.frequency_shares, parts[:, 0].ravel())
    np.testing.assert_array_equal(answer.damping_ratio_shares, parts[:, 1].ravel())


@promise("services.md#get_frf")
def test_get_frf(node: Promised, served: LoadedModel) -> None:
    """FRFs of the table and exact ones agree within 1e-4; the former are the table's, exactly."""
    outputs, inputs = ["E1.z", "V1.x"], ["E1.z"]
    asked = {"crank_angle": ANGLE, "outputs": outputs, "inputs": inputs}
    answer, exact = (node.ask("get_frf", GetFrf, exact=each, **asked) for each in (False, True))
    assert answer.success
    assert exact.success
    actual, solved = complex_numbers(answer), complex_numbers(exact)
    places = [("E1", "z"), ("V1", "x")], [("E1", "z")]
    np.testing.assert_array_equal(
        actual, served.table.frf(ANGLE, *places).frf(np.array(answer.frequencies))
    )
    apart = np.linalg.norm(actual - solved, axis=0) / np.linalg.norm(solved, axis=0)
    assert 0.0 < apart.max() < 1e-4


@promise("services.md#get_frf")
def test_default_frf(node: Promised) -> None:
    """By default, FRFs are those of the drive point at 401 even steps over the band."""
    answer = node.ask("get_frf", GetFrf, crank_angle=ANGLE)
    assert (answer.outputs, answer.inputs) == (["E1.z"], ["E1.z"])
    assert list(answer.frequencies) == np.linspace(0.0, 200.0, 401).tolist()


@promise("services.md#get_frf")
def test_frf_of_a_force(node: Promised) -> None:
    """An output may be a force, and with exact one in a section."""
    for exact, outputs in (
        (False, ["lower_link:E1.force_x", "lift_cylinders.force"]),
        (True, ["lower_link:V1.moment"]),
    ):
        asked = {"outputs": outputs, "inputs": ["E1.z"], "frequencies": array("d", [5.0])}
        answer = node.ask("get_frf", GetFrf, crank_angle=ANGLE, exact=exact, **asked)
        assert (answer.success, answer.outputs) == (True, outputs), answer.message
        assert np.abs(complex_numbers(answer)).min() > 0.0


@promise("services.md#get_frf")
def test_too_many_frequencies(node: Promised) -> None:
    """More than 10,000 frequencies, and more than 100,000 numbers, are refused."""
    for places, count, allowed in ((["E1.z"], 10_000, True), (["E1.z"], 10_001, False)):
        lines = array("d", np.linspace(0.0, 200.0, count))
        asked = {"outputs": places, "inputs": ["E1.z"], "frequencies": lines}
        answer = node.ask("get_frf", GetFrf, crank_angle=ANGLE, **asked)
        assert answer.success == allowed, answer.message
    lines = array("d", np.linspace(0.0, 200.0, 9_000))
    asked = {"outputs": ["E1.z", "E1.x", "V1.x"], "inputs": ["E1.z", "E1.x", "V1.x", "V1.z"]}
    answer = node.ask("get_frf", GetFrf, crank_angle=ANGLE, frequencies=lines, **asked)
    assert not answer.success
    assert answer.message


@promise("services.md#get_ground_levels")
def test_ground_levels(node: Promised, served: LoadedModel) -> None:
    """Levels are the roots of the integrals of their power spectral densities."""
    outputs = ["E1.z", "lift_cylinders.force"]
    asked = {"crank_angle": ANGLE, "ground_speed": -8.0, "outputs": outputs}
    answer = node.ask("get_ground_levels", GetGroundLevels, **asked)
    assert (answer.success, answer.outputs, answer.reasons) == (True, outputs, ["", ""])
    assert answer.table_id == served.table.table_id
    densities = np.nan_to_num(np.reshape(answer.densities, (2, -1)))
    squares = trapezoid(densities, answer.frequencies)
    np.testing.assert_allclose(np.array(answer.levels) ** 2, squares, rtol=0.01)


@promise("services.md#get_ground_levels")
def test_unknown_ground_level(node: Promised) -> None:
    """A level that is not known is NaN, and reasons says why."""
    answer = node.ask("get_ground_levels", GetGroundLevels, crank_angle=1.0, ground_speed=3.0)
    assert answer.success
    assert np.isnan(answer.levels).all()
    assert answer.reasons[0].startswith("The crank angle")


@promise("services.md#get_ground_levels")
def test_too_many_places(node: Promised) -> None:
    """More than eight places, and unknown ones, are refused."""
    for outputs, words in (
        (["E1.z"] * 9, "outputs"),
        (["Q.z"], "outputs[0] is 'Q.z'; name one of"),
    ):
        asked = {"crank_angle": ANGLE, "ground_speed": 8.0, "outputs": outputs}
        answer = node.ask("get_ground_levels", GetGroundLevels, **asked)
        assert not answer.success
        assert words in answer.message


@promise("services.md#get_mode_shapes")
def test_mode_shapes(node: Promised, served: LoadedModel) -> None:
    """There is every mode up to the end of the band, in ascending order, as the model has them."""
    answer = node.ask("get_mode_shapes", GetModeShapes, crank_angle=ANGLE)
    assert (answer.success, answer.table_id) == (True, served.table.table_id)
    expected = []
    for half, table in zip(served.model.halves, served.table.halves, strict=True):
        frequencies = np.sort(half.solve(ANGLE).natural_frequencies)
        expected += [*frequencies[: max(int((frequencies <= 200.0).sum()), table.n_modes)]]
    np.testing.assert_allclose(answer.natural_frequencies, np.sort(expected), 1e-9)


@promise("services.md#get_mode_shapes")
def test_scale_of_mode_shapes(node: Promised, served: LoadedModel) -> None:
    """Shapes have unit modal mass: FRFs of modes in the plane add up to the solved one."""
    answer = node.ask("get_mode_shapes", GetModeShapes, crank_angle=ANGLE)
    shapes = np.reshape(answer.shapes, (-1, len(answer.places)))
    at = shapes[:, answer.places.index("E1.z")] * (shapes[:, answer.places.index("E1.y")] == 0.0)
    omega = 2.0 * np.pi * np.array(answer.natural_frequencies)
    static = float((at**2 / omega**2).sum())  # of all modes in the band
    asked = {"outputs": ["E1.z"], "inputs": ["E1.z"], "frequencies": array("d", [0.0])}
    exact = node.ask("get_frf", GetFrf, crank_angle=ANGLE, exact=True, **asked)
    assert static == pytest.approx(exact.real[0], rel=0.02)  # the modes above have 2 % at most


@promise("services.md#get_table")
def test_get_table(node: Promised, served: LoadedModel, tmp_path: Path) -> None:
    """The table and the mechanism of the answer give the predictions of the node anywhere."""
    answer = node.ask("get_table", GetTable)
    (tmp_path / "table.npz").write_bytes(bytes(answer.table))
    (tmp_path / "mechanism.yaml").write_text(answer.mechanism)
    table = load_table(tmp_path / "table.npz", read_mechanism(tmp_path / "mechanism.yaml"))
    assert table.table_id == answer.table_id == served.table.table_id
    assert numbers(node.peer.ask([JOINT], [ANGLE])) == numbers(served.predictor.predict(ANGLE))


@promise("services.md")
def test_reason(node: Promised) -> None:
    """A request that cannot be answered says what is wrong and how to fix it."""
    refused = node.ask("get_mode_shapes", GetModeShapes, crank_angle=5.0)
    assert not refused.success
    assert "cannot close" in refused.message
    places = {"crank_angle": ANGLE, "outputs": ["Q.z"], "inputs": ["E1.z"]}
    refused = node.ask("get_frf", GetFrf, **places)
    assert not refused.success
    assert refused.message.startswith("outputs[0] is 'Q.z'; name one of E1.z")


@promise("services.md#advise")
def test_advise(node: Promised) -> None:
    """The map has the present load, and its smallest one is that of the advice for both."""
    answer = node.ask("advise", Advise, **present(ground_speed_min=4.0, ground_speed_max=12.0))
    assert answer.success, answer.message
    loads = advised_loads(answer)
    assert loads["both"] == pytest.approx(np.nanmin(answer.load_ratios), rel=1e-12)
    assert loads["both"] <= min(loads["height"], loads["speed"], loads["now"])
    grid = np.reshape(answer.load_ratios, (len(answer.crank_angles), len(answer.ground_speeds)))
    assert grid.shape == (len(answer.crank_angles), len(answer.ground_speeds))
    assert "would be loaded" in answer.advice.sentence


@promise("services.md#advise")
def test_two_zeros(node: Promised, served: LoadedModel) -> None:
    """Two zeros permit all heights of the table, and only the present ground speed."""
    answer = node.ask("advise", Advise, **present())
    assert answer.success, answer.message
    low, high = served.table.alpha3_range
    assert (min(answer.crank_angles), max(answer.crank_angles)) == (low, high)
    assert list(answer.ground_speeds) == [8.3]


@promise("services.md")
def test_readings_take_precedence(node: Promised) -> None:
    """A reading is answered while a request for 1,000 angles is being answered."""
    client = node.client("predict", PredictVibration)
    request = PredictVibration.Request(crank_angles=array("d", [2.0] * 1000))
    for _ in range(3):
        future = client.call_async(request)
        node.peer.ask([JOINT], [2.0])
        if not future.done():
            break
        node.peer.spin(future.done, "the answer to the request")
    else:
        pytest.fail("no reading was answered before the request")
    node.peer.spin(future.done, "the answer to the request")
    assert future.result().success


@promise("services.md#set_implement", goal=A_GOAL)
def test_progress(node: Promised) -> None:
    """The feedback is the finished share of the table, four times a second."""
    goals = Goals(node)
    handle, future = goals.send(mass=1e4, inertia=2500.0)
    node.peer.spin(lambda: goals.progress, "feedback")
    goals.progress.clear()
    begun = time.monotonic()
    node.peer.spin(lambda: len(goals.progress) >= 8, "feedback")
    assert 1.5 <= time.monotonic() - begun <= 4.0
    assert goals.progress == sorted(goals.progress)
    assert 0.0 <= goals.progress[0] <= goals.progress[-1] <= 1.0
    node.peer.spin(handle.cancel_goal_async().done, "the end of the goal")
    assert goals.ended(future)[0] == CANCELED


@promise("services.md#implements-by-name", goal=A_GOAL)
def test_cancelled_goal(node: Promised, served: LoadedModel) -> None:
    """A goal that is cancelled leaves the old table."""
    goals = Goals(node)
    handle, future = goals.send(mass=1e4, inertia=2500.0)
    node.peer.spin(lambda: goals.progress, "feedback")
    node.peer.spin(handle.cancel_goal_async().done, "the end of the goal")
    status, result = goals.ended(future)
    assert (status, result.success) == (CANCELED, False)
    assert result.message.endswith("Building the table was cancelled.")
    assert result.table_id == served.table.table_id
    assert node.peer.ask().table_id == served.table.table_id


@promise("services.md#set_implement")
def test_second_goal(node: Promised) -> None:
    """While a table is being built, another goal is rejected."""
    goals = Goals(node)
    first = goals.send(mass=1e4, inertia=2500.0) if node.condition != GOAL else None
    node.peer.pause(0.2)
    status, result = Goals(node).result(mass=900.0, inertia=200.0)
    assert (status, result.success) == (ABORTED, False)
    assert "is being built; ask again when it is in use" in result.message
    if first is not None:
        node.peer.spin(first[0].cancel_goal_async().done, "the end of the goal")
        goals.ended(first[1])


@promise("services.md#set_implement", goal=A_GOAL)
@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"mass": -1.0, "inertia": 1.0}, "rigid_bodies.implement.mass: -1 is not greater"),
        ({"mass": 1e10, "inertia": 1e9}, "beside it the links lose their digits"),
        ({"name": "drill"}, "There is no implement 'drill'"),
        ({"name": "plough", "mass": 9.0}, "name has its own properties; leave all other fields"),
    ],
)
def test_refused_implement(
    node: Promised, served: LoadedModel, fields: dict[str, Any], words: str
) -> None:
    """An implement that is not possible is refused, and the old table stays in use."""
    status, result = Goals(node).result(**fields)
    assert (status, result.success) == (ABORTED, False)
    assert words in result.message
    assert result.table_id == served.table.table_id


@promise("node.md#services")
def test_recording(node: Promised, logs: Path) -> None:
    """Services start and stop a log, which has the readings and their predictions."""
    refused = node.ask("stop_recording", Trigger)
    assert (refused.success, "call start_recording first" in refused.message) == (False, True)
    begun = node.ask("start_recording", Trigger)
    assert begun.success, begun.message
    assert "recorded already" in node.ask("start_recording", Trigger).message
    stamps = [node.peer.ask([JOINT], [1.75]).header.stamp.nanosec for _ in range(5)]
    ended = node.ask("stop_recording", Trigger)
    assert (ended.success, ended.message) == (True, begun.message)
    for topic in ("/joint_states", f"/{node.name}/prediction"):
        messages = [message for _, message in read_messages(Path(ended.message), topic)]
        own = {m.header.stamp.nanosec for m in messages if m.header.stamp.sec == node.peer.second}
        assert own >= set(stamps)
    Path(ended.message).unlink()


@promise("node.md#parameters")
def test_log_of_new_values(node: Promised, logs: Path) -> None:
    """After a parameter was set, the log continues in a new file, which has the new value."""
    assert node.ask("start_recording", Trigger).success
    node.peer.ask()
    for value in (0.3, 0.1):  # and back to the default
        parameter = Parameter("near_margin", value=value).to_parameter_msg()
        [result] = node.ask("set_parameters", SetParameters, parameters=[parameter]).results
        assert result.successful
        node.peer.ask()
    assert node.ask("stop_recording", Trigger).success
    values = []
    for path in sorted(logs.glob("*.mcap"), key=lambda path: path.stat().st_mtime):
        with path.open("rb") as file:
            attached = {a.name: a.data for a in make_reader(file).iter_attachments()}
        settings = yaml.safe_load(attached["parameters.yaml"])[f"/{node.name}"]
        values.append(settings["ros__parameters"]["near_margin"])
        path.unlink()
    assert values == [0.1, 0.3, 0.1]


@promise("services.md#set_implement", goal=A_GOAL)
def test_change_of_the_implement(small: Promised, tmp_path: Path) -> None:
    """The node predicts from the old table until the new one is in use, which the answer names.

    The description of the table and the mechanism are then published again.
    """
    node, old = small, small.peer.ask().table_id
    infos = node.listen("table_info", TableInfo, LATCHED)
    node.peer.spin(lambda: infos, "the latched topic")
    _, future = Goals(node).send(name="plough")
    first = len(node.peer.predictions)
    while not future.done():
        node.peer.publish((JOINT,), (2.0,))
        node.peer.pause(0.02)
    tables = [each.table_id for each in node.peer.predictions[first:]]
    status, result = future.result().status, future.result().result
    assert (status, result.success) == (SUCCEEDED, True), result.message
    assert tables.count(old) > 2
    assert tables == [old] * tables.count(old) + [result.table_id] * tables.count(result.table_id)
    assert node.peer.ask().table_id == result.table_id != old
    node.peer.spin(lambda: len(infos) == 2, "the new description")
    assert infos[-1].table_id == result.table_id
    answer = node.ask("get_table", GetTable)
    assert answer.mechanism == infos[-1].mechanism
    (tmp_path / "plough.yaml").write_text(answer.mechanism)
    [body] = read_mechanism(tmp_path / "plough.yaml").rigid_bodies
    assert (body.mass, body.inertia) == (1200.0, 300.0)
