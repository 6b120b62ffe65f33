# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Replays equal the results of the single parts, and report what a bag lacks."""

import math
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.bags.reading import BagError
from linkage_vibration.bags.recorder import PROVENANCE_METADATA
from linkage_vibration.cli.main import main
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import (
    LEVELS_TOPIC,
    LOAD_STATE_TOPIC,
    PREDICTION,
    PREDICTION_TOPIC,
    RESONANCE,
    RESONANCE_TOPIC,
    log_topic,
)
from linkage_vibration.playback.remapping import ReplayError, remappings
from linkage_vibration.playback.replay import WhatIf, problems, replay
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs.units import HitchCurve, HitchScale
from linkage_vibration.prediction.levels import kept_levels
from linkage_vibration.prediction.motion import crank_filter, crank_resolution
from linkage_vibration.prediction.parameter_files import read_parameters
from linkage_vibration.prediction.predictor import Predictor, Status
from linkage_vibration.prediction.resonance import ResonanceMonitor, described
from linkage_vibration.prediction.settings import ParameterError, Parameters, with_values
from linkage_vibration.prediction.severity import ResonanceState
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.review import log as logs
from linkage_vibration.review.findings import first_sentence
from linkage_vibration.review.log import problems as log_problems
from linkage_vibration.review.log import read_log
from linkage_vibration.review.overview import drive_summary, overview_html
from linkage_vibration.review.review_page import review_page
from linkage_vibration.support.atomic_files import OutputError
from linkage_vibration.support.resources import (
    DEFAULT_EXCITATIONS,
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    config_file,
)
from linkage_vibration.table.table import load_table
from linkage_vibration.testing.bag_checks import check_bag
from linkage_vibration.testing.limits import Limits
from test.support.messages import read_messages
from test.support.motions import MOTIONS, PERCENT, read

DRIVE = config_file("drives/hitch_duty_cycle.mcap")
JOINT = "hitch_rockshaft_joint"
STORE = get_typestore(Stores.LATEST)
START = 1_700_000_000 * 10**9

Entry = tuple[str, str, int, Any]  # topic, type, log time, message


def joint_state(time: int, name: list[str], position: list[float], **others: list[float]) -> Any:
    """Return a joint state for rosbags."""
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=time // 10**9, nanosec=time % 10**9)
    header = STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="base")
    arrays = {key: np.array(others.get(key, []), float) for key in ("velocity", "effort")}
    numbers = np.array(position, float)
    return STORE.types[JOINT_STATE](header=header, name=name, position=numbers, **arrays)


def float64(value: float) -> Any:
    """Return a number for rosbags."""
    return STORE.types[FLOAT64](data=value)


