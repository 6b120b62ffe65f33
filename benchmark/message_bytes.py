# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Counts the bytes of the answers to readings at 1 kHz: ``python -m benchmark.message_bytes``."""

import tempfile
from pathlib import Path

from mcap.reader import make_reader
from tqdm import tqdm

from benchmark.replay import write_mcap
from benchmark.report import machine, publish, table
from linkage_vibration.playback.replay import replay
from linkage_vibration.prediction.settings import Parameters

SECONDS = 20
NAMES = "prediction", "resonance", "levels", "load_state"
TOPICS = [f"/linkage_vibration/{name}" for name in NAMES]
RATES = {
    "each reading": (0.0, 0.0),
    "by default": (0.0, 10.0),
    "for a control stack": (10.0, 10.0),
    "least": (1.0, 1.0),
}
"""Rates of predictions and resonances, Hz."""


def main() -> None:
    """Replay readings with each pair of rates, and publish the table of bytes."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        bag, log = Path(folder, "bag.mcap"), Path(folder, "log.mcap")
        write_mcap(bag, SECONDS, speeds=True)
        for name, (predictions, resonances) in tqdm(RATES.items(), unit="replay"):
            rates = Parameters(prediction_rate=predictions, resonance_rate=resonances)
            replay(bag, log, rates)
            sizes = [message_sizes(log, topic) for topic in TOPICS]
            cells = [f"{sum(each) / len(each):.0f} x {len(each) / SECONDS:g}" for each in sizes]
            total = sum(map(sum, sizes)) / SECONDS
            rows.append([name, f"{predictions:g}", f"{resonances:g}", *cells, f"{total / 1e3:.1f}"])
    columns = ["rates", "`prediction_rate`", "`resonance_rate`"]
    columns += [f"{topic.rpartition('/')[2]}, bytes x Hz" for topic in TOPICS]
    publish(
        "message_bytes",
        "Bytes of messages",
        [
            "This page shows how many bytes the node publishes for readings at 1 kHz, with the "
            "shipped linkage, six modes and 13 excitations, and three speeds. They are the "
            "serialised messages, without the headers of DDS. A topic costs nothing on the network "
            "while nobody subscribes to it.",
            table([*columns, "all, kB/s"], rows),
        ],
        machine("mcap"),
    )


def message_sizes(log: Path, topic: str) -> list[int]:
    """Return the sizes of the messages of a topic, bytes."""
    with log.open("rb") as file:
        return [len(message.data) for *_, message in make_reader(file).iter_messages([topic])]


if __name__ == "__main__":
    main()
