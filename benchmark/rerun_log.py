# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Loads a log with Rerun and compares every field: ``python -m benchmark.rerun_log``.

It also writes ``config/rerun_blueprint.rbl``, with which Rerun's viewer shows a log.
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping
from rerun.chunk import RrdReader

from benchmark.report import machine, publish, table
from linkage_vibration.messages.fields import message_fields
from linkage_vibration.messages.topics import LOAD_STATE, PREDICTION, RESONANCE
from linkage_vibration.playback.replay import replay
from linkage_vibration.support.resources import config_file
from test.support.messages import plain, read_messages

NODE = "/linkage_vibration"
KINDS = {"prediction": PREDICTION, "resonance": RESONANCE, "load_state": LOAD_STATE}
TOPICS = {f"{NODE}/{name}": kind for name, kind in KINDS.items()}
BLUEPRINT = config_file("rerun_blueprint.rbl")
_MODES = 5, 7, 9, 11  # indices of those in the plane; pitch and surge of the tractor hardly change


def component(topic: str) -> str:
    """Return Rerun's name of the messages of a topic."""
    return f"{TOPICS[topic].replace('/', '.')}:message"


def line(topic: str, name: str, field: str) -> rrb.Visualizer:
    """Return a line that shows a field of the messages of a topic.

    Parameters
    ----------
    topic, name, field
        Full name of the topic; text of the legend; path to the number.
    """
    assert field.split("[")[0] in {known.name for known in message_fields(TOPICS[topic])}
    result = VisualizerComponentMapping(
        target="Scalars:scalars",
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=component(topic),
        selector=f".{field}",
    )
    return rr.SeriesLines(names=name).visualizer(mappings=[result])


def blueprint() -> rrb.Blueprint:
    """Return views of the natural frequencies beside the excitation, of the load and the angle."""
    prediction, resonance, load_state = TOPICS
    modes = [line(prediction, f"mode {i + 1} [Hz]", f"natural_frequencies[{i}]") for i in _MODES]
    severe = line(resonance, "most severe excitation [Hz]", "excitation_frequency")
    loads = [
        line(load_state, "all excitations that are known", "total_load_ratio"),
        line(load_state, "limit of a warning", "load_ratio_limit"),
    ]
    views = [
        rrb.TimeSeriesView(
            name="Natural frequencies and the most severe excitation [Hz]",
            origin="/",
            contents=[prediction, resonance],
            overrides={prediction: modes, resonance: [severe]},
        ),
        rrb.TimeSeriesView(
            name="Load ratio", origin="/", contents=[load_state], overrides={load_state: loads}
        ),
        rrb.TimeSeriesView(
            name="Crank angle [rad]",
            origin="/",
            contents=[prediction],
            overrides={prediction: [line(prediction, "crank angle", "crank_angle")]},
        ),
    ]
    return rrb.Blueprint(rrb.Vertical(*views), collapse_panels=True)


def loaded(path: Path, topic: str) -> Iterator[Any]:
    """Yield the messages of a topic as Rerun returns them, as dictionaries."""
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == topic and component(topic) in batch.schema.names:
            for row in batch.column(component(topic)).to_pylist():
                yield row[0]


def differing(ours: Any, theirs: Any) -> bool:
    """Return whether a value of ours differs from that of Rerun."""
    if isinstance(ours, dict):
        return any(differing(value, theirs[name]) for name, value in ours.items())
    if isinstance(theirs, str):
        return bool(ours != theirs)
    # `plain` has "NaN" for numbers that are not known, which becomes a number here.
    return not np.array_equal(np.asarray(ours, float), np.asarray(theirs, float), equal_nan=True)


def main() -> None:
    """Convert a log, compare its messages, and write the results and the blueprint."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        log, converted = Path(folder) / "drive.mcap", Path(folder) / "drive.rrd"
        replay([config_file("drives/hitch_duty_cycle.mcap")], log)
        command = [sys.executable, "-m", "rerun", "mcap", "convert", str(log), "-o", str(converted)]
        run = subprocess.run(command, check=True, capture_output=True, text=True)
        warnings = [text for text in run.stderr.splitlines() if "WARN" in text]
        about = [text for text in warnings if "metadata" in text.lower()]
        for topic in TOPICS:
            ours = [plain(message) for _, message in read_messages(log, topic)]
            theirs = list(loaded(converted, topic))
            names = list(ours[0])
            wrong = [
                name
                for name in names
                if any(differing(a[name], b[name]) for a, b in zip(ours, theirs, strict=True))
            ]
            rows.append([topic, str(len(theirs)), str(len(names)), ", ".join(wrong) or "none"])
    blueprint().save("linkage_vibration", str(BLUEPRINT))
    [saved] = RrdReader(BLUEPRINT).blueprints()
    publish(
        "rerun_log",
        "A log in Rerun",
        [
            "This page shows that Rerun loads our logs, and that every field of every message can "
            "be queried. The log is a replay of the shipped drive, converted by `rerun mcap "
            "convert`. Each field is compared with what mcap with mcap-ros2-support reads.",
            table(["topic", "messages", "fields", "fields that differ"], rows),
            f"Rerun warned {len(about)} times of metadata records of the same name. The blueprint "
            f"`config/{BLUEPRINT.name}` was written, and read again as {type(saved).__name__}; it "
            "was not looked at in the viewer, which needs a display.",
        ],
        machine("rerun-sdk", "mcap", "mcap-ros2-support"),
    )


if __name__ == "__main__":
    main()
