# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A node on a ROS distribution, which has no packages for the libraries of bags."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from std_srvs.srv import Trigger

from linkage_vibration.prediction.predictor import Status
from test.ros.test_implements import small_linkage
from test.support.ros_process import JOINT

BARE_NODE = """
import sys


class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("lz4", "mcap", "rosbags", "zstandard"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


if __name__ == "__main__":
    sys.meta_path.insert(0, Missing())
    from linkage_vibration.ros.node import main

    sys.exit(main())
"""


def test_predicts_without_mcap(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path: Path, mechanism_file: Path
) -> None:
    """It starts, predicts and takes another implement; one sentence says what it cannot do."""
    sentence = (
        "No log can be recorded and no bag be read: Python cannot import mcap (No module named "
        "'mcap'); run `pip install mcap`."
    )
    small = tmp_path / "small.yaml"
    small.write_text(small_linkage(mechanism_file))
    node = start(name="bare", program=("-c", BARE_NODE), mechanism_file=small)
    peer = meet("bare")
    assert peer.ask([JOINT], [2.0]).status == Status.OK
    client = peer.node.create_client(Trigger, "bare/start_recording")
    answer = peer.request(client, Trigger.Request())
    assert (answer.success, answer.message) == (False, sentence)
    answer = peer.implement("bare", mass=1200.0, inertia=300.0)
    assert (answer.success, answer.message) == (True, "")
    assert node.printed.count("mcap'") == node.printed.count(f"{sentence} The node predicts") == 1
    assert node.stop() == 0
