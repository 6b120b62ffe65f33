# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the shipped drive, a hitch duty cycle: ``python -m test.support.drive FILE``.

A tractor ploughs, lifts its implement at the headland, drives on a road, lowers the implement and
ploughs again. The far ends of the lower links are lowest at alpha3 = 180 deg (0.32 m below their
pivots) and highest at 90 deg (0.29 m above them), so the working depth is near the upper end of the
range. The PTO drives the implement while it works.
"""

import heapq
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.messages.topics import log_topic

JOINTS, ENGINE_SPEED, PTO_SPEED = "/joint_states", "/engine_speed", "/pto_speed"
HITCH_JOINT = "hitch_rockshaft_joint"
RATE = 100  # Hz
SPEED_RATE = 10  # Hz, of engine and PTO speeds
START = 1_767_225_600  # s, 2026-01-01 00:00 UTC

WORKING, RAISED = np.deg2rad([166.0, 104.0])
LIFT = (7.5, 10.0)  # s, start and end
LOWERING = (15.0, 18.0)  # s
DURATION = 20.0  # s
ENCODER_STEP = 2 * np.pi / 2**14  # rad, a rotary encoder of 14 bits
ENGINE_WORKING, ENGINE_IDLE, ENGINE_ROAD = 2000.0, 1300.0, 2050.0  # rpm
ENGINE_STEP = 0.125  # rpm, of the J1939 bus
PTO_RATIO = 540.0 / 1950.0  # of the PTO's speed to the engine's
ENCODER_NOISE = np.deg2rad(0.02)  # rad, standard deviation


def hitch_duty_cycle() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times (s, at 100 Hz) and crank angles (rad, 101 to 169 deg) of a noisy encoder.

    Depth control moves the hitch by a few degrees below 1 Hz. Lifting and lowering are minimum-jerk
    moves. On the road the tractor bounces on its tyres at about 2 Hz, most strongly just after the
    lift. The noise has a fixed seed, so the drive is the same each time.
    """
    # NumPy promises only for RandomState that its numbers never change.
    random = np.random.RandomState(seed=3)
    times = np.arange(round(DURATION * RATE)) / RATE
    lifted = _move(times, *LIFT) - _move(times, *LOWERING)
    draft = _sum_of_sines(times, np.linspace(0.1, 0.9, 9), random)
    road = _sum_of_sines(times, np.linspace(1.7, 2.3, 5), random)
    bounce = 1 + 2 * np.exp(-np.maximum(times - LIFT[1], 0) / 0.8)
    alpha3 = (
        WORKING
        + (RAISED - WORKING) * lifted
        + np.deg2rad(1.4) * draft * (1 - lifted)
        + np.deg2rad(0.4) * road * bounce * lifted
        + random.normal(scale=ENCODER_NOISE, size=times.size)
    )
    return times, ENCODER_STEP * np.rint(alpha3 / ENCODER_STEP)


def engine_and_pto_speed() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return times (s, at 10 Hz) and the speeds of engine and PTO over the duty cycle, rpm.

    The engine works at 2000 rpm, which the draft reduces by up to 80 rpm. It idles at the headland,
    speeds up for the road, and idles again before the implement is lowered. The PTO turns at a
    fixed ratio to it, and is disengaged while the implement is up. Steps are those of the bus.
    """
    random = np.random.RandomState(seed=4)
    times = np.arange(round(DURATION * SPEED_RATE)) / SPEED_RATE
    lifted = _move(times, *LIFT) - _move(times, *LOWERING)
    draft = _sum_of_sines(times, np.linspace(0.1, 0.9, 9), random)
    road = _move(times, 10.0, 13.0) - _move(times, 13.5, 15.0)
    engine = (
        ENGINE_WORKING
        + (ENGINE_IDLE - ENGINE_WORKING) * lifted
        + (ENGINE_ROAD - ENGINE_IDLE) * road
        - 40.0 * np.clip(draft, 0.0, 2.0) * (1.0 - lifted)
    )
    pto = PTO_RATIO * engine * (1.0 - _move(times, 6.5, 7.5) + _move(times, 17.5, 19.0))
    return (
        times,
        ENGINE_STEP * np.rint(engine / ENGINE_STEP),
        ENGINE_STEP * np.rint(pto / ENGINE_STEP),
    )


def write_drive(path: Path) -> None:
    """Write the hitch duty cycle as a new MCAP file.

    As with a real joint_state_broadcaster, there are other joints beside the hitch, the order of
    names changes, and efforts, which nothing measures, are NaN. ``config/drives`` holds the result.
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = {JOINTS: JOINT_STATE, ENGINE_SPEED: FLOAT64, PTO_SPEED: FLOAT64}
    with LogWriter(path, [log_topic(*topic) for topic in types.items()]) as log:
        for time, topic, data in heapq.merge(_joint_states(store), *_speeds(store)):
            log.write(topic, data, time, time)


