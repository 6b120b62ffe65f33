# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Implements by name over real DDS: parameter, action, and a restart."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from mcap.reader import make_reader

from linkage_vibration.bags.recorder import PROVENANCE_METADATA
from test.support.ros_process import Peer, RunningNode, start_node

OWN = {"inertia": 300.0, "centre_of_gravity": [0.2, 1.0]}
IMPLEMENTS = {"plough": {"mass": 1200.0, **OWN}, "mower": {"mass": 500.0, **OWN}}


def test_from_start_to_restart(
    environment: dict[str, str], tmp_path: Path, meet: Callable[..., Peer], mechanism_file: Path
) -> None:
    """A goal chooses, logs name the choice, and a restart has its parameters and its table."""
    path = tmp_path / "implements.yaml"
    path.write_text(yaml.safe_dump({"implements": IMPLEMENTS}))
    small = tmp_path / "small.yaml"
    small.write_text(small_linkage(mechanism_file))
    nodes: list[RunningNode] = []
    variables = {**environment, "XDG_CACHE_HOME": str(tmp_path / "cache")}

    def begin(**parameters: object) -> RunningNode:
        files = {"mechanism_file": small, "implement_file": path, "log_directory": tmp_path}
        options: dict[str, Any] = {"name": "hitched", "record": True, **files, **parameters}
        output = tmp_path / f"printed_{len(nodes)}.txt"
        nodes.append(start_node(output, variables, **options))
        return nodes[-1]

    try:
        node = begin()
        node.wait_for("of three_point_linkage.")
        assert " % of the table is built." in node.printed
        peer = meet("hitched")
        own = peer.ask().natural_frequencies[0]
        answer = peer.implement("hitched", name="drill")
        assert "There is no implement 'drill'" in answer.message
        answer = peer.implement("hitched", name="plough")
        assert answer.success, answer.message
        assert "with the implement plough from now on" in node.printed
        assert peer.ask().natural_frequencies[0] < own
        assert node.stop() == 0
        again = begin()
        again.wait_for("of three_point_linkage.")
        assert "table is built" not in again.printed  # It was kept.
        assert again.stop() == 0
        chosen = begin(implement="mower")
        chosen.wait_for("of three_point_linkage with the implement mower.")
        assert chosen.stop() == 0
    finally:
        for each in nodes:
            each.process.kill()
    logs = list(tmp_path.glob("*.mcap"))
    assert {in_use(log) for log in logs} == {
        ("", "", 800.0),
        ("plough", "plough", 1200.0),
        ("mower", "mower", 500.0),
    }


def small_linkage(file: Path) -> str:
    """Return the paper's linkage over a tenth of its stroke, whose table takes little time."""
    mapping = yaml.safe_load(file.read_text())
    mapping["input"]["range_deg"] = [112.0, 121.0]
    mapping["response"] |= {"band_hz": [0.0, 20.0], "modes": 1}
    for link in mapping["links"].values():
        link |= {"elements": 4, "modes": 1}
    return yaml.safe_dump(mapping, sort_keys=False)


def in_use(log: Path) -> tuple[str, str, float]:
    """Return the implement of a log in its metadata, its parameters, and by its mass."""
    with log.open("rb") as file:
        reader = make_reader(file)
        facts = next(m.metadata for m in reader.iter_metadata() if m.name == PROVENANCE_METADATA)
        attached = {a.name: a.data for a in reader.iter_attachments()}
    [section] = yaml.safe_load(attached["parameters.yaml"]).values()
    body = yaml.safe_load(attached["mechanism.yaml"])["rigid_bodies"]["implement"]
    return facts.get("implement", ""), section["ros__parameters"]["implement"], body["mass"]
