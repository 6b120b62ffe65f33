# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Times what an overloaded machine answers, and counts what it leaves unanswered.

`python -m benchmark.overload` takes seven minutes.
"""

import os
import re
import signal
from collections import defaultdict
from contextlib import ExitStack

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from tqdm import tqdm

from benchmark.latency.__main__ import ECHO, OURS, busy
from benchmark.latency.driver import SPEED_RATE, Driver, Run, named, running
from benchmark.report import machine, publish, table

TURNS, SECONDS = 3, 10.0  # the nodes take turns of this length
NODES = {"echo": [*ECHO, "events", "speeds"], "ours": OURS}
COMPUTING = 24
LOADS = {  # rate in Hz, processes that compute, clients that flood services
    **{f"{COMPUTING} processes compute, {r:g} Hz": (r, COMPUTING, 0) for r in (50.0, 100.0, 1e3)},
    "two clients flood three services, 1000 Hz": (1000.0, 0, 2),
}
VALUES = ("messages lost", "messages left out", "longest wait [s]")
FACTOR, ADDED = 2.0, 20.0  # the largest median: this many times that of the echo, and ms


def measure(rate: float, computing: int, flooding: int) -> dict[str, tuple[list[Run], list[str]]]:
    """Return the runs of the echo and of our node, and what its diagnostics counted."""
    said, driver = defaultdict[str, float](float), Driver()
    runs: dict[str, list[Run]] = {node: [] for node in NODES}

    def listen(message: DiagnosticArray) -> None:
        for value in (value for status in message.status for value in status.values):
            if value.key in VALUES:
                numbers = map(float, re.findall(r"[\d.]+(?=,|$)", value.value))
                said[value.key] = max(said[value.key], sum(numbers))

    driver.node.create_subscription(DiagnosticArray, "/diagnostics", listen, 100)
    with ExitStack() as stack:
        processes = {}
        for node, command in NODES.items():
            processes[node] = stack.enter_context(running([*command, *named(node)]))
            driver.meet(node, speeds=True)
        for _ in range(flooding):  # the echo has no services
            flood = ["-m", "benchmark.latency.flood", "/ours"]
            stack.enter_context(running(flood, signal.SIGKILL))
        said.clear()
        stack.enter_context(busy(computing))
        for _ in range(TURNS):
            for node, process in processes.items():
                runs[node].append(driver.run(node, process, rate, round(rate * SECONDS)))
    driver.close()
    counts = {"echo": [""] * len(VALUES), "ours": [f"{said[value]:g}" for value in VALUES]}
    return {node: (runs[node], counts[node]) for node in NODES}


def rows(load: str) -> list[list[str]]:
    """Return the rows of a load: delays and shares of both nodes, and whether ours is quick."""
    lines, limit, rate = [], 0.0, LOADS[load][0]
    for node, (runs, counts) in measure(*LOADS[load]).items():
        delays = 1e3 * np.concatenate([run.latencies for run in runs])
        answered = 100.0 * len(delays) / (rate * SECONDS * TURNS)
        median, late = np.percentile(delays, [50.0, 99.0])
        quick = "" if node == "echo" else f"{limit:.0f}: {'yes' if median <= limit else 'no'}"
        limit = FACTOR * median + ADDED
        numbers = f"{answered:.1f}", f"{median:.1f}", f"{late:.0f}", f"{delays.max():.0f}"
        lines.append([load, node, *numbers, quick, *counts])
    return lines


def main() -> None:
    """Measure both nodes under each load, and write the page."""
    load = os.getloadavg()[0]  # of other processes
    lines = [line for each in tqdm(LOADS, unit="load") for line in rows(each)]
    columns = ["load", "node", "answered [%]", "median [ms]", "p99 [ms]", "latest [ms]"]
    parts = [
        "Joint states are published on a machine that is too busy, beside the speeds of engine, "
        f"PTO and ground at {SPEED_RATE:g} Hz each. The echo answers each one that arrives, in the "
        "order of arrival and however late. Our node leaves out a message whose answer would come "
        "more than 0.05 s after its arrival, once there is a newer one. Its diagnostics count what "
        "is lost, what is left out (speeds included), and the longest wait.",
        f"Both nodes run all the time and take {TURNS} turns of {SECONDS:g} s each. The delay is "
        "the time from just before a joint state is published until its answer is taken, so it "
        "contains how long the driver itself waited for a processor. The median of our node is to "
        f"be at most {FACTOR:g} times that of the echo and {ADDED:g} ms; the column shows this "
        "limit, and whether it was kept.",
        table([*columns, "limit [ms]", "lost", "left out", "longest wait [s]"], lines),
    ]
    about = f"load average {load:.1f} before it began, as other work shared the machine"
    publish("overload", "An overloaded machine", parts, machine(about))


if __name__ == "__main__":
    main()
