# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The hitch duty cycle and the bag of it that ships."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import RESONANCE
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.resonance import ResonanceMonitor, ResonanceState, described
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.support.resources import PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.drive import (
    ENGINE_SPEED,
    HITCH_JOINT,
    PTO_SPEED,
    engine_and_pto_speed,
    hitch_duty_cycle,
    write_drive,
)
from test.support.messages import read_messages

SHIPPED = "drives/hitch_duty_cycle.mcap"


def test_duty_cycle_stays_well_within_the_stroke() -> None:
    """20 s at 100 Hz, between 100 and 170 deg, of a stroke of 90 to 180 deg."""
    times, alpha3 = hitch_duty_cycle()
    np.testing.assert_allclose(np.diff(times), 0.01, rtol=1e-9)
    assert times.size == 2000
    assert np.deg2rad(100) < alpha3.min() < np.deg2rad(105)
    assert np.deg2rad(165) < alpha3.max() < np.deg2rad(170)


def test_phases_of_the_duty_cycle() -> None:
    """Working depth, lift and road differ in angle and in frequency."""
    times, alpha3 = hitch_duty_cycle()
    degrees = np.rad2deg(alpha3)

    def strongest(phase: slice) -> float:
        """Return the frequency in Hz at which the angle moves most."""
        angle = degrees[phase] - degrees[phase].mean()
        spectrum = np.abs(np.fft.rfft(angle * np.hanning(angle.size)))
        return float(np.fft.rfftfreq(angle.size, times[1])[spectrum.argmax()])

    work, road = slice(0, 700), slice(1000, 1500)
    assert abs(degrees[work].mean() - 166) < 1
    assert abs(degrees[road].mean() - 104) < 1
    assert strongest(work) < 1.0
    assert 1.5 < strongest(road) < 2.5
    noise = np.diff(degrees, n=3) / np.sqrt(20)  # third differences leave little but the noise
    assert 0.015 < noise[work].std() < 0.03


def test_shipped_bag_is_what_the_generator_writes(tmp_path: Path) -> None:
    """The bag under config holds byte for byte the messages that the generator writes today."""
    write_drive(tmp_path / "drive.mcap")
    contents = []
    for path in (tmp_path / "drive.mcap", config_file(SHIPPED)):
        with AnyReader([path]) as reader:
            contents.append([(c.topic, c.msgtype, t, bytes(d)) for c, t, d in reader.messages()])
    assert contents[0] == contents[1]


def test_bag_holds_the_duty_cycle_among_other_joints() -> None:
    """The hitch is found by its name; its place among the names changes."""
    times, alpha3 = hitch_duty_cycle()
    records = [message for _, message in read_messages(config_file(SHIPPED), "/joint_states")]
    places = [record.name.index(HITCH_JOINT) for record in records]
    assert set(places) == {0, 1, 2}
    hitch = [record.position[k] for record, k in zip(records, places, strict=True)]
    np.testing.assert_array_equal(hitch, alpha3)
    headers = [record.header.stamp for record in records]
    stamps = np.array([stamp.sec * 10**9 + stamp.nanosec for stamp in headers])
    np.testing.assert_array_equal(stamps - stamps[0], np.rint(times * 1e9))
    velocities = [record.velocity[k] for record, k in zip(records, places, strict=True)]
    np.testing.assert_allclose(velocities, np.gradient(alpha3, times), rtol=1e-6, atol=1e-9)
    assert all(np.isnan(record.effort).all() for record in records)


def test_engine_and_pto_speed() -> None:
    """The engine works, idles and speeds up for the road; the PTO turns only during work."""
    times, engine, pto = engine_and_pto_speed()
    assert times.size == 200
    assert ((engine > 1900) & (engine <= 2000)).all(where=times < 7.0)
    assert engine.min() == 1300
    assert engine.max() == 2050
    working = (times < 6.5) | (times > 19.0)
    rounding = 0.0625 * (1 + 540 / 1950)  # of both
    np.testing.assert_allclose(pto[working], engine[working] * 540 / 1950, atol=rounding)
    assert not pto[(times > 7.5) & (times < 17.5)].any()


def test_bag_holds_the_speeds() -> None:
    """Engine and PTO have topics of their own, in rpm, at 10 Hz."""
    _, engine, pto = engine_and_pto_speed()
    speeds: dict[str, list[float]] = {ENGINE_SPEED: [], PTO_SPEED: []}
    with AnyReader([config_file(SHIPPED)]) as reader:
        for connection, _, data in reader.messages():
            if connection.topic in speeds:
                message = reader.deserialize(data, connection.msgtype)
                speeds[connection.topic].append(message.data)  # type: ignore[attr-defined]
    assert speeds == {ENGINE_SPEED: engine.tolist(), PTO_SPEED: pto.tolist()}


def replayed() -> list[tuple[float, MessageColumns]]:
    """Assess every joint state of the shipped bag as a node does; times are s from its start."""
    predictor = Predictor(load_table(config_file(PAPER_TABLE)))
    monitor = ResonanceMonitor(read_excitations(config_file("excitations.yaml")))
    monitor.set_fixed(Source.GROUND, 0.0)  # the bag has no ground speed
    sources = {ENGINE_SPEED: Source.ENGINE, PTO_SPEED: Source.PTO}
    resonances = []
    with AnyReader([config_file(SHIPPED)]) as reader:
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic in sources:
                monitor.set_speed(sources[connection.topic], message.data, time)  # type: ignore[attr-defined]
            else:
                at = message.name.index(HITCH_JOINT)  # type: ignore[attr-defined]
                angle, velocity = message.position[at], message.velocity[at]  # type: ignore[attr-defined]
                prediction = predictor.predict(float(angle))
                resonance = monitor.assess(prediction, float(velocity), time)
                resonances.append(((time - reader.start_time) * 1e-9, described(resonance)))
    return resonances


def test_drive_crosses_resonances() -> None:
    """On the road the engine passes two modes, which the monitor predicts and notes."""
    road = [(time, each) for time, each in replayed() if 11.0 < time < 13.0]
    assert road[0][1].state is ResonanceState.CLEAR
    for excitation, mode in (("engine 6", 2), ("engine 3", 1)):
        pair = [(t, r) for t, r in road if (r.excitation, r.mode) == (excitation, mode)]
        crossing = next(t for t, r in pair if r.margin > 0.0)
        for time, each in pair:
            if each.state is ResonanceState.NOTE and each.margin < 0.0:
                # Speeds are at most 0.1 s old, and rise more slowly towards the second mode.
                assert each.approach == 1
                assert time + each.time_to_crossing == pytest.approx(crossing, abs=0.1)
        passed = next(r for _, r in pair if r.margin > 0.0)
        assert passed.state is ResonanceState.NOTE  # it has no amplitude on fixed ground
        assert (passed.approach, passed.time_to_crossing) == (-1, np.inf)


def test_replay_repeats_itself() -> None:
    """Played twice, a bag gives the same resonances to the last bit."""
    first, second = (
        [encode_message(RESONANCE, each, 0, 0, "") for _, each in replayed()] for _ in range(2)
    )
    assert first == second