def write_mcap(path: Path, entries: Iterable[Entry]) -> Path:
    """Write messages."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=20_000)
        writer.start("ros2", "test")
        channels: dict[str, int] = {}
        for topic, kind, time, message in entries:
            if topic not in channels:
                text = STORE.generate_msgdef(kind, ros_version=2)[0].encode()
                schema = writer.register_schema(kind, "ros2msg", text)
                about = {"offered_qos_profiles": ""}
                channels[topic] = writer.register_channel(topic, "cdr", schema, about)
            data = message
            if not isinstance(message, bytes):
                data = bytes(STORE.serialize_cdr(message, kind))
            writer.add_message(channels[topic], time, data, time - 1000)
        writer.finish()
    return path


def swing(count: int, topic: str = "/joint_states", joint: str = JOINT) -> list[Entry]:
    """Return a swing of a joint at 1 kHz, a little beyond the range of the table."""
    actual = []
    for k in range(count):
        time = START + k * 10**6
        position = 2.35 + 0.8 * np.sin(k / 50)
        names = [joint, "other"] if k % 7 else ["other", joint]
        values = [position, 9.0] if k % 7 else [9.0, position]
        actual.append((topic, JOINT_STATE, time, joint_state(time, names, values, velocity=values)))
    return actual


def data_of(log: Path, topic: str) -> list[tuple[int, bytes]]:
    """Return log times and bytes of a topic."""
    with log.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages([topic])
        return [(message.log_time, message.data) for *_, message in messages]


def windows(assessed: list[tuple[int, tuple[int, int, str], Any]]) -> Iterator[tuple[int, bytes]]:
    """Yield log times and bytes of the resonances of readings without gaps, one in each 20 ms.

    Each has a log time, a header and a resonance. Of those after the first reading of a period of
    100 ms up to that of the next one, the most severe counts, and the last if its state differs.
    """

    def severity(each: tuple[int, tuple[int, int, str], Any]) -> tuple[Any, ...]:
        last = described(each[2])
        load = float(last.total_load_ratio)
        order = ResonanceState.CLEAR, ResonanceState.UNKNOWN, ResonanceState.NOTE
        margin = -abs(last.relative_margin)
        return order.index(last.state), load >= 0.0, load if load >= 0.0 else margin

    window, period = [], -1
    for each in assessed:
        time, (sec, nanosec, _), _ = each
        before, period = period, (10**9 * sec + nanosec) // 100_000_000
        window.append(each)
        if period != before:
            worst = max(reversed(window), key=severity)
            for _, header, resonance in [worst] + [each] * (each[2].state != worst[2].state):
                yield time, encode_message(RESONANCE, resonance, *header)
            window.clear()


def test_same_as_one_by_one(tmp_path: Path) -> None:
    """Predictions and resonances are those of the parts of the node, byte for byte."""
    entries = swing(3000)
    for k in range(0, 3000, 50):
        entries.append(("/engine_speed", FLOAT64, START + k * 10**6, float64(800.0 + k)))
    entries.append(("/pto_speed", FLOAT64, START + 10**9, float64(540.0)))
    entries.sort(key=lambda entry: entry[2])
    bag, log = write_mcap(tmp_path / "bag.mcap", entries), tmp_path / "log.mcap"
    settings = Parameters(hitch_sign=-1, hitch_scale=0.9, hitch_offset=4.6, angle_stddev=1e-3)
    done = replay([bag], log, settings)

    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    excitations = read_excitations(config_file("excitations.yaml"))
    levels = kept_levels(predictor, read_mechanism(config_file(DEFAULT_MECHANISM)), excitations)
    monitor = ResonanceMonitor(excitations, levels=levels)
    rule = HitchScale("rad", -1, 0.9, 4.6, angle_stddev=1e-3)
    sources = {"/engine_speed": Source.ENGINE, "/pto_speed": Source.PTO}
    predictions, assessed, statuses, period = [], [], set(), -1
    for topic, _, time, message in entries:
        if topic in sources:
            monitor.set_speed(sources[topic], message.data, time)
            continue
        at = message.name.index(JOINT)
        reading = rule.reading(float(message.position[at]), float(message.velocity[at]))
        prediction = predictor.predict(reading.crank_angle, reading.stddev)
        statuses.add(prediction.status)
        header = message.header.stamp.sec, message.header.stamp.nanosec, "base"
        predictions.append((time, encode_message(PREDICTION, prediction, *header)))
        stamp = 10**9 * header[0] + header[1]
        if monitor.any_speed_reported and stamp // 20_000_000 != period:  # ns, of 50 Hz
            period = stamp // 20_000_000
            assessed.append((time, header, monitor.assess(prediction, reading.velocity, time)))
    resonances = [*windows(assessed)]
    assert {Status.OK, Status.OUT_OF_RANGE} <= statuses
    assert data_of(log, PREDICTION_TOPIC) == predictions
    assert data_of(log, RESONANCE_TOPIC) == resonances
    assert (done.predictions, done.resonances) == (len(predictions), len(resonances))
    for topic in ("/joint_states", "/engine_speed", "/pto_speed"):
        assert data_of(log, topic) == data_of(bag, topic)


def test_motion_that_is_estimated(tmp_path: Path) -> None:
    """Without velocities in the bag, resonances are those of estimates one by one."""
    stamps, angles, _, _ = read(MOTIONS["lift in 2.5 s"], PERCENT, 1)
    calibration = (0.0, math.pi, 100.0, math.pi / 2.0)
    percents = [0.4 * round((math.pi - angle) / PERCENT.step) for angle in angles]
    entries = []
    for stamp, percent in zip(stamps, percents, strict=True):
        entries.append(
            ("/engine_speed", FLOAT64, stamp - 1000, float64(900.0 + 1e-7 * stamp % 600))
        )
        entries.append(("/hitch_position", FLOAT64, stamp, float64(percent)))
    bag, log = write_mcap(tmp_path / "bag.mcap", entries), tmp_path / "log.mcap"
    settings = Parameters(hitch_input="percent", calibration=calibration, angle_stddev=1e-3)
    replay([bag], log, settings)

    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    excitations = read_excitations(config_file("excitations.yaml"))
    levels = kept_levels(predictor, read_mechanism(config_file(DEFAULT_MECHANISM)), excitations)
    monitor, crank = ResonanceMonitor(excitations, levels=levels), crank_filter()
    scale = HitchScale("percent", calibration=HitchCurve(calibration), angle_stddev=1e-3)
    assessed, directions, period = [], set(), -1
    for topic, _, time, message in entries:
        if topic == "/engine_speed":
            monitor.set_speed(Source.ENGINE, message.data, time)
            continue
        reading = scale.reading(message.data)
        prediction = predictor.predict(reading.crank_angle, reading.stddev)
        resolution = crank_resolution(reading.stddev, 1e-3)
        velocity, error = crank.add(time, reading.crank_angle, resolution)()
        if time // 20_000_000 == period:  # ns, of 50 Hz
            continue
        period = time // 20_000_000
        resonance = monitor.assess(prediction, velocity, time, error)
        directions.add(int(described(resonance).approach))
        assessed.append((time, (*divmod(time, 10**9), ""), resonance))
    assert data_of(log, RESONANCE_TOPIC) == [*windows(assessed)]
    assert directions > {0}


def test_a_log_replayed_is_the_same_log(tmp_path: Path) -> None:
    """A log contains all that its replay needs, and a second replay has the same bytes."""
    first, second = tmp_path / "first.mcap", tmp_path / "second.mcap"
    replay([DRIVE], first, Parameters())
    replay([first], second, Parameters())
    for topic in (PREDICTION_TOPIC, RESONANCE_TOPIC, "/joint_states"):
        assert data_of(first, topic) == data_of(second, topic) != []
    with first.open("rb") as file:
        reader = make_reader(file)
        attached = {attachment.name: attachment.data for attachment in reader.iter_attachments()}
    assert attached["excitations.yaml"] == config_file(DEFAULT_EXCITATIONS).read_bytes()
    (tmp_path / "parameters.yaml").write_bytes(attached["parameters.yaml"])
    assert read_parameters(tmp_path / "parameters.yaml") == Parameters()
    name = f"{load_table(config_file(DEFAULT_TABLE)).table_id}.npz"
    assert attached[name] == config_file(DEFAULT_TABLE).read_bytes()


@pytest.mark.parametrize("own", [True, False])
def test_clock_that_jumped_back(tmp_path: Path, own: bool) -> None:
    """A log is read in the order in which it was written, and another bag in that of its times.

    Stamps in order of their times are in fewer periods of `resonance_rate`, here 100 ms. What waits
    before each of two jumps has a message of its own.
    """
    with DRIVE.open("rb") as file:
        entries = list(make_reader(file).iter_messages())[:120]  # 1 s
    topics = {c.topic: log_topic(c.topic, s.name) for s, c, _ in entries}  # type: ignore[union-attr]
    looped, output = tmp_path / "looped.mcap", tmp_path / "output.mcap"
    with LogWriter(looped, list(topics.values())) as log:
        log.add_metadata(PROVENANCE_METADATA if own else "another", {})
        for _, channel, message in 3 * entries:
            log.write(channel.topic, message.data, message.log_time, message.publish_time)
    done = replay(looped, output)
    with output.open("rb") as file:
        actual = make_reader(file).iter_messages([PREDICTION_TOPIC], log_time_order=False)
        times = [message.log_time for *_, message in actual]
    readings = [m.log_time for _, channel, m in entries if channel.topic == "/joint_states"]
    assert times == (3 * readings if own else sorted(3 * readings))
    assert done.resonances == (3 * 10 + 2 if own else 10)


@pytest.mark.parametrize("apart", [0.039, 0.041])
def test_readings_that_go_to_and_fro(tmp_path: Path, apart: float) -> None:
    """Predictions remain, but no load is known where readings go to and fro by over 0.04 rad.

    That is 0.03 rad of noise, and 0.5 rad/s for 0.02 s.
    """
    entries: list[Entry] = []
    for k in range(100):
        time = START + k * 20_000_000
        angle = 2.0 + apart * (k % 2) * (k >= 50)
        entries.append(("/joint_states", JOINT_STATE, time, joint_state(time, [JOINT], [angle])))
        if k % 5 == 0:
            entries += [(f"/{s}_speed", FLOAT64, time, float64(500.0)) for s in ("engine", "pto")]
    log = tmp_path / "log.mcap"
    settings = Parameters(ground_speed=0.0, resonance_rate=0.0)
    done = replay(write_mcap(tmp_path / "bag.mcap", entries), log, settings)
    assert done.statuses[Status.OK] == 100
    states = [m for _, m in read_messages(log, "/linkage_vibration/load_state")]
    # The fifth change of side is number 56: those before are 52 to 55, and 51 is only a step.
    crank = [bool(m.unknown_sources & 1) for m in states]
    assert crank == [False] * 56 + [apart > 0.04] * 44
    assert {m.state for m in states[56:]} == {0 if apart > 0.04 else 1}
    report = check_bag(log, Limits())
    assert report.passed == (apart < 0.04)
    for sentences in (problems(done), log_problems(read_log(log)), [str(report)]):
        assert any("go to and fro" in sentence for sentence in sentences) == (apart > 0.04)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("frozen", "turned the crank by 0.29 rad, but the position by 0 rad"),
        pytest.param(
            "degrees", "are in degrees (115), but radians are expected", marks=pytest.mark.nightly
        ),
        ("none", ""),
    ],
)
def test_what_the_judge_finds_stands_in_every_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str, words: str
) -> None:
    """Replay, log, page, JSON and both checks have the same sentences, and none is green.

    Of an angle that is doubted all the time, no moment is the worst one. A log of
    the node does not hold what a replay found; its inputs are judged when it is read.
    """
    entries: list[Entry] = []
    for k in range(250):
        time = START + k * 20_000_000
        angle = 115.0 if fault == "degrees" else 2.0
        velocity = [0.3] if fault == "frozen" else [0.0]
        reading = joint_state(time, [JOINT], [angle], velocity=velocity)
        entries.append(("/joint_states", JOINT_STATE, time, reading))
        entries.append(("/engine_speed", FLOAT64, time, float64(1500.0)))
    bag, log = write_mcap(tmp_path / "bag.mcap", entries), tmp_path / "log.mcap"
    settings = Parameters(ground_speed=0.0, pto_speed=0.0)
    done, limits = replay(bag, log, settings), Limits(load_ratio=0.33)
    read = read_log(log)
    found = done.input_faults
    assert [words in sentence for sentence in found] == [True] * bool(words)
    reports = [check_bag(log, limits), check_bag(bag, limits, settings)]
    summary, page = drive_summary(read), review_page(read).content
    for each in reports:
        failed = [f"{f.words}." for f in each.failures if f.limit == "input_faults"]
        assert (failed, each.input_faults) == (found, ())
    allowed = check_bag(log, replace(limits, input_faults=1, statuses=None, known_share=None))
    assert allowed.passed == (fault != "degrees")  # no load is known there
    assert [*read.input_faults] == [*allowed.input_faults] == found
    assert (summary["worst"] is None) == (fault != "none")
    assert ("No moment is named" in summary["sentence"]) == (fault == "frozen")
    assert summary["input_faults"] == page["inputs"] == found
    sound = fault == "none"
    assert page["calm"] == sound
    assert (" class=calm" in overview_html([(summary, "log.html")], [])) == sound
    assert page["answer"].startswith("No load exceeded") == sound
    assert str(reports[0]).endswith("within their limits") == sound
    monkeypatch.setattr(logs, "FAULTS_METADATA", "other")
    assert read_log(log).faults == read.faults


def test_a_doubted_reading_is_not_the_worst(tmp_path: Path) -> None:
    """A noisy angle is frozen from 8 to 14 s, where the engine loads the linkage most.

    Page and JSON, and each limit of a check that another moment exceeds, name another one.
    """
    noise = 2.0 + 1e-3 * np.random.default_rng(1).standard_normal(1000)
    noise[400:700] = 2.01
    entries: list[Entry] = []
    for k, angle in enumerate(noise.tolist()):
        time = START + k * 20_000_000
        entries.append(("/joint_states", JOINT_STATE, time, joint_state(time, [JOINT], [angle])))
        engine = 1990.0 if 450 <= k < 650 else 1000.0 + 0.1 * k
        entries.append(("/engine_speed", FLOAT64, time, float64(engine)))
    bag, path = write_mcap(tmp_path / "bag.mcap", entries), tmp_path / "log.mcap"
    replay(bag, path, Parameters(ground_speed=0.0, pto_speed=0.0))
    log, loads, velocities = read_log(path), dict[float, float](), dict[float, float]()
    for _, message in read_messages(path, LEVELS_TOPIC):
        stamp = message.header.stamp
        at = stamp.sec - START // 10**9 + 1e-9 * stamp.nanosec
        loads[at], velocities[at] = message.total_load_ratio, message.total_velocity
    worst, limits = drive_summary(log)["worst"], Limits(input_faults=None, known_share=0.9)
    for values, limit in ((loads, "load_ratio"), (velocities, "velocity")):
        largest = max(values, key=values.__getitem__)
        of_sound = {at: v for at, v in values.items() if not 7.99 < at < 14.0}
        sound = max(of_sound, key=of_sound.__getitem__)
        assert 8.0 < largest < 14.0
        assert limit == "velocity" or worst["time_s"] == pytest.approx(sound, abs=0.01)
        # Between both, only doubted ones exceed a limit, which is then exceeded all the same.
        for most, at in ((0.0, sound), (0.5 * (values[sound] + values[largest]), largest)):
            [failure] = check_bag(path, replace(limits, **{limit: most})).failures
            assert failure.limit == limit
            assert (7.99 < failure.seconds < 14.0) == (at == largest)
            assert at == largest or failure.seconds == pytest.approx(at, abs=0.01)
    angles = np.degrees(noise)
    angles[400:700] = 0.0
    largest, when = float(angles.max()), 0.02 * int(angles.argmax())
    for most, at in ((largest - 1e-3, when), (largest + 1e-3, 8.0)):
        [failure] = check_bag(path, replace(limits, crank_angle_deg=(0.0, most))).failures
        assert failure.seconds == pytest.approx(at, abs=0.01)
    assert "The largest that is not doubted was" in first_sentence(log)
    assert len(log.faults) == 1


def test_a_clock_that_stood_still(tmp_path: Path) -> None:
    """No load is known more than 1 s of stamps after the log time stood still, until it goes on."""
    entries: list[Entry] = []
    for k in range(200):
        stamp = START + k * 20_000_000
        logged = min(stamp, START + 10**9) if k < 190 else stamp
        entries.append(("/joint_states", JOINT_STATE, logged, joint_state(stamp, [JOINT], [2.0])))
    log = tmp_path / "log.mcap"
    speeds = {"ground_speed": 0.0, "engine_speed": 500.0, "pto_speed": 0.0}
    fixed = with_values(Parameters(), speeds | {"resonance_rate": 0.0})
    replay(write_mcap(tmp_path / "bag.mcap", entries), log, fixed)
    states = [m for _, m in read_messages(log, "/linkage_vibration/load_state")]
    # The log time stands from number 50 on, and 100 is exactly 1 s later.
    crank = [bool(m.unknown_sources & 1) for m in states]
    assert crank == [False] * 101 + [True] * 89 + [False] * 10


def test_predictions_at_a_rate(tmp_path: Path) -> None:
    """At 10 Hz the log has the first prediction in each tenth of a second, and all else as before.

    Each load state belongs to a resonance, and has the total of its levels.
    """
    each, some = tmp_path / "each.mcap", tmp_path / "some.mcap"
    replay([DRIVE], each, Parameters())
    done = replay([DRIVE], some, Parameters(prediction_rate=10.0))
    expected = {}
    for time, message in read_messages(each, PREDICTION_TOPIC):
        period = message.header.stamp.sec, message.header.stamp.nanosec // 10**8
        expected.setdefault(period, (time, message.crank_angle))
    actual = [(time, m.crank_angle) for time, m in read_messages(some, PREDICTION_TOPIC)]
    assert actual == list(expected.values())
    assert done.predictions == len(actual) == len(data_of(each, PREDICTION_TOPIC)) // 10
    for topic in (RESONANCE_TOPIC, LOAD_STATE_TOPIC, "/joint_states"):
        assert data_of(some, topic) == data_of(each, topic) != []
    topics = RESONANCE_TOPIC, LEVELS_TOPIC, LOAD_STATE_TOPIC
    columns = zip(*(read_messages(each, topic) for topic in topics), strict=True)
    for count, ((_, resonance), (_, levels), (_, state)) in enumerate(columns, 1):
        stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in (resonance, levels, state)}
        assert len(stamps) == 1
        assert state.count == count
        assert state.state == 0 or state.state >= max(levels.states)
        np.testing.assert_equal(levels.total_load_ratio, state.total_load_ratio)


def test_mass_that_is_too_large(tmp_path: Path) -> None:
    """A mass beside which the links lose their digits is refused, and nothing is written."""
    with pytest.raises(LinkageVibrationError, match="the links lose their digits"):
        replay(DRIVE, tmp_path / "log.mcap", what_if=WhatIf(mass=1e9, inertia=3e8))
    assert not list(tmp_path.iterdir())


@pytest.mark.nightly(alone="both replays tabulate the ground anew")
def test_threads_change_no_byte(tmp_path: Path) -> None:
    """A replay from Python has the same bytes with one and with four threads of BLAS."""
    code = (
        "import sys, linkage_vibration as lv\n"
        "lv.replay(sys.argv[1], sys.argv[2], lv.Parameters(ground_speed=7.0))"
    )
    drive, logs = config_file("drives/hitch_duty_cycle.mcap"), list[bytes]()
    for threads in ("1", "4"):
        log, own = tmp_path / f"{threads}.mcap", {"XDG_CACHE_HOME": str(tmp_path / threads)}
        environment = {**os.environ, **own, "OPENBLAS_NUM_THREADS": threads}
        command = [sys.executable, "-c", code, str(drive), str(log)]
        subprocess.run(command, env=environment, check=True)
        logs.append(log.read_bytes())
    assert logs[0] == logs[1]


def test_what_if_the_implement_were_heavier(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A heavier implement lowers the first natural frequency; the log contains its mechanism.

    Also from Python, bars show how much of its table is built and how many messages are done.
    """
    built, done = list[float](), list[int]()
    bars = {
        "linkage_vibration.table.tabulation.building.table_bar": nullcontext(built.append),
        "linkage_vibration.playback.replay.shown_bar": nullcontext(
            SimpleNamespace(update=done.append)
        ),
    }
    bag, log = write_mcap(tmp_path / "bag.mcap", swing(20)), tmp_path / "log.mcap"
    settings = Parameters(mechanism_file=str(config_file("three_point_linkage.yaml")))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))  # so that its table is built
    replay([bag], log, settings)
    before = [m.natural_frequencies[0] for _, m in read_messages(log, PREDICTION_TOPIC)]
    for name, bar in bars.items():
        monkeypatch.setattr(name, lambda *_, bar=bar: bar)
    replay([bag], log, settings, what_if=WhatIf(mass=1200.0))
    assert len(built) > 10
    assert sum(done) == 20
    after = [m.natural_frequencies[0] for _, m in read_messages(log, PREDICTION_TOPIC)]
    ratio = np.array(after) / np.array(before)
    assert np.all(ratio[np.isfinite(ratio)] < 0.99)
    with log.open("rb") as file:
        attached = {a.name: a.data for a in make_reader(file).iter_attachments()}
    bodies = yaml.safe_load(attached["mechanism.yaml"])["rigid_bodies"]
    assert [body["mass"] for body in bodies.values()] == [1200.0]


