# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What does an IMU on the implement record while a tractor works, drives and works?

It writes simulated_drive.mcap and sensors.yaml: ``python simulated_drive.py FOLDER``. The
implement is 10 % heavier than its type plate says, and excitations have other amplitudes than those
that the package assumes.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_typestore

import linkage_vibration as lv
from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.messages.topics import log_topic

SECONDS, RATE, LONG = 180, 200, 4  # s, Hz of the IMU, and s of a window
START, GRAVITY, NOISE = 1_767_225_600, 9.81, 0.02  # s, m/s2, and m/s2 of the sensor
PLACES = [("E1", "x"), ("E1", "z"), ("front_axle", "z"), ("rear_axle", "z")]
ACROSS = [("E1", "y"), ("front_axle", "y"), ("rear_axle", "y")]
# Speed, turns per turn of it, amplitude (N) at its reference speed (rpm), and place.
ORDERS = {
    "crankshaft 1": ("engine", 1.0, 600.0, 2200.0, 2),
    "pto_shaft 1": ("pto", 1.0, 80.0, 1000.0, 1),
    "rotor 1": ("pto", 0.45, 150.0, 1000.0, 0),
}
SOIL = 6.0  # N/sqrt(Hz), at each place
SENSORS = """\
implement:            # an IMU on the implement, upside down
  file: simulated_drive.mcap
  topic: /implement/imu
  unit: m/s2
  at: E1
  axes: [x, -y, -z]
  range: 78.5         # m/s2
  filtered: true
"""

folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
bag = folder / "simulated_drive.mcap"
config, random = Path(__file__).parents[1] / "config", np.random.default_rng(1)
mechanism = lv.read_mechanism(config / "three_point_linkage_on_tractor.yaml")
[body] = mechanism.rigid_bodies
model = lv.LinkageModel(replace(mechanism, rigid_bodies=(replace(body, mass=1.1 * body.mass),)))

times = np.arange(SECONDS * RATE) / RATE
road = np.clip(7.0 - np.abs(times - 110.0) / 4.0, 0.0, 1.0)  # from 82 s to 138 s
angle = 166.0 - 62.0 * road + 0.5 * np.sin(0.3 * times) * (1.0 - road)  # deg
engine = 1900.0 + 120.0 * np.sin(0.07 * times) + 40.0 * np.sin(0.31 * times)  # rpm
pto = engine * 1000.0 / 1950.0 * (road == 0.0)
speeds = {"engine": engine, "pto": pto, "ground": np.where(times < 12.0, 0.0, 2.0 + 6.0 * road)}

shaken = SOIL * np.sqrt(RATE / 2.0)
forces = random.normal(0.0, shaken, (len(PLACES), len(times)))
aside = random.normal(0.0, shaken, (len(ACROSS), len(times)))
for source, ratio, size, reference, place in ORDERS.values():
    turns = np.cumsum(ratio * speeds[source]) / 60.0 / RATE
    forces[place] += size * (speeds[source] / reference) ** 2 * np.cos(2.0 * np.pi * turns)

# Windows that add up to one; the hitch hardly moves in each.
n, padded = LONG * RATE, 4 * LONG * RATE
window = np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2
frequencies = np.fft.rfftfreq(padded, 1.0 / RATE)
vertical, lateral = model.halves
halves = [(vertical, PLACES, forces), (lateral, ACROSS, aside)]
moved = np.zeros((3, len(times) + padded))  # x, y and z of E1
for first in range(0, len(times) - n + 1, n // 2):
    for half, places, acting in halves:
        rows = [0, 1, 2] if half is lateral else [0, 2]  # nothing moves along y in the plane
        outputs = [("E1", "xyz"[row]) for row in rows]
        solution = half.solve(np.radians(angle[first + n // 2]))
        frf = solution.frf(outputs, places).frf(frequencies)
        spectrum = np.fft.rfft(acting[:, first : first + n] * window, padded)
        response = np.einsum("foi,if->of", frf, spectrum) * -((2.0 * np.pi * frequencies) ** 2)
        moved[rows, first : first + padded] += np.fft.irfft(response, padded)
moved = moved[:, : len(times)] + random.normal(0.0, NOISE, (3, len(times)))
axes = np.array([moved[0], -moved[1], -(moved[2] + GRAVITY)])

store = get_typestore(Stores.ROS2_HUMBLE)
kinds = {"/joint_states": "sensor_msgs/msg/JointState"}
kinds |= {f"/{name}_speed": "std_msgs/msg/Float64" for name in speeds}
kinds["/implement/imu"] = "sensor_msgs/msg/Imu"
vector, header = store.types["geometry_msgs/msg/Vector3"], store.types["std_msgs/msg/Header"]
stamp, imu = store.types["builtin_interfaces/msg/Time"], store.types["sensor_msgs/msg/Imu"]
joint, number = (store.types[kinds[name]] for name in ("/joint_states", "/engine_speed"))
still, unknown = vector(0.0, 0.0, 0.0), np.zeros(9)
turn = store.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
with LogWriter(bag, [log_topic(*each) for each in kinds.items()]) as log:
    for k in range(len(times)):
        time = START * 10**9 + k * 10**9 // RATE
        head = header(stamp(time // 10**9, time % 10**9), "")
        moving = vector(*axes[:, k].tolist())
        messages = {"/implement/imu": imu(head, turn, unknown, still, unknown, moving, unknown)}
        if k % 10 == 0:
            reading = [np.array([value]) for value in (np.radians(angle[k]), 0.0, 0.0)]
            messages["/joint_states"] = joint(head, ["hitch_rockshaft_joint"], *reading)
            messages |= {f"/{name}_speed": number(each[k]) for name, each in speeds.items()}
        for name, message in messages.items():
            log.write(name, bytes(store.serialize_cdr(message, kinds[name])), time, time)
(folder / "sensors.yaml").write_text(SENSORS)
print(f"{bag}: {SECONDS} s, up to {np.abs(moved).max():.0f} m/s2 at E1")
