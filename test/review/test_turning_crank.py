# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a crank that turns around several times shows every turn alike."""

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from linkage_vibration.bags.log_writer import LogWriter
from linkage_vibration.bags.message_types import JOINT_STATE
from linkage_vibration.cli.main import main
from linkage_vibration.messages.topics import log_topic
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.support.resources import config_file
from linkage_vibration.table.table import save_table
from test.support.served import turning_table

TURNS, COUNT, RATE = 3, 600, 100  # and Hz
PHASES = [0.1, 0.25, 0.4, 0.55, 0.7, 0.85]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a replay of three turns of a four-bar linkage."""
    folder = tmp_path_factory.mktemp("turning")
    mechanism, store = config_file("four_bar.yaml"), get_typestore(Stores.LATEST)
    save_table(turning_table(), folder / "table.npz")
    time, header, state = (
        store.types[name]
        for name in ("builtin_interfaces/msg/Time", "std_msgs/msg/Header", JOINT_STATE)
    )
    with LogWriter(folder / "bag.mcap", [log_topic("/joint_states", JOINT_STATE)]) as bag:
        for k in range(COUNT):
            at = k * 10**9 // RATE
            angle = np.array([2.0 * math.pi * TURNS * (k + 0.5) / COUNT])
            stamp = header(stamp=time(sec=at // 10**9, nanosec=at % 10**9), frame_id="")
            none = np.empty(0)
            message = state(header=stamp, name=["a"], position=angle, velocity=none, effort=none)
            data = bytes(store.serialize_cdr(message, JOINT_STATE))
            bag.write("/joint_states", data, at, at)
    settings = Parameters(
        joint_name="a",
        mechanism_file=str(mechanism),
        table_file=str(folder / "table.npz"),
        engine_speed=3000.0,
    )
    done = replay(folder / "bag.mcap", folder / "log.mcap", settings)
    assert done.statuses[0] == COUNT
    return folder / "log.mcap"


def test_linkage_is_drawn_in_every_turn(browser: Any, log: Path) -> None:
    """At the same phase of each turn the linkage is drawn alike, at others it is not."""
    page = log.with_suffix(".html")
    assert main(["review", str(log), "-o", str(page)]) == 0
    browser.problems.clear()
    browser.resize(1280, 900)
    browser.open(page)
    lines = "[...document.querySelectorAll('#linkage polyline')].map(e => e.getAttribute('points'))"
    browser.key("m", "m")  # without the motion, it is drawn out of sight, too
    drawn = []
    for turn in range(TURNS):
        for phase in PHASES:
            browser.hover(browser.place("#chart-angle .u-over", (turn + phase) / TURNS))
            still = browser.evaluate(lines)[: len(browser.evaluate(lines)) // 2]
            drawn.append([float(x) for line in still for x in re.split("[ ,]+", line.strip())])
    places = np.array(drawn).reshape(TURNS, len(PHASES), -1)
    largest = np.abs(places).max()
    assert np.abs(places[1:] - places[0]).max() < 0.05 * largest  # within two samples
    assert np.abs(places[:, 1:] - places[:, :-1]).max(axis=2).min() > 0.1 * largest
    assert browser.problems == []
