# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares recoveries with what stayed intact: ``python -m benchmark.damaged_logs [COUNT]``.

Logs of the node and of the writer of mcap are damaged in six ways. A scan that knows the file as it
was says which messages are intact; see `test.support.mcap_damage`.
"""

import random
import sys
import tempfile
from pathlib import Path

from tqdm import tqdm

from benchmark.report import machine, publish, table
from linkage_vibration.bags.recovery import RecoveryError, recover
from test.support.mcap_damage import DAMAGES, example_logs, intact, read_messages

COUNT = 1080
COLUMNS = ["damage", "logs", "intact messages", "of them lost", "saved", "of them not in the log"]


def main() -> None:
    """Damage and recover logs, and publish what was lost."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    totals = {kind: [0] * 5 for kind in DAMAGES}
    with tempfile.TemporaryDirectory() as name:
        logs = list(example_logs(Path(name)).items())
        for k in tqdm(range(count), unit="damage"):
            kind, (log, content) = list(DAMAGES)[k % 6], logs[k // 6 % len(logs)]
            chunked = log != "mcap, without chunks"
            row = outcome(Path(name), kind, content, random.Random(k), chunked)
            totals[kind] = [a + b for a, b in zip(totals[kind], row, strict=True)]
    publish(
        "damaged_logs",
        "Recovery of damaged logs",
        [
            "This page shows what `linkage-vibration recover` loses of damaged logs, beside a scan "
            "that knows each log as it was. The logs are those of the node (zstd, lz4, without "
            "compression, and killed before its end) and those of the writer of mcap (each "
            "compression, without CRCs, and without chunks). A chunk is intact as a whole; a "
            "message outside of chunks is intact before the first damage, with the head of the "
            "record behind it, which alone confirms its length; and both need an intact definition "
            "of their channel anywhere in the file. Messages that are not in the log come from "
            "files without CRCs or chunks, where nothing shows damage within a message.",
            table(COLUMNS, [[kind, *map(str, total)] for kind, total in totals.items()]),
        ],
        machine("mcap", "zstandard", "lz4"),
    )


def outcome(
    folder: Path, kind: str, content: bytes, rng: random.Random, chunked: bool
) -> list[int]:
    """Damage a log; return 1, and the numbers of the other columns."""
    damaged, spans = DAMAGES[kind](content, rng)
    expected = intact(content, [span for span in spans if chunked or span[0] == 0])
    log, output = folder / "damaged.mcap", folder / "whole.mcap"
    log.write_bytes(damaged)
    output.unlink(missing_ok=True)
    try:
        recover(log, output)
        saved = set(read_messages(output))
    except RecoveryError:
        saved = set()
    wrong = saved - intact(content, [(0, len(content))])
    return [1, len(expected), len(expected - saved), len(saved), len(wrong)]


if __name__ == "__main__":
    main()
