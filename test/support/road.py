# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes a drive on a road with a raised implement, whose height and speed change."""

import struct
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.messages.topics import log_topic
from linkage_vibration.prediction.settings import Parameters

START, RATE, DURATION = 1_767_225_600, 20, 40  # s, Hz, s
CLASS_C = """
ground: {speed: ground, terrain: {class: C}, raised: true}
engine: {speed: engine, orders: [3], moment: [190.0], at: base, at_speed: 2000.0}
"""


def write_road(path: Path, infinite: range = range(0), unknown: range = range(0)) -> None:
    """Write angles from 165 to 140 deg, speeds over ground up to 36 km/h, and an engine speed.

    Angles are infinite in a range of steps, and the speeds over ground are NaN in another.
    """
    store, topics = get_typestore(Stores.ROS2_HUMBLE), Parameters()
    kinds = {"/joint_states": JOINT_STATE, "/ground_speed": FLOAT64, "/engine_speed": FLOAT64}
    joint, header, stamp = (
        store.types[name]
        for name in (JOINT_STATE, "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    with LogWriter(path, [log_topic(*topic) for topic in kinds.items()]) as log:
        for k in range(DURATION * RATE):
            seconds, ticks = divmod(k, RATE)
            nanosec = ticks * (10**9 // RATE)
            at = (START + seconds) * 10**9 + nanosec
            along = k / (DURATION * RATE)
            angle = np.radians(165.0 - 25.0 * max(0.0, 2.0 * along - 1.0))
            speed = 10.0 * min(1.0, 3.0 * along)
            if k in infinite:
                angle = np.inf
            if k in unknown:
                speed = np.nan
            message = joint(
                header=header(stamp=stamp(START + seconds, nanosec), frame_id=""),
                name=[topics.joint_name],
                position=np.array([angle]),
                velocity=np.zeros(1),
                effort=np.zeros(0),
            )
            for topic, value in (("/ground_speed", speed), ("/engine_speed", 1800.0)):
                log.write(topic, b"\0\1\0\0" + struct.pack("<d", value), at, at)
            log.write("/joint_states", bytes(store.serialize_cdr(message, JOINT_STATE)), at, at)
