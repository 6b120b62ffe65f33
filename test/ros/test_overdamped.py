# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A hitch whose lowest mode becomes overdamped, from the node over DDS to the review page."""

import csv
import io
import json
import math
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from linkage_vibration.cli.main import main
from linkage_vibration.drawing.live_line import LiveLine
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages.topics import PREDICTION_TOPIC, RESONANCE_TOPIC
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import PAPER_MECHANISM, config_file
from linkage_vibration.table.table import save_table
from linkage_vibration.table.tabulation import build_table
from linkage_vibration_interfaces.srv import GetModeShapes
from test.support.browser import Browser
from test.support.messages import raw_messages

ANGLES = np.radians(np.linspace(150.0, 165.0, 31))
BEGIN = math.radians(162.75)  # mode 1 is overdamped beyond; its damping ratio is 0.997 at 162.5 deg
OVERDAMPED = np.greater(ANGLES, BEGIN)


RATE = {"resonance_rate": 0.0}  # the stamps of the peer lie in one period


@pytest.fixture(scope="module")
def hitch(tmp_path_factory: pytest.TempPathFactory) -> Parameters:
    """Return the parameters for the shipped hitch with a damper from P2 to E1, coarsely meshed."""
    mapping = yaml.safe_load(config_file(PAPER_MECHANISM).read_text())
    for link in mapping["links"].values():
        link |= {"elements": 4, "modes": 2}
    mapping["input"]["range_deg"] = [150.0, 165.0]
    mapping["springs"] = {"s": {"between": ["P2", "E1"], "damping": 1e5}}
    path = tmp_path_factory.mktemp("hitch") / "hitch.yaml"
    path.write_text(yaml.safe_dump(mapping, sort_keys=False))
    table = path.with_suffix(".npz")
    save_table(build_table(LinkageModel(read_mechanism(path)), 1e-3), table)
    return Parameters(mechanism_file=str(path), table_file=str(table), engine_speed=150.0, **RATE)


@pytest.fixture(scope="module")
def recorded(
    hitch: Parameters,
    start: Callable[..., Any],
    meet: Callable[..., Any],
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, list[Any], Any, Any, str]:
    """Return the node's log, its messages, answers of two services, and what it printed."""
    folder = tmp_path_factory.mktemp("log")
    files = {"mechanism_file": hitch.mechanism_file, "table_file": hitch.table_file}
    speed = hitch.engine_speed
    node = start(
        name="heavy", record=True, log_directory=folder, engine_speed=speed, **files, **RATE
    )
    peer = meet("heavy")
    actual = [peer.ask(positions=(angle,)) for angle in ANGLES.tolist()]
    answer = peer.call(ANGLES.tolist())
    client = peer.node.create_client(GetModeShapes, "heavy/get_mode_shapes")
    shapes = peer.request(client, GetModeShapes.Request(crank_angle=ANGLES[-1]))
    assert node.stop() == 0
    [log] = folder.glob("*.mcap")
    return log, actual, answer, shapes, node.printed


