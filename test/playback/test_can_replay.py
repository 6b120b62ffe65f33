# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A log of a CAN bus is replayed and checked as any other bag."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from linkage_vibration.bags.message_columns import Columns, read_columns, topic_types
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import PREDICTION_TOPIC, RESONANCE_TOPIC
from linkage_vibration.playback.remapping import ReplayError
from linkage_vibration.playback.replay import Replayed, problems, replay, replay_summary
from linkage_vibration.prediction.settings import Parameters, with_values
from linkage_vibration.testing.bag_checks import check_bag
from linkage_vibration.testing.limits import Limits
from test.playback.test_replay import float64, write_mcap
from test.support.can_bus import (
    EPOCH,
    BusFrame,
    identifier,
    recorded_frames,
    synthetic_hitch,
    write_candump,
)

pytest.importorskip("can", reason="logs of a CAN bus are read by python-can (extra can)")
ON_CAN = Parameters(hitch_input="can", engine_input="can", pto_input="can", ground_input="can")
SECOND = 10**9


def lift(seconds: int = 40) -> list[BusFrame]:
    """Return a synthetic lift of the hitch at 10 Hz, as no tractor has sent it."""
    times = [EPOCH + k * SECOND // 10 for k in range(10 * seconds)]
    raw = [round(125 + 120 * np.sin(k / 40)) for k in range(len(times))]
    return synthetic_hitch(times, raw)


def engine(seconds: int = 4, source: int = 0, rpm: float = 1800.0) -> list[BusFrame]:
    """Return engine speeds at 50 Hz."""
    raw = round(8 * rpm).to_bytes(2, "little")
    number, data = identifier(61444, source), b"\xff\xff\xff" + raw + b"\xff\xff\xff"
    return [BusFrame(EPOCH + k * SECOND // 50, number, data) for k in range(50 * seconds)]


def replayed(
    tmp_path: Path, frames: list[BusFrame], settings: Parameters = ON_CAN, **remaps: str
) -> tuple[Replayed, dict[str, Columns]]:
    """Return what a replay of frames has done, and its answers."""
    bag = write_candump(tmp_path / "bus.log", frames)
    done = replay(bag, tmp_path / "out.mcap", settings, remaps)
    types = topic_types(tmp_path / "out.mcap")
    return done, read_columns(tmp_path / "out.mcap", types)


def relayed(path: Path, frames: list[BusFrame]) -> Path:
    """Return a bag with what a relay would have published for frames, decoded by hand."""
    entries = []
    for time, number, data in ((f.time, f.identifier >> 8 & 0x3FFFF, f.data) for f in frames):
        first = int.from_bytes(data[0:2], "little")
        if number == 65093:
            entries.append(("/hitch_position", time, 0.4 * data[0]))
        elif number == 61444:
            raw = int.from_bytes(data[3:5], "little")
            entries.append(("/engine_speed", time, 0.125 * raw if raw < 0xFB00 else np.nan))
        elif number == 65091:
            entries.append(("/pto_speed", time, 0.125 * first if first < 0xFB00 else np.nan))
        elif number == 65096:
            entries.append(("/ground_speed", time, 0.001 * first if first < 0xFB00 else np.nan))
    kind = "std_msgs/msg/Float64"
    messages = [(topic, kind, time, float64(value)) for topic, time, value in entries]
    return write_mcap(path, sorted(messages, key=lambda entry: entry[2]))


def assert_same_answers(actual: dict[str, Columns], other: dict[str, Columns]) -> None:
    """Fail unless predictions and resonances are the same, whatever the frame of their headers."""
    for topic in (PREDICTION_TOPIC, RESONANCE_TOPIC):
        for name, column in actual[topic].items():
            if name not in ("header.frame_id", "place"):
                np.testing.assert_array_equal(column, other[topic][name], err_msg=name)


def test_frames_of_a_tractor_with_a_synthetic_hitch(tmp_path: Path) -> None:
    """The frames of a real tractor give the answers that a relay of decoded numbers gives.

    They contain no hitch position, so a synthetic one is added.
    """
    frames = [*recorded_frames(), *lift()]
    done, actual = replayed(tmp_path, frames)
    assert done.predictions == done.with_numbers == 400
    assert len(actual["/can0"]["id"]) == 400 + 2190 + 241
    relay = relayed(tmp_path / "relay.mcap", frames)
    replay(relay, tmp_path / "relayed.mcap", Parameters(hitch_input="percent"))
    topics = dict.fromkeys((PREDICTION_TOPIC, RESONANCE_TOPIC))
    types = {t: k for t, k in topic_types(tmp_path / "relayed.mcap").items() if t in topics}
    assert_same_answers(actual, read_columns(tmp_path / "relayed.mcap", types))
    # The excitations of a PTO whose speed is not available are stale, not at rest.
    words = "6 messages have no value: rear_pto_speed is not available (0xFFFF)"
    assert words in replay_summary(done)


def test_source_address(tmp_path: Path) -> None:
    """Of two senders that disagree, the chosen one is used; otherwise the later one is."""
    frames = [*lift(4), *engine(rpm=1800.0), *engine(source=1, rpm=1000.0)]
    speeds = {}
    for field in ("", "engine_speed@0", "engine_speed@0x01"):
        settings = with_values(ON_CAN, {"engine_field": field})
        _, actual = replayed(tmp_path, frames, settings)
        n = len(actual["/can0"]["id"])
        speeds[field] = n, np.unique(actual[RESONANCE_TOPIC]["excitation_frequency"])
    assert speeds["engine_speed@0"][0] == speeds["engine_speed@0x01"][0] == 40 + 200
    assert speeds[""][0] == 40 + 400
    assert not np.array_equal(speeds["engine_speed@0"][1], speeds["engine_speed@0x01"][1])


def test_fixed_hitch_position(tmp_path: Path) -> None:
    """Without a hitch on the bus, each engine speed gives a prediction at the fixed position.

    40 % is between 0 % (pi) and 100 % (a right angle) of a calibration with two pairs, a line.
    """
    bus = recorded_frames()
    speeds = [frame for frame in bus if frame.identifier >> 8 & 0x3FFFF == 61444]
    vehicle = {"ground_field": "vehicle_speed", "ground_unit": "km/h"}
    fixed = with_values(ON_CAN, {"hitch_position": 40.0, **vehicle})
    done, columns = replayed(tmp_path, bus, fixed)
    actual = columns[PREDICTION_TOPIC]
    assert done.predictions == len(speeds) > 0
    np.testing.assert_allclose(
        actual["crank_angle"], 3.14159 + 0.4 * (1.5708 - 3.14159), atol=1e-12
    )
    stamps = 10**9 * actual["header.stamp.sec"].astype(np.int64) + actual["header.stamp.nanosec"]
    assert stamps.tolist() == sorted(frame.time for frame in speeds)
    assert done.resonances > 0
    assert "CAN signal vehicle_speed" not in done.missing
    # Another field of the hitch only says when; the reserved value of the group is no position.
    named = {"hitch_field": "rear_pto_speed", "ground_speed": 2.0, "engine_speed": 1800.0}
    silent = [BusFrame(EPOCH, identifier(65091), 8 * b"\xff")]
    _, columns = replayed(tmp_path, silent, with_values(fixed, named))
    assert columns[PREDICTION_TOPIC]["crank_angle"].tolist() == actual["crank_angle"][:1].tolist()


@pytest.mark.parametrize(("rpm", "percent"), [(1861.0, 53.2), (1859.0, 51.6)])
def test_senders_that_disagree(tmp_path: Path, rpm: float, percent: float) -> None:
    """Two engines and two hitches are named if their values differ, unless one is chosen.

    Engines that send each 20 ms agree up to 50 + 500 * 0.02 rpm, and hitches that send each 0.1 s
    up to 0.03 + 0.5 * 0.1 rad (5.1 % of a quarter turn), if a step is no jump (from 3.8 % on).
    """
    times = [EPOCH + k * SECOND // 10 for k in range(40)]
    hitches = (
        synthetic_hitch(times, [120] * 40),
        synthetic_hitch(times, [round(percent / 0.4)] * 40, 0x26),
    )
    frames = [*hitches[0], *hitches[1], *engine(rpm=1800.0), *engine(source=1, rpm=rpm)]
    actual = problems(replayed(tmp_path, frames)[0])
    assert bool(actual) == (rpm == 1861.0)
    if actual:
        of_hitch, of_engine = sorted(actual)
        assert "CAN signal rear_hitch_position on /can0 disagree (" in of_hitch
        assert "rear_hitch_position@0x26: " in of_hitch
        assert "(engine_speed@0x00: 1800 rpm, engine_speed@0x01: 1861 rpm); set eng" in of_engine
    chosen = {"hitch_field": "rear_hitch_position@0xF0", "engine_field": "engine_speed@0x00"}
    assert not problems(replayed(tmp_path, frames, with_values(ON_CAN, chosen))[0])


def test_sender_that_is_not_available(tmp_path: Path) -> None:
    """An engine that is available on one sender alone is named; one sender alone agrees."""
    silent = engine(source=1, rpm=8191.875)  # 0xFFFF
    found = problems(replayed(tmp_path, [*lift(4), *engine(rpm=1800.0), *silent])[0])
    words = "disagree (engine_speed@0x00: 1800 rpm, engine_speed@0x01: not available); set engine_"
    assert words in found[0]
    [alone] = problems(replayed(tmp_path, [*lift(4), *silent])[0])
    assert "engine speed on /can0 is nan, so that it is not known" in alone


def test_groups_of_a_bus_without_a_hitch(tmp_path: Path) -> None:
    """The error says how many groups it does not list; a group with destinations counts once."""
    groups = [(0xEA00 | destination) for destination in range(9)] + list(range(65200, 65224))
    frames = [BusFrame(EPOCH, identifier(group), bytes(8)) for group in groups]
    with pytest.raises(ReplayError, match=r"parameter group 59904, .*65218 and 5 more\. It is in"):
        replayed(tmp_path, frames)


def test_hitch_that_is_not_available(tmp_path: Path) -> None:
    """A hitch that sends "error" and "not available" gives predictions without numbers."""
    raw = [125] * 10 + [0xFE] * 10 + [0xFF] * 10 + [126] * 10
    times = [EPOCH + k * SECOND // 10 for k in range(40)]
    done, actual = replayed(tmp_path, synthetic_hitch(times, raw))
    invalid = np.isnan(actual[PREDICTION_TOPIC]["crank_angle"])
    np.testing.assert_array_equal(invalid, np.array(raw) > 0xFA)
    assert "20 messages have no value: rear_hitch_position is an error (0xFE)" in replay_summary(
        done
    )
    assert problems(done)


def test_dbc_file(tmp_path: Path) -> None:
    """An input reads any signal of a DBC file, also big-endian, in degrees."""
    dbc = tmp_path / "arm.dbc"
    text = 'VERSION ""\nBO_ 291 Arm: 4 Vector__XXX\n SG_ Angle : 15|16@0- (0.01,0) [0|0] "deg" X\n'
    dbc.write_text(text)
    degrees = 130.0 + 20.0 * np.sin(np.arange(50) / 10)
    frames = [
        BusFrame(EPOCH + k * SECOND // 50, 291, b"\7" + round(100 * deg).to_bytes(2) + b"\0", False)
        for k, deg in enumerate(degrees.tolist())
    ]
    values = {"can_database": str(dbc), "hitch_field": "Arm.Angle", "hitch_unit": "deg"}
    _, actual = replayed(tmp_path, frames, with_values(ON_CAN, values))
    angles = np.rad2deg(actual[PREDICTION_TOPIC]["crank_angle"])
    np.testing.assert_allclose(angles, np.round(degrees, 2), rtol=1e-12)


FAULTS: dict[str, tuple[dict[str, str], str]] = {
    "unit": (
        {"ground_field": "wheel_based_speed", "ground_unit": "km/h"},
        r"wheel_based_speed is in m/s, but ground_unit is km/h; write `ground_unit: m/s`",
    ),
    "force": ({"hitch_field": "rear_draft"}, r"rear_draft is a force; write rear_hitch_position"),
    "force in percent": (
        {"hitch_field": "rear_lower_link_force"},
        r"hitch_field: rear_lower_link_force is a force; write rear_hitch_position",
    ),
    "not there": (
        {"hitch_field": "front_hitch_position"},
        r"/can0 has no CAN signal front_hitch_position; it has parameter group 61444, parameter "
        r"group 65093. It is in frames of parameter group 65094;",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults(tmp_path: Path, fault: str) -> None:
    """An error names the signal, and what there is instead."""
    values, words = FAULTS[fault]
    with pytest.raises(LinkageVibrationError, match=words):
        replayed(tmp_path, [*lift(1), *engine(1)], with_values(ON_CAN, values))


def test_two_channels(tmp_path: Path) -> None:
    """If a log has two channels, the channel has to be chosen."""
    frames = [*lift(2), *(replace(frame, channel="can1") for frame in engine(2))]
    with pytest.raises(ReplayError, match=r"2 topics .*from_can_bus:=/can0.*: /can0, /can1"):
        replayed(tmp_path, frames)
    done, _ = replayed(tmp_path, frames, from_can_bus="/can0")
    assert done.predictions == 20
    assert not done.resonances
    assert "no message contains CAN signal engine_speed; no message contains CAN" in replay_summary(
        done
    )
    settings = with_values(ON_CAN, {"engine_topic": "/can1", "hitch_topic": "/can0"})
    done, _ = replayed(tmp_path, frames, settings, from_can_bus="/can0")
    assert done.resonances == 19  # the first reading comes before the first speed


def test_check_bag(tmp_path: Path) -> None:
    """A CAN log is checked against limits as any other bag."""
    bag = write_candump(tmp_path / "bus.log", [*lift(), *engine(40)])
    assert check_bag(bag, Limits(gap=0.11), ON_CAN).passed
    assert not check_bag(bag, Limits(gap=0.09), ON_CAN).passed
