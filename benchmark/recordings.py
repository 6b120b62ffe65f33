# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Listens to recordings of other machines, to show that nothing breaks; they prove nothing.

`python -m benchmark.recordings BAG...` writes a row for each bag with one IMU. No tractor recorded
them, so beside each a hitch that stands still, and an engine and a PTO that run, are invented.
"""

import sys
import tempfile
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_typestore

from benchmark.report import machine, publish, table
from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.message_types import IMU
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.cli.main import main as command
from linkage_vibration.listening.signals import SignalError, measured_signal
from linkage_vibration.messages.topics import MEASURED, log_topic
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.sensors import read_measured, read_sensors

ANGLE, RATE, JOINT = 2.3, 20.0, "sensor_msgs/msg/JointState"  # rad, Hz

HEAD = ["recording", "samples", "`~/measured`", "Hz", "doubts", "first sentence of `listen`"]
SOURCES = (
    "Bags of ROS 1 with one IMU were read by `listen`, and by `replay --sensors` (how many "
    "messages on `~/measured`): a quadcopter (`ardrone_imu`) and two IMUs alone from "
    "[imu_tools](https://github.com/CCNYRoboticsLab/imu_tools) (imu_filter_madgwick/sample, commit "
    "4b8d5db), and two robots on wheels (`rl_test1`, `rl_test2`: test1.bag and test2.bag) from "
    "[robot_localization](https://github.com/cra-ros-pkg/robot_localization) (test, commit "
    "1cb9533). No machine is a tractor, so beside each a hitch at 131.8 deg, an engine at 1500 rpm "
    "and a PTO at 540 rpm are invented, and the sensors are said to be upright at E1. So no "
    "number here says anything about the model; a natural frequency that was reported without a "
    "doubt would be false, and there is none."
)


def listen(bag: Path, folder: Path) -> list[str]:
    """Return the name of a bag, its samples, rate, doubts, and the answer of `listen` about it."""
    with open_bags([bag]) as bags:
        [topic] = [each for each in bags.topics if each.type == IMU]
    sensors, drive, log = (folder / f"{bag.stem}{end}" for end in (".yaml", ".mcap", "_log.mcap"))
    text = f"file: {bag.resolve()}, topic: {topic.name}, unit: m/s2, at: E1"
    sensors.write_text(f"{bag.stem}: {{{text}}}\n")
    [sensor] = read_sensors(sensors)
    times, readings = read_measured(sensor, bag, 0)
    stand_still(drive, float(times[0]), float(times[-1]))
    speeds = {"engine_speed": 1500.0, "pto_speed": 540.0, "ground_speed": 0.0}
    live = Parameters(**speeds, sensor_file=str(sensors))
    replay([drive, bag], log, live)
    with open_bags([log]) as bags:
        count = next(each.count for each in bags.topics if each.type == MEASURED)
    facts = [bag.name, str(len(times)), str(count)]
    try:
        signal = measured_signal(sensor, times - times[0], readings, 60.0)
    except SignalError as error:
        return [*facts, "", str(error), ""]
    said = StringIO()
    with redirect_stdout(said):
        code = command(["listen", str(log), "--sensors", str(sensors)])
    first = said.getvalue().partition("\n")[0]
    return [*facts, f"{signal.rate:.4g}", " ".join(signal.doubts), first if code == 0 else "failed"]


def stand_still(path: Path, first: float, last: float) -> None:
    """Write a drive in which the crank stands still between two times, s."""
    types = get_typestore(Stores.ROS2_HUMBLE).types
    store, head = get_typestore(Stores.ROS2_HUMBLE), types["std_msgs/msg/Header"]
    stamp, joint = types["builtin_interfaces/msg/Time"], types[JOINT]
    with LogWriter(path, [log_topic("/joint_states", JOINT)]) as log:
        for at in np.arange(first, last, 1.0 / RATE).tolist():
            sec, nanosec = divmod(round(1e9 * at), 10**9)
            values = [np.array([value]) for value in (ANGLE, 0.0, 0.0)]
            message = joint(head(stamp(sec, nanosec), ""), ["hitch_rockshaft_joint"], *values)
            data, time = bytes(store.serialize_cdr(message, JOINT)), 10**9 * sec + nanosec
            log.write("/joint_states", data, time, time)


def main() -> None:
    """Write a table of the bags that the command line names."""
    with tempfile.TemporaryDirectory() as folder:
        rows = [listen(Path(bag), Path(folder)) for bag in sys.argv[1:]]
    publish("recordings", "Recordings of other machines", [SOURCES, table(HEAD, rows)], machine())


if __name__ == "__main__":
    main()