def test_messages_left_out_are_counted(tmp_path: Path) -> None:
    """Other joints, a missing position and damaged bytes do not end the replay."""
    entries = swing(10)
    time = START + 10**9
    entries.append(("/joint_states", JOINT_STATE, time, joint_state(time, ["x"], [1.0])))
    entries.append(("/joint_states", JOINT_STATE, time, joint_state(time, [JOINT], [])))
    entries.append(("/joint_states", JOINT_STATE, time, b"\x00\x01\x00\x00spoilt"))
    bag, log = write_mcap(tmp_path / "bag.mcap", entries), tmp_path / "log.mcap"
    done = replay([bag], log, Parameters())
    assert (done.predictions, done.others, done.refused, done.unreadable) == (10, 1, 1, 1)
    assert len(data_of(log, "/joint_states")) == 10


CASES: dict[str, tuple[list[Entry], Parameters, str]] = {
    "empty": ([], Parameters(), "has no topic /joint_states of .* no topics at all"),
    "other joints": (
        swing(5, joint="elbow"),
        Parameters(),
        f"no joint {JOINT}; it has elbow, other.*--joint",
    ),
    "two topics": (
        swing(5, "/left") + swing(5, "/right"),
        Parameters(),
        "2 topics of type sensor_msgs/msg/JointState; choose one, as in "
        "`--remap joint_states:=/left`: /left, /right",
    ),
    "other types": (
        [("/engine_speed", FLOAT64, START, float64(1.0))],
        Parameters(),
        r"has no topic /joint_states .* topics are: /engine_speed \(std_msgs/msg/Float64\)",
    ),
    "wrong type": (
        [("/hitch_position", JOINT_STATE, START, joint_state(START, [], []))],
        Parameters(hitch_input="percent"),
        "Topic /hitch_position of .* holds sensor_msgs/msg/JointState, not std_msgs/msg/Float64",
    ),
    "nothing usable": (
        [("/joint_states", JOINT_STATE, START, joint_state(START, [JOINT], []))],
        Parameters(),
        "no reading of the hitch .* 1 names but 0 elements in position",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_error_for_missing_content(tmp_path: Path, case: str) -> None:
    """The error names the file, the topic and the remedy, and no file is left behind."""
    entries, settings, words = CASES[case]
    bag = write_mcap(tmp_path / "bag.mcap", entries)
    with pytest.raises(ReplayError, match=words) as caught:
        replay([bag], tmp_path / "log.mcap", settings)
    assert "bag.mcap" in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["bag.mcap"]


def test_unknown_types(tmp_path: Path) -> None:
    """Unused topics may have unknown types; an unknown type of a used one is reported."""
    bag = write_mcap(tmp_path / "bag.mcap", swing(5))
    data = bag.read_bytes().replace(b"sensor_msgs/msg/JointState", b"sensor_msgs/msg/OtherState")
    bag.write_bytes(data)
    with pytest.raises(ReplayError, match=r"holds sensor_msgs/msg/OtherState, not .*--remap"):
        replay([bag], tmp_path / "log.mcap", Parameters())


def test_damage_leaves_what_was_there(tmp_path: Path) -> None:
    """A damaged bag leaves an older log as it is, and no other file behind."""
    bag = write_mcap(tmp_path / "bag.mcap", swing(5000))
    with bag.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    data = bytearray(bag.read_bytes())
    data[summary.chunk_indexes[-2].chunk_start_offset + 100] ^= 0xFF
    bag.write_bytes(data)
    log = tmp_path / "log.mcap"
    log.write_bytes(b"older")
    with pytest.raises(BagError, match=r"bag\.mcap is damaged"):
        replay([bag], log, Parameters())
    assert log.read_bytes() == b"older"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bag.mcap", "log.mcap"]


def test_output_that_cannot_be(tmp_path: Path) -> None:
    """An output in a missing folder, or onto the input, is refused."""
    bag = write_mcap(tmp_path / "bag.mcap", swing(5))
    with pytest.raises(OutputError, match=r"cannot be written, as .* is no folder"):
        replay([bag], tmp_path / "missing" / "log.mcap", Parameters())
    with pytest.raises(OutputError, match="is an input"):
        replay([bag], bag, Parameters())


def test_remappings() -> None:
    """A word of another form, or with an unknown name, is refused."""
    with pytest.raises(ReplayError, match="write NAME:=TOPIC"):
        remappings(["joint_states=/x"])
    with pytest.raises(ReplayError, match="no topic elbow; use one of: joint_states"):
        replay([DRIVE], Path("log.mcap"), Parameters(), {"elbow": "/x"})


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command chooses topic and joint, and prints a summary."""
    entries = swing(50, "/left", "elbow") + swing(50, "/right", "elbow")
    bag, log = write_mcap(tmp_path / "bag.mcap", entries), tmp_path / "log.mcap"
    words = ["replay", str(bag), "-o", str(log), "--joint", "elbow"]
    assert main([*words, "--remap", "joint_states:=/right"]) == 0
    assert "50 predictions for /right" in capsys.readouterr().out
    assert len(data_of(log, "/right")) == 50
    assert main(words) == 1
    assert "choose one" in capsys.readouterr().err


GROWTH = """
import resource, sys
from pathlib import Path
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.playback.replay import replay, WhatIf
done = replay([Path(sys.argv[1])], Path(sys.argv[2]), Parameters())
print(done.predictions, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
"""


@pytest.mark.nightly(alone="test/bags/test_reading.py shows it of reading")
def test_memory_does_not_grow_with_the_bag(tmp_path: Path) -> None:
    """A bag of more than 25 MB needs no more memory than one of 5 MB."""
    from linkage_vibration.bags.log_writer import ChunkLog, Messages

    totals = []
    rng = np.random.default_rng(1)
    for blocks in (10, 50):
        bag = tmp_path / f"{blocks}.mcap"
        example = np.frombuffer(STORE.serialize_cdr(swing(2)[1][3], JOINT_STATE), np.uint8)
        at = example.tobytes().index(np.float64(2.35 + 0.8 * np.sin(1 / 50)).tobytes())
        with ChunkLog(bag, [log_topic("/joint_states", JOINT_STATE)], [], {}) as log:
            for number in range(blocks):
                rows = np.arange(5000)
                data = np.tile(example, (5000, 1))
                noise = rng.uniform(1.6, 3.1, 5000)
                data[:, at : at + 8] = noise[:, np.newaxis].view(np.uint8)
                times = START + (number * 5000 + rows) * 10**6
                log.write([Messages("/joint_states", data, rows, times, times)])
        words = [sys.executable, "-c", GROWTH, str(bag), str(tmp_path / "log.mcap")]
        predictions, peak = map(int, subprocess.check_output(words).split())
        assert predictions == blocks * 5000
        totals.append(peak)
    assert len(example) * 50 * 5000 > 25e6
    assert totals[1] < totals[0] + 20


def test_parameters_are_checked_as_by_the_node(tmp_path: Path) -> None:
    """Parameters that a program makes are those of a file, so no invalid one gives numbers."""
    with pytest.raises(ParameterError, match="hitch_sign must be 1 or -1, not 5"):
        replay(tmp_path / "drive.mcap", tmp_path / "log.mcap", Parameters(hitch_sign=5))


def test_one_bag_needs_no_list(tmp_path: Path) -> None:
    """One path is one bag, and no path is refused."""
    drive = config_file("drives/hitch_duty_cycle.mcap")
    done = [replay(inputs, tmp_path / "log.mcap") for inputs in (drive, str(drive), [drive])]
    assert done[0] == done[1] == done[2]
    with pytest.raises(ReplayError, match="No bag was given"):
        replay([], tmp_path / "none.mcap")


def test_foreign_text_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither a joint nor a topic nor a frame of a bag can print a line of its own."""
    evil = "boom\n[ERROR] the brakes fail"
    topic, log, page = f"/a{evil}", tmp_path / "log.mcap", tmp_path / "log.html"
    states = [(topic, JOINT_STATE, START, joint_state(START, [JOINT, evil], [2.0, 0.0]))]
    bag = write_mcap(tmp_path / "bag.mcap", states)
    for joint, faults in (("hitch", 1), (evil, 1), (JOINT, 0)):
        command = ["replay", str(bag), "-o", str(log), "--joint", joint, "--remap"]
        assert main([*command, f"joint_states:={topic}"]) == faults
    assert main(["review", str(log), "-o", str(page)]) == 0
    printed = "".join(capsys.readouterr())
    assert printed.count(r"boom\n[ERROR]") >= 3
    for text in (printed, page.read_text()):
        assert not any(line.startswith("[ERROR]") for line in text.splitlines())