def _joint_states(store: Any) -> Iterator[tuple[int, str, bytes]]:
    """Yield the time (ns), topic and CDR of each joint state."""
    message_type, header_type, stamp_type = (
        store.types[name]
        for name in (JOINT_STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    times, alpha3 = hitch_duty_cycle()
    joints = {
        HITCH_JOINT: alpha3,
        "front_axle_steering_joint": np.round(0.05 * np.sin(0.8 * times), 4),
        "rear_pto_joint": np.round(56.5 * times, 4),
    }
    names = list(joints)
    positions = np.column_stack(list(joints.values()))
    velocities = np.gradient(positions, 1 / RATE, axis=0)
    for k in range(times.size):
        seconds, ticks = divmod(k, RATE)
        nanoseconds = ticks * (10**9 // RATE)
        order = np.roll(np.arange(len(names)), seconds)
        message = message_type(
            header=header_type(stamp=stamp_type(START + seconds, nanoseconds), frame_id=""),
            name=[names[i] for i in order],
            position=positions[k, order],
            velocity=velocities[k, order],
            effort=np.full(len(names), np.nan),
        )
        time = (START + seconds) * 10**9 + nanoseconds
        yield time, JOINTS, bytes(store.serialize_cdr(message, JOINT_STATE))


def _speeds(store: Any) -> list[Iterator[tuple[int, str, bytes]]]:
    """Return an iterator over time (ns), topic and CDR for each of both speeds."""
    message_type = store.types[FLOAT64]
    _times, engine, pto = engine_and_pto_speed()

    def encoded(topic: str, speeds: NDArray[np.float64]) -> Iterator[tuple[int, str, bytes]]:
        for k, speed in enumerate(speeds.tolist()):
            time = START * 10**9 + k * (10**9 // SPEED_RATE)
            yield time, topic, bytes(store.serialize_cdr(message_type(data=speed), FLOAT64))

    return [encoded(ENGINE_SPEED, engine), encoded(PTO_SPEED, pto)]


def _move(times: NDArray[np.float64], start: float, end: float) -> NDArray[np.float64]:
    """Return the minimum-jerk polynomial that rises from 0 at ``start`` to 1 at ``end``."""
    s = np.clip((times - start) / (end - start), 0, 1)
    risen: NDArray[np.float64] = s**3 * (10 - 15 * s + 6 * s**2)
    return risen


def _sum_of_sines(
    times: NDArray[np.float64], frequencies: NDArray[np.float64], random: np.random.RandomState
) -> NDArray[np.float64]:
    """Return noise of unit variance that consists of these frequencies, Hz."""
    phases = random.uniform(0, 2 * np.pi, frequencies.size)
    waves = np.sin(2 * np.pi * np.outer(times, frequencies) + phases)
    noise: NDArray[np.float64] = waves.sum(axis=1) * np.sqrt(2 / frequencies.size)
    return noise


if __name__ == "__main__":
    write_drive(Path(sys.argv[1]))
