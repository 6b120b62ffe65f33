# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the node promises about CAN frames, in each condition.

Beside 1,000 readings a second, the frames of the hitch come at this rate.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from linkage_vibration.bags.can_logs import DEFINITION
from linkage_vibration.prediction.predictor import Status
from linkage_vibration_interfaces.msg import LoadState, VibrationPrediction
from test.ros.promises.message_fields import unknown_speeds
from test.support.can_bus import identifier
from test.support.conditions import ERROR, RATES, SPEED_RATE, Load, Promised, Tractor, promise
from test.support.interface_packages import built_package, environment_with
from test.support.ros_process import documented

pytest.importorskip("can", reason="logs of a CAN bus are read by python-can (extra can)")
CAN = documented("can.md", "engine_input: can")
BUS, FRAME = "from_can_bus", "can_msgs/msg/Frame"
HITCH, ENGINE, PTO, WHEELS, VEHICLE = 65093, 61444, 65091, 65096, 65265
AT_40 = 2.6  # rad, at 40 % in the calibration of the manual
ABSENT = 8 * [0xFF]

Frame = dict[str, Any]


def frame(group: int, data: list[int], source: int = 0, **flags: Any) -> Frame:
    """Return the fields of a frame of J1939."""
    given = {"id": identifier(group, source), "is_extended": True, "dlc": 8}
    return {**given, "data": [*data, *ABSENT][:8], **flags}


def hitch(percent: float, source: int = 0xF0, **flags: Any) -> Frame:
    """Return a rear hitch position (SPN 1873): byte 1, 0.4 % for each bit."""
    return frame(HITCH, [round(percent / 0.4)], source, **flags)


def engine(rpm: float, source: int = 0) -> Frame:
    """Return an engine speed (SPN 190): bytes 4 and 5, 0.125 rpm for each bit."""
    return frame(ENGINE, [0xFF, 0xFF, 0xFF, *round(rpm / 0.125).to_bytes(2, "little")], source)


def pto(rpm: float) -> Frame:
    """Return a rear PTO speed (SPN 1883): bytes 1 and 2, 0.125 rpm for each bit."""
    return frame(PTO, [*round(rpm / 0.125).to_bytes(2, "little")])


def vehicle(speed: float) -> Frame:
    """Return a vehicle speed (SPN 84): bytes 2 and 3, 1/256 km/h for each bit."""
    return frame(VEHICLE, [0xFF, *round(256.0 * speed).to_bytes(2, "little")])


@pytest.fixture(scope="module")
def variables(environment: dict[str, str]) -> dict[str, str]:
    """Return an environment that has can_msgs."""
    definition = DEFINITION.partition("=====")[0]
    return environment_with(environment, built_package("can_msgs", {"Frame": definition}))


@pytest.fixture(scope="module")
def tractor(variables: dict[str, str], condition: str) -> Iterator["BusTractor"]:
    """Return a tractor whose hitch is always on the bus."""
    load = Load(variables, "topics")
    yield BusTractor(load, RATES[condition], always=True, topic=BUS)
    load.close()


def frames(tractor: Tractor, *hitches: Frame, others: tuple[Frame, ...] = ()) -> None:
    """Publish frames of the hitch at the rate of readings, and others at 20 Hz in turn."""
    tractor.publish(BUS, FRAME, hitches, tractor.rate if hitches else 0.0)
    # Another name of the topic is another stream of the same publisher's process.
    tractor.publish(f"/{BUS}", FRAME, others, SPEED_RATE * len(others))


class BusTractor(Tractor):
    """Publishes frames instead of joint states."""

    def reset(self) -> None:
        """Publish a hitch that stands at 40 %."""
        frames(self, hitch(40.0))


@pytest.fixture(scope="module")
def node(begin: Callable[..., Promised]) -> Promised:
    """Return a node with the parameters of the manual."""
    return begin("bus", reads=False, **CAN)


def set_parameters(node: Promised, **values: Any) -> None:
    """Set live parameters together."""
    messages = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
    service = "set_parameters_atomically"
    result = node.ask(service, SetParametersAtomically, parameters=messages).result
    assert result.successful, result.reason


def prediction(node: Promised, fits: Callable[[Any], bool]) -> Any:
    """Return the next prediction that fits."""
    received = node.listen("prediction", VibrationPrediction)
    node.peer.spin(lambda: any(map(fits, received)), "a prediction")
    return next(filter(fits, received))


def load_state(node: Promised, fits: Callable[[Any], bool]) -> Any:
    """Return the next load state that fits."""
    received = node.listen("load_state", LoadState)
    node.peer.spin(lambda: any(map(fits, received)), "a load state")
    return next(filter(fits, received))


@promise("can.md#live")
def test_hitch(node: Promised) -> None:
    """The hitch position of the bus is looked up in the calibration."""
    for percent, angle in ((0.0, 3.1), (40.0, 2.6), (100.0, 1.6)):
        frames(node.tractor, hitch(percent))
        found = prediction(node, lambda p, angle=angle: math.isclose(p.crank_angle, angle))
        assert found.status == Status.OK


@promise("can.md#live")
def test_speeds(node: Promised) -> None:
    """Speeds of engine, PTO and wheels come from the bus."""
    wheels = frame(WHEELS, [*(2500).to_bytes(2, "little")])
    frames(node.tractor, hitch(40.0), others=(engine(1800.0), pto(540.0), wheels))
    assert load_state(node, lambda s: unknown_speeds(s) == set())


