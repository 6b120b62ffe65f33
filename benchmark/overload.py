# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Counts what an overloaded machine leaves unanswered, and what the node says about it.

`python -m benchmark.overload` takes three minutes.
"""

import re
import signal
from collections import defaultdict
from contextlib import ExitStack

from diagnostic_msgs.msg import DiagnosticArray

from benchmark.latency.__main__ import ECHO, OURS, busy
from benchmark.latency.driver import Driver, named, running
from benchmark.report import machine, publish, table

SECONDS = 30.0
NODES = {"echo": [*ECHO, "events"], "ours": OURS}
LOADS = {  # rate in Hz, processes that compute, clients that flood services
    "23 processes compute": (200.0, 23, 0),
    "two clients flood three services": (1000.0, 0, 2),
}
VALUES = ("messages lost", "messages left out", "longest wait [s]")


def measure(node: str, rate: float, computing: int, flooding: int) -> list[str]:
    """Return what was sent to and answered by a node, and what its diagnostics counted."""
    said, driver = defaultdict[str, float](float), Driver()

    def listen(message: DiagnosticArray) -> None:
        for value in (value for status in message.status for value in status.values):
            if value.key in VALUES:
                numbers = [float(number) for number in re.findall(r"[\d.]+$", value.value)]
                said[value.key] = max(said[value.key], *numbers, 0.0)

    driver.node.create_subscription(DiagnosticArray, "/diagnostics", listen, 100)
    with ExitStack() as stack:
        process = stack.enter_context(running([*NODES[node], *named(node)]))
        driver.meet(node)
        target = node
        if flooding and node == "echo":  # which has no services, so that another node is flooded
            target = "flooded"
            stack.enter_context(running([*OURS, *named(target)]))
            driver.meet(target)
        for _ in range(flooding):
            flood = ["-m", "benchmark.latency.flood", f"/{target}"]
            stack.enter_context(running(flood, signal.SIGKILL))
        said.clear()
        stack.enter_context(busy(computing))
        run = driver.run(node, process, rate, round(rate * SECONDS))
    driver.close()
    sent, late = round(rate * SECONDS), 1e3 * max(run.latencies, default=float("nan"))
    row = [str(sent), str(sent - run.lost), f"{late:.0f}"]
    if node == "echo":
        return [*row, "", "", ""]
    return [*row, *(f"{said[value]:g}" for value in VALUES)]


def main() -> None:
    """Measure both nodes under both loads, and write the page."""
    rows = [
        [load, f"{numbers[0]:g}", node, *measure(node, *numbers)]
        for load, numbers in LOADS.items()
        for node in NODES
    ]
    columns = ["load", "rate [Hz]", "node", "sent", "answered", "latest answer [ms]"]
    parts = [
        f"Joint states are published for {SECONDS:g} s on a machine that is too busy. The echo "
        "answers each one that arrives, however late. Our node leaves old readings out while newer "
        "ones wait, and its diagnostics count what is lost, what is left out, and the longest "
        "wait. An earlier version, on another machine, answered 5012 of 6893 readings under such a "
        "load, and 31,634 of 59,220 beside flooding clients, up to 20 s late, and said nothing.",
        table([*columns, "lost", "left out", "longest wait [s]"], rows),
    ]
    publish("overload", "An overloaded machine", parts, machine())


if __name__ == "__main__":
    main()