@pytest.fixture(scope="module")
def files(
    recorded: Any, hitch: Parameters, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    """Return a replay of the node's log, and what `review` writes of it, by suffixes."""
    folder = tmp_path_factory.mktemp("files")
    actual = {kind: folder / f"heavy.{kind}" for kind in ("mcap", "html", "csv", "png")}
    replay(recorded[0], actual["mcap"], hitch)
    log = str(actual["mcap"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        options = ["--csv", str(actual["csv"]), "--png", str(actual["png"])]
        assert main(["review", log, *options]) == 0
    return actual


def test_node(recorded: Any) -> None:
    """Only the numbers of the overdamped mode are NaN; the status is OK, and nothing warns."""
    _, actual, answer, shapes, printed = recorded
    assert answer.success
    for message in actual, answer.predictions:
        for name in (
            "natural_frequencies",
            "damping_ratios",
            "frequency_stddevs",
            "damping_ratio_stddevs",
        ):
            values = np.array([getattr(each, name) for each in message])
            np.testing.assert_array_equal(np.isnan(values[:, 0]), OVERDAMPED)
            assert np.isfinite(values[:, 1:]).all()
        assert all(each.status == each.STATUS_OK for each in message)
        assert np.isfinite([each.frf_peak_magnitude for each in message]).all()
    assert shapes.success
    assert min(shapes.natural_frequencies) > 80.0  # mode 1, of 5 Hz, is left out
    for line in printed.splitlines():  # the peer begins with an angle that is out of range
        assert "[INFO]" in line or "114.5916 deg is not in the table" in line


def test_same_bytes(recorded: Any, files: dict[str, Path]) -> None:
    """The replay gives the bytes of the node, NaN included, and never names the overdamped mode."""
    for topic in (PREDICTION_TOPIC, RESONANCE_TOPIC):
        own = topic.replace("linkage_vibration", "heavy")
        live = [data for _, _, data in raw_messages(recorded[0], own)]
        assert len(live) >= len(ANGLES)
        assert [data for _, _, data in raw_messages(files["mcap"], topic)] == live


def test_table_of_numbers(files: dict[str, Path]) -> None:
    """The CSV has nan for that mode only, which no excitation is compared with there."""
    rows = list(csv.DictReader(io.StringIO(files["csv"].read_text())))
    rows = [row for row in rows if row["status"] == "0"]
    # The first angle jumps from that of the meeting, so that it and the next one are doubted.
    rows = [row for row in rows if float(row["crank_angle_rad"]) > ANGLES[1]]
    assert len(rows) >= len(ANGLES) - 2
    for row in rows:
        values = [float(row[f"natural_frequency_{k}_hz"]) for k in (1, 2, 3)]
        overdamped = float(row["crank_angle_rad"]) > BEGIN
        assert [math.isnan(value) for value in values] == [overdamped, False, False]
        assert math.isnan(float(row["damping_ratio_stddev_1"])) == overdamped
        assert row["mode"] == ("2" if overdamped else "1")


def test_page(files: dict[str, Path], capsys: Any) -> None:
    """The data of the page are valid JSON, which names the mode, and the picture is drawn."""
    assert files["png"].stat().st_size > 10_000
    log = str(files["mcap"])
    assert main(["review", log, "--against", log]) == 0
    assert " nan " not in capsys.readouterr().out
    [text] = re.findall(r'id="data"[^>]*>(.*?)</script>', files["html"].read_text(), re.DOTALL)
    data = json.loads(text, parse_constant=pytest.fail)
    facts = dict(data["provenance"]["rows"])
    assert re.fullmatch(r"overdamped in \d+ predictions", facts["Mode 1 (implement heave)"])


def test_page_in_a_browser(files: dict[str, Path]) -> None:
    """At an angle at which the mode is overdamped, the numbers and the linkage say so."""
    with Browser() as browser:
        browser.open(files["html"])
        browser.hover(browser.place("#chart-modes .u-over", 0.9999))
        assert browser.text("#read-f1") == "overdamped"
        assert browser.text("#read-f2").endswith("Hz")
        assert "Mode 1 (implement heave) is overdamped at 165.00°" in browser.text(
            "#linkage-caption"
        )
        assert browser.problems == []


def test_lines(recorded: Any, hitch: Parameters, capsys: Any) -> None:
    """The live line and the command name the overdamped mode, and keep their columns."""
    actual = recorded[1]
    lines = []
    for each in (actual[0], actual[-1]):
        stream = io.StringIO()
        LiveLine(stream).show(each)
        lines.append(stream.getvalue())
    assert " overd. " in lines[1]
    assert len(lines[0]) == len(lines[1])
    assert main(["predict", hitch.table_file, "150", "165"]) == 0
    head, first, *others = capsys.readouterr().out.splitlines()
    assert first.split()[-1] == "overdamped"
    assert {len(head), len(first)} == {len(line) for line in others}
