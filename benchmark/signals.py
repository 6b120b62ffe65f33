# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Ends the node by signals at random moments: ``python -m benchmark.signals [COUNT]``.

The node records and answers joint states at 1 kHz. Each process must exit with 0, print no warning,
and leave no log that has to be recovered.
"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader
from tqdm import tqdm

from benchmark.latency.__main__ import OURS
from benchmark.latency.driver import Driver, named
from benchmark.report import machine, publish, table

COUNT = 100
EARLIEST = 0.5  # s after the start of the process; before that, Python itself starts
LATEST = 3.0  # s
PATIENCE = 10.0  # s until a process is killed
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
COMMAND = [sys.executable, *OURS, *named("ended", "-p", "record:=true")]


def main() -> None:
    """Send signals to one process after another, and publish how each ended."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COUNT
    chance = random.Random(1)
    ends = {number: Counter[str]() for number in SIGNALS}
    driver, over = Driver(), threading.Event()

    def send() -> None:
        while not over.wait(1e-3):
            driver.publish("ended", 0)

    sender = threading.Thread(target=send)
    sender.start()
    for _ in tqdm(range(count), unit="process"):
        number, after = chance.choice(SIGNALS), chance.uniform(EARLIEST, LATEST)
        ends[number][ended(number, after)] += 1
    over.set()
    sender.join()
    driver.close()
    rows = [
        [number.name, how, f"{times}"] for number, end in ends.items() for how, times in end.items()
    ]
    publish(
        "signals",
        "Nodes ended by signals",
        [
            "This page shows how the node ends when it receives a signal. Each of "
            f"{count} processes received one {EARLIEST:g} to {LATEST:g} s after its start, while "
            "joint states arrived at 1 kHz.",
            table(["signal", "how it ended", "processes"], rows),
        ],
        machine(),
    )


def ended(number: signal.Signals, after: float) -> str:
    """Start a node, send it a signal ``after`` seconds, and return how it ends."""
    with tempfile.TemporaryDirectory() as folder:
        node = subprocess.Popen(
            COMMAND,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        time.sleep(after)
        node.send_signal(number)
        try:
            output, _ = node.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            node.kill()
            node.communicate()
            return "not at all"
        if node.returncode:
            return f"exit code {node.returncode}"
        warnings = [line for line in output.splitlines() if not line.startswith("[INFO]")]
        if warnings:
            return f"warned: {warnings[0]}"
        logs = list(Path(folder).iterdir())
        for log in logs:
            try:
                with log.open("rb") as file:
                    summary = make_reader(file).get_summary()
            except McapError as error:
                return f"log cannot be read: {error}"
            if log.suffix != ".mcap" or summary is None:
                return f"{log.suffix} file is not complete"
        return "exit code 0, log complete" if logs else "exit code 0, before its log"


if __name__ == "__main__":
    main()
