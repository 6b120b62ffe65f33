# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A node that is held up while DDS receives its inputs: the newest is used, and the rest counted.

A process that is stopped as a whole receives nothing, so that DDS notes a later time of receipt. On
a busy machine, its threads wait for each other; here one of them keeps Python's lock.
"""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from mcap.reader import make_reader
from std_msgs.msg import Float64

from linkage_vibration.playback.replay import replay
from test.ros.test_faults import Tractor
from test.support.messages import raw_messages

HELD_UP = """
import ctypes, sys, threading, time
from linkage_vibration.ros.node import main

def hold():
    time.sleep(5.0)
    while True:
        ctypes.PyDLL(None).usleep(400_000)  # with Python's lock, so that no callback runs
        time.sleep(0.6)

threading.Thread(target=hold, daemon=True).start()
sys.exit(main())
"""
LATE = 150_000_000  # ns
OUTPUTS = ("prediction", "resonance", "load_state")


def test_newest_reading_first(
    start: Callable[..., Any], meet: Callable[[str], Any], tmp_path: Path
) -> None:
    """Of readings and speeds that wait for 0.4 s the newest are used; a replay answers alike."""
    node = start(name="held", program=("-c", HELD_UP), record=True, log_directory=tmp_path)
    tractor = Tractor(meet("held"), tmp_path, "held")

    def publish(_: int = 0) -> None:
        tractor.say(2.0)
        for name in ("engine", "pto"):
            tractor.speeds[name].publish(Float64(data=540.0))

    warned = "were left out for newer ones; the machine is too slow or too busy"
    tractor.wait_for("input", DiagnosticStatus.WARN, warned, publish, 100.0)
    tractor.received.clear()
    tractor.peer.spin(lambda: sum(bool(s.values) for s in tractor.received) > 1, "the last counts")
    *_, values = ({v.key: v.value for v in s.values} for s in tractor.received if s.values)
    assert node.stop() == 0
    [log] = tmp_path.glob("*.mcap")
    left_out = dict(each.split() for each in values["messages left out"].split(", "))
    read, predicted = int(values["messages received"]), int(values["predictions"])
    assert predicted == read - int(left_out.get("/joint_states", 0))
    answers = answered(log)
    assert len(answers) == predicted
    # A late answer is that to the newest reading: no other arrived before it was given. A reading
    # that was being answered as its thread was held up is an exception.
    late = [given for arrived, given in answers if given - arrived > LATE]
    passed_over = [
        given
        for (arrived, given), (following, _) in pairwise(answers)
        if given - arrived > LATE and following < given - LATE // 2
    ]
    assert len(passed_over) <= max(1, len(late) // 4)
    again = tmp_path / "again.mcap"
    assert replay(log, again).predictions == predicted
    for output in OUTPUTS:
        recorded = [each[1:] for each in raw_messages(log, f"/held/{output}")]
        replayed = raw_messages(again, f"/linkage_vibration/{output}")
        assert [each[1:] for each in replayed] == recorded
        assert recorded


def answered(log: Path) -> list[tuple[int, int]]:
    """Return when each reading was received, and when its prediction was published, ns."""
    with log.open("rb") as file:
        predictions = make_reader(file).iter_messages("/held/prediction")
        return [(message.log_time, message.publish_time) for *_, message in predictions]
