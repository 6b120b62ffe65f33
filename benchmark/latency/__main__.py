# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the latency of nodes: ``python -m benchmark.latency [TURNS]``.

The nodes are a plain rclpy node that echoes, and ours with and without recording. All run all the
time and take short turns, so that the load of the machine affects them equally.
"""

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmark.latency.driver import Driver, Run, named, running
from benchmark.report import RESULTS, machine, publish, table

TURNS = 16
SECONDS = {10.0: 2.0, 100.0: 1.0, 200.0: 1.0, 1000.0: 1.0}  # length of a turn by rate in Hz
RESAMPLED = 1000

ECHO = ["-m", "benchmark.latency.echo"]
OURS = ["-m", "linkage_vibration.ros.node"]
OLDER = (  # an rclpy version for which the node does not use the events executor
    "import sys, importlib.metadata as metadata; metadata.version = lambda _: '7.1.4';"
    "from linkage_vibration.ros.node import main; sys.exit(main())"
)
NODES = {
    "echo": [*ECHO, "single-threaded", *named("echo")],
    "ours": [*OURS, *named("ours")],
    "ours, recording": [*OURS, *named("ours_recording", "-p", "record:=true")],
    "ours, single-threaded": ["-c", OLDER, *named("ours_single_threaded")],
    "echo, events executor": [*ECHO, "events", *named("echo_events_executor")],
    "echo, multi-threaded": [*ECHO, "multi-threaded", *named("echo_multi_threaded")],
}


def main() -> None:
    """Measure all nodes, and publish their figures and the ratios to the echo."""
    turns = int(sys.argv[1]) if len(sys.argv) > 1 else TURNS
    names = {name: name.translate({ord(" "): "_", ord("-"): "_", ord(","): None}) for name in NODES}
    runs: dict[tuple[str, float], list[Run]] = {(n, r): [] for n in NODES for r in SECONDS}
    driver = Driver()
    with ExitStack() as stack:
        processes = {}
        for name, command in NODES.items():
            processes[name] = stack.enter_context(running(command))
            driver.meet(names[name])
        order = [(rate, turn) for rate in SECONDS for turn in range(turns)]
        for rate, turn in tqdm(order, unit="turn"):
            for name in rotated(list(NODES), turn):
                count = round(rate * SECONDS[rate])
                run = driver.run(names[name], processes[name], rate, count)
                runs[name, rate].append(run)
    driver.close()
    draw(runs, RESULTS / "latency.png")
    columns = ["node", "rate [Hz]", "median [ms]", "p99 [ms]", "CPU [%]", "lost"]
    columns += ["median / echo", "p99 / echo", "CPU / echo"]
    publish(
        "latency",
        "Latency of the node and of an echo",
        [
            "This page compares the latency of our node with that of a plain rclpy node that "
            "echoes each joint state. Joint states and predictions pass over DDS between "
            f"processes, in {turns} turns of each node at each rate. The latency is the time from "
            "just before the driver publishes a joint state until it takes the prediction. The "
            "brackets contain 90 % of the ratios when turns are resampled (bootstrap). The echo "
            "runs in rclpy's single-threaded executor, and ours in the events executor.",
            table(columns, rows(runs)),
            parts(),
            "![](latency.png)",
        ],
        machine(),
    )


def rotated(names: list[str], by: int) -> list[str]:
    """Return names in rotated order."""
    by %= len(names)
    return names[by:] + names[:by]


def figures(runs: Sequence[Run]) -> NDArray[np.float64]:
    """Return the median and 99th percentile (ms) and the CPU (%) of all runs, (3,)."""
    latencies = np.concatenate([run.latencies for run in runs])
    median, high = np.percentile(1e3 * latencies, [50.0, 99.0])
    cpu = 100.0 * sum(run.cpu for run in runs) / sum(run.lasted for run in runs)
    return np.array([median, high, cpu])


def ratios(own: Sequence[Run], echo: Sequence[Run]) -> list[str]:
    """Return the ratios of the figures, with bootstrap intervals."""
    random = np.random.default_rng(1)
    found = []
    for _ in range(RESAMPLED):
        sample = random.integers(len(own), size=len(own))
        found.append(figures([own[i] for i in sample]) / figures([echo[i] for i in sample]))
    low, high = np.percentile(found, [5.0, 95.0], axis=0)
    middle = figures(own) / figures(echo)
    return [f"{m:.2f} ({a:.2f} to {b:.2f})" for m, a, b in zip(middle, low, high, strict=True)]


def rows(runs: dict[tuple[str, float], list[Run]]) -> list[list[str]]:
    """Return the rows of the table: the figures of each node at each rate."""
    lines = []
    for (name, rate), own in sorted(runs.items(), key=lambda entry: entry[0][1]):
        median, high, cpu = figures(own)
        lost = sum(run.lost for run in own)
        row = [name, f"{rate:g}", f"{median:.2f}", f"{high:.2f}", f"{cpu:.1f}", f"{lost}"]
        lines.append([*row, *(ratios(own, runs["echo", rate]) if name != "echo" else "111")])
    return lines


def parts() -> str:
    """Return a table of the times of the Python steps of a prediction, with bars of text."""
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import JointState

    from linkage_vibration.messages.encoding import encode_prediction
    from linkage_vibration.prediction.predictor import Predictor
    from linkage_vibration.support.resources import DEFAULT_TABLE, config_file
    from linkage_vibration.table.table import load_table

    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    message = JointState(name=["hitch_rockshaft_joint"], position=[2.0])
    data = serialize_message(message)
    prediction = predictor.predict(2.0)
    steps: dict[str, Callable[[], object]] = {
        "table lookup": lambda: predictor.table.interpolate(2.0),
        "prediction, lookup included": lambda: predictor.predict(2.0),
        "encoding the prediction": lambda: encode_prediction(prediction, 0, 0, ""),
        "decoding the joint state (rclpy)": lambda: deserialize_message(data, JointState),
    }
    rows = []
    for name, step in steps.items():
        times = []
        for _ in range(2000):
            begin = time.perf_counter()
            step()
            times.append(time.perf_counter() - begin)
        microseconds = 1e6 * float(np.median(times))
        rows.append([name, f"{microseconds:.1f}", "#" * max(1, round(microseconds))])
    return "The time of each step in our callback, measured separately:\n\n" + table(
        ["step", "us", "one # per us"], rows
    )


def draw(runs: dict[tuple[str, float], list[Run]], picture: Path) -> None:
    """Draw the distribution of latencies of each node at each rate."""
    from matplotlib.figure import Figure

    from linkage_vibration.drawing.palette import COLOURS, INK

    figure = Figure(figsize=(9.6, 4.0), layout="constrained")
    axes = figure.subplots(1, len(SECONDS), sharey=True)
    for ax, rate in zip(axes, SECONDS, strict=True):
        for name, colour in zip(NODES, (INK, *COLOURS), strict=False):
            values = np.sort(np.concatenate([1e3 * r.latencies for r in runs[name, rate]]))
            above = 1.0 - np.arange(len(values)) / len(values)
            ax.loglog(values, above, color=colour, lw=1.5, label=name)
        ax.set(xlabel="latency [ms]", title=f"{rate:g} Hz")
        ax.grid(color="#dddddd", linewidth=0.6)
    axes[0].set(ylabel="share of messages that take longer")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main()