@promise("can.md#signals-that-are-built-in")
def test_any_sender(node: Promised) -> None:
    """Frames are recognised by their parameter group, whoever sends them."""
    for source in (0x26, 0xF0):
        frames(node.tractor, hitch(0.0, source))
        prediction(node, lambda p: math.isclose(p.crank_angle, 3.1))
        frames(node.tractor, hitch(100.0, source))
        prediction(node, lambda p: math.isclose(p.crank_angle, 1.6))


@promise("can.md#signals-that-are-built-in")
def test_position_that_is_not_available(node: Promised) -> None:
    """A hitch position that is not available, reserved or an error has no numbers."""
    for raw in (0xFF, 0xFE, 0xFB):
        frames(node.tractor, frame(HITCH, [raw], 0xF0))
        found = prediction(node, lambda p: p.status == Status.INVALID_ANGLE)
        assert math.isnan(found.crank_angle)
        frames(node.tractor, hitch(40.0))
        prediction(node, lambda p: p.status == Status.OK)
    frames(node.tractor, frame(HITCH, [0xFA], 0xF0))  # 100 %, the largest value
    prediction(node, lambda p: math.isclose(p.crank_angle, 1.6))


@promise("can.md#signals-that-are-built-in")
def test_speed_that_is_not_available(node: Promised) -> None:
    """A PTO speed that is not available is unknown, and not a PTO at rest."""
    frames(node.tractor, hitch(40.0), others=(engine(1800.0), pto(540.0)))
    load_state(node, lambda s: "pto" not in unknown_speeds(s))
    frames(node.tractor, hitch(40.0), others=(engine(1800.0), frame(PTO, ABSENT)))
    load_state(node, lambda s: "pto" in unknown_speeds(s))
    frames(node.tractor, hitch(40.0), others=(engine(1800.0), pto(0.0)))
    load_state(node, lambda s: "pto" not in unknown_speeds(s))


@promise("can.md#signals-that-are-built-in")
def test_senders_that_disagree(node: Promised) -> None:
    """If senders of a speed disagree, the diagnostics name them; one can be chosen."""
    frames(node.tractor, hitch(40.0), others=(engine(1500.0, 0), engine(0.0, 1)))
    words = "(engine_speed@0x00: 1500 rpm, engine_speed@0x01: 0 rpm); set engine_field to one"
    node.wait_for_status("speeds", ERROR, words)
    set_parameters(node, engine_field="engine_speed@0x00")
    load_state(node, lambda s: "engine" not in unknown_speeds(s))
    status = node.next_status("speeds")
    node.peer.pause(2.0)
    status = node.next_status("speeds")
    assert "disagree" not in status.message
    set_parameters(node, engine_field="")


@promise("can.md#signals-that-are-built-in")
def test_hitches_that_disagree(node: Promised) -> None:
    """If senders of the hitch position disagree, the diagnostics name them."""
    frames(node.tractor, hitch(40.0), hitch(20.0, 0x26))
    node.wait_for_status("input", ERROR, "rear_hitch_position@0x26: ")
    set_parameters(node, hitch_field="rear_hitch_position@0xF0")
    node.peer.pause(1.0)
    received = node.listen("prediction", VibrationPrediction)
    node.peer.spin(lambda: len(received) > 20, "predictions")
    assert {p.crank_angle for p in received} == {AT_40}
    set_parameters(node, hitch_field="")


@promise("can.md#offline")
def test_remote_and_error_frames(node: Promised) -> None:
    """Remote frames and error frames have no values."""
    flagged = [hitch(100.0, **{flag: True}) for flag in ("is_rtr", "is_error")]
    frames(node.tractor, hitch(40.0), *flagged)
    received = node.listen("prediction", VibrationPrediction)
    node.peer.spin(lambda: len(received) > 20, "predictions")
    assert {p.crank_angle for p in received[5:]} == {AT_40}


@promise("can.md#live")
def test_vehicle_speed(node: Promised) -> None:
    """The vehicle speed can be the ground speed, in km/h."""
    frames(node.tractor, hitch(40.0), others=(vehicle(9.0),))
    load_state(node, lambda s: "ground" in unknown_speeds(s))
    set_parameters(node, ground_unit="km/h", ground_field="vehicle_speed")
    load_state(node, lambda s: "ground" not in unknown_speeds(s))
    set_parameters(node, ground_field="", ground_unit="")


@promise("can.md#live", kilohertz="the bus has no hitch position")
def test_fixed_position(node: Promised) -> None:
    """Without a position on the bus, a fixed one gives a prediction for each engine speed."""
    set_parameters(node, hitch_position=60.0)
    frames(node.tractor, others=(engine(1800.0),))
    received = node.listen("prediction", VibrationPrediction)
    node.peer.spin(lambda: len(received) > 20, "predictions")
    assert {each.status for each in received[5:]} == {Status.OK}
    [angle] = {each.crank_angle for each in received[5:]}
    assert 1.6 < angle < AT_40
    set_parameters(node, hitch_position=-1.0)


@promise("can.md#signals-that-are-built-in", kilohertz="the bus has no hitch position")
def test_bus_without_the_signal(node: Promised) -> None:
    """If no frame contains the hitch, the node warns with the parameter groups of the bus."""
    set_parameters(node, hitch_field="rear_hitch_position@0x77")
    frames(node.tractor, others=(engine(1800.0),))
    node.node.wait_for("No reading for more than 5 s")
    assert str(ENGINE) in node.node.printed.partition("No reading for more than 5 s")[2]
    set_parameters(node, hitch_field="")
