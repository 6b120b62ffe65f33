# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads logs with independent libraries and compares every message.

`python -m benchmark.log_readers` needs Node.js with npm, whose packages it installs in ``build``.
"""

import json
import math
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from benchmark.report import machine, publish, table
from linkage_vibration.bags.recorder import UNLIMITED, LogLimits, Provenance, Recorder
from linkage_vibration.bags.recovery import recover
from linkage_vibration.bags.writing import COMPRESSIONS, Topic, offered_qos_profiles
from linkage_vibration.messages.definitions import message_definition, type_hash
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import PREDICTION
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.support.resources import PAPER_TABLE, config_file
from linkage_vibration.table.table import load_table
from test.support.drive import hitch_duty_cycle
from test.support.messages import plain

PACKAGES = ["@mcap/core", "@mcap/nodejs", "@mcap/support", "@foxglove/rosmsg"]
PACKAGES += ["@foxglove/rosmsg2-serialization"]
NODE_MODULES = Path("build/npm").resolve()
JOINT_STATE = "sensor_msgs/msg/JointState"
# Topic, log time, publish time, fields.
Message = tuple[str, int, int, Any]


def topic(name: str, type_name: str) -> Topic:
    """Return a topic as the node describes it."""
    return Topic(
        name, type_name, message_definition(type_name), type_hash(type_name), offered_qos_profiles()
    )


def record(folder: Path, compression: str, limits: LogLimits) -> None:
    """Record the duty cycle with its predictions."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(message_definition(JOINT_STATE), JOINT_STATE))
    joint_state, header = store.types[JOINT_STATE], store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"]
    predictor = Predictor(load_table(config_file(PAPER_TABLE)))
    topics = [topic("/joint_states", JOINT_STATE), topic("/prediction", PREDICTION)]
    recorder = Recorder(folder, topics, Provenance(), limits, compression)
    recorder.start()
    for time, alpha3 in zip(*hitch_duty_cycle(), strict=True):
        sec, nanosec = divmod(round(1e9 * time), 10**9)
        message = joint_state(
            header=header(stamp=stamp(sec=sec, nanosec=nanosec), frame_id="hitch"),
            name=["hitch"],
            position=np.array([alpha3]),
            velocity=np.array([math.nan]),
            effort=np.array([]),
        )
        at = 10**9 * sec + nanosec
        data = bytes(store.serialize_cdr(message, JOINT_STATE))
        recorder.write([("/joint_states", data, at, at - 1000)])
        data = encode_message(PREDICTION, predictor.predict(alpha3), sec, nanosec, "hitch")
        recorder.write([("/prediction", data, at + 500, at + 400)])
    recorder.stop()


def by_mcap(path: Path) -> list[Message]:
    """Read a log with mcap and mcap-ros2-support."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [
            (channel.topic, message.log_time, message.publish_time, plain(decoded))
            for _, channel, message, decoded in reader.iter_decoded_messages()
        ]


def by_rosbags(path: Path) -> list[Message]:
    """Read a log with rosbags, which does not give the publish time."""
    with AnyReader([path]) as reader:
        return [
            (c.topic, time, 0, plain(reader.deserialize(data, c.msgtype)))
            for c, time, data in reader.messages()
        ]


def by_npm(path: Path) -> list[Message]:
    """Read a log with @mcap/core and @foxglove/rosmsg2-serialization."""
    script = Path(__file__).with_suffix(".mjs")
    command = ["node", str(script), str(NODE_MODULES), str(path)]
    run = subprocess.run(command, check=True, capture_output=True, text=True)
    result = []
    for line in run.stdout.splitlines():
        name, log_time, publish_time, fields = json.loads(line)
        stamp = fields["header"]["stamp"]
        stamp["nanosec"] = stamp.pop("nsec", stamp.get("nanosec"))
        result.append((name, int(log_time), int(publish_time), fields))
    return result


def npm_version(package: str) -> str:
    """Return the name and version of an npm package."""
    text = (NODE_MODULES / "node_modules" / package / "package.json").read_text(encoding="utf-8")
    return f"{package} {json.loads(text)['version']}"


def make_logs(folder: Path) -> dict[str, Path]:
    """Make a log of each kind; the keys describe them."""
    kinds = {f"compression {name}": (name, UNLIMITED) for name in COMPRESSIONS}
    kinds["one of several splits"] = ("zstd", LogLimits(split_size=250_000))
    result = {}
    for number, (name, (compression, limits)) in enumerate(kinds.items()):
        place = folder / str(number)
        place.mkdir()
        record(place, compression, limits)
        result[name] = min(place.glob("*.mcap"))
    cut = folder / "cut.mcap"
    content = result["compression zstd"].read_bytes()
    cut.write_bytes(content[: len(content) // 2])
    recover(cut, folder / "recovered.mcap")
    return result | {"recovered from a half": folder / "recovered.mcap"}


def main() -> int:
    """Compare the readers, publish the result, and return how many logs they read differently."""
    if shutil.which("npm") is None:
        print("npm is missing; install Node.js with npm and run this again.", file=sys.stderr)
        return 1
    NODE_MODULES.mkdir(parents=True, exist_ok=True)
    install = ["npm", "install", "--silent", "--ignore-scripts", "--prefix", str(NODE_MODULES)]
    subprocess.run([*install, *PACKAGES], check=True)
    rows, wrong = [], 0
    with tempfile.TemporaryDirectory() as folder:
        for name, path in make_logs(Path(folder)).items():
            expected = by_mcap(path)
            without_publish_time = [(t, at, 0, fields) for t, at, _, fields in expected]
            agree = [by_npm(path) == expected, by_rosbags(path) == without_publish_time]
            wrong += agree.count(False)
            rows.append([name, str(len(expected)), *("same" if a else "DIFFERENT" for a in agree)])
    text = (
        "This page shows that independent libraries read the same messages from our logs. Every "
        "field of every message that mcap with mcap-ros2-support reads is compared with what two "
        "others read: Foxglove's @mcap/core with @foxglove/rosmsg2-serialization, and rosbags. The "
        "logs contain the shipped drive with its predictions."
    )
    columns = ["log", "messages", "npm", "rosbags"]
    others = machine("mcap", "mcap-ros2-support", "rosbags", *map(npm_version, PACKAGES))
    publish("log_readers", "Logs, read by other libraries", [text, table(columns, rows)], others)
    return wrong


if __name__ == "__main__":
    sys.exit(main())
