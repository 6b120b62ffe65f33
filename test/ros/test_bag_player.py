# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""`linkage-vibration play` feeds a node and shows its predictions, as `play --watch` does."""

import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from test.playback.test_replay import START, float64, joint_state, write_mcap
from test.support.ros_process import JOINT, LIMIT, slowness, until

COMMAND = [sys.executable, "-m", "linkage_vibration.cli"]


def test_play_and_watch(
    start: Callable[..., Any], environment: dict[str, str], tmp_path: Path
) -> None:
    """The node answers every joint state of a bag, and the last angle is shown."""
    entries = [("/engine_speed", FLOAT64, START, float64(2000.0))]
    for k in range(160):
        time = START + k * 10**7 + (k == 159) * 21 * 10**8  # the last one comes 2.1 s later
        entries.append(("/arm", JOINT_STATE, time, joint_state(time, [JOINT], [1.7 + 0.005 * k])))
    bag = write_mcap(tmp_path / "bag.mcap", entries)
    node = start(name="played")
    node.wait_for("Predicting for joint")
    shown = tmp_path / "shown.txt"
    with shown.open("w") as file:
        watching = subprocess.Popen(
            [*COMMAND, "play", "--watch", "--node", "/played"],
            stdout=file,
            stderr=file,
            env=environment,
            # A shell that runs the tests in the background ignores it, and so would the command.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
    until(lambda: "No prediction of /played yet" in shown.read_text(), "the hint")
    play = [*COMMAND, "play", str(bag), "--remap", "joint_states:=/arm", "--node", "/played"]
    played = subprocess.run(play, env=environment, capture_output=True, text=True, check=True)
    assert "Playing joint_states, engine_speed of" in played.stdout
    assert "The next message follows in 2 s." in played.stdout
    assert "161 messages were published." in played.stdout
    assert played.stderr == ""
    assert "deg |" in played.stdout
    until(lambda: "142.9" in shown.read_text(), "the last prediction")
    watching.send_signal(signal.SIGINT)
    assert watching.wait(LIMIT) == 0
    assert node.stop() == 0
    [made] = re.findall(r"160 messages received, (\d+) predictions made", node.printed)
    assert made == "160" or slowness() > 1.0  # a busy machine leaves readings out
    assert "deg |" in shown.read_text()
