# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Latency, side by side: ``python -m benchmark.latency [ROUNDS]``.

A plain rclpy node that echoes, and ours, take turns at four rates, with recording off and on.
"""

import sys
import time
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmark.latency.driver import Driver, Run, running
from benchmark.report import RESULTS, machine, publish, table

RATES = (10.0, 100.0, 200.0, 1000.0)  # Hz
SECONDS = {10.0: 5.0, 100.0: 4.0, 200.0: 4.0, 1000.0: 3.0}
ROUNDS = 5

NAMED = ["--ros-args", "-r", "__node:=ours"]
OURS = ["-m", "linkage_vibration.ros.node", *NAMED]
OLDER = (  # a ROS 2 without the events executor
    "import sys; sys.modules['rclpy.experimental.events_executor'] = None;"
    "from linkage_vibration.ros.node import main; sys.exit(main())"
)
NODES = {
    "echo": (["-m", "benchmark.latency.echo", "single-threaded"], "echo/prediction"),
    "ours": (OURS, "ours/prediction"),
    "ours, recording": ([*OURS, "-p", "record:=true"], "ours/prediction"),
    "ours, single-threaded": (["-c", OLDER, *NAMED], "ours/prediction"),
    "echo, events executor": (["-m", "benchmark.latency.echo", "events"], "echo/prediction"),
    "echo, multi-threaded": (["-m", "benchmark.latency.echo", "multi-threaded"], "echo/prediction"),
}


def main() -> None:
    """Measure, and publish ratios to the echo of the same round."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS
    runs: dict[tuple[str, float], list[Run]] = {}
    driver = Driver()
    bar = tqdm(total=rounds * len(RATES) * len(NODES), unit="run")
    for number in range(rounds):
        for name in rotated(list(NODES), number):
            command, topic = NODES[name]
            with running(command) as process:
                for rate in RATES:
                    run = driver.run(topic, process, rate, round(rate * SECONDS[rate]))
                    runs.setdefault((name, rate), []).append(run)
                    bar.update()
            time.sleep(0.5)
    bar.close()
    driver.close()
    draw(runs, RESULTS / "latency.png")
    columns = ["node", "rate [Hz]", "median [ms]", "p99 [ms]", "CPU [%]", "lost"]
    columns += ["median / echo", "p99 / echo", "CPU / echo"]
    publish(
        "latency",
        "Latency, side by side",
        [
            f"Joint states to predictions over DDS between two processes, {rounds} rounds in which "
            "the nodes take turns. Latency from just before a joint state is published until its "
            "prediction is taken, in the driver; medians over rounds, ratios of a round's node to "
            "that round's echo, in brackets from the lowest to the highest. The echo is spun by "
            "rclpy's own, single-threaded executor; ours by the events executor.",
            table(columns, rows(runs)),
            parts(),
            "![](latency.png)",
        ],
        machine(),
    )


def rotated(names: list[str], by: int) -> list[str]:
    """Return names with another one first each round."""
    by %= len(names)
    return names[by:] + names[:by]


def figures(run: Run) -> tuple[float, float, float]:
    """Return median, 99th percentile (ms) and CPU (%)."""
    median, high = np.percentile(1e3 * run.latencies, [50.0, 99.0])
    return float(median), float(high), 100.0 * run.cpu


def rows(runs: dict[tuple[str, float], list[Run]]) -> list[list[str]]:
    """Lay out the figures of each node at each rate."""
    told = []
    for rate in RATES:
        echo = np.array([figures(run) for run in runs["echo", rate]])
        for name in NODES:
            own = np.array([figures(run) for run in runs[name, rate]])
            median, high, cpu = np.median(own, axis=0)
            lost = sum(run.lost for run in runs[name, rate])
            ratios = own / echo
            spread = [f"{np.median(r):.2f} ({r.min():.2f} to {r.max():.2f})" for r in ratios.T]
            row = [name, f"{rate:g}", f"{median:.2f}", f"{high:.2f}", f"{cpu:.1f}", f"{lost}"]
            told.append([*row, *(spread if name != "echo" else ["1", "1", "1"])])
    return told


def parts() -> str:
    """Time what Python does for a prediction, beside the table's own lookup, as a bar of text."""
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import JointState

    from linkage_vibration.messages import encode_prediction
    from linkage_vibration.prediction import Predictor
    from linkage_vibration.resources import DEFAULT_TABLE, config_file
    from linkage_vibration.table import load_table

    predictor = Predictor(load_table(config_file(DEFAULT_TABLE)))
    message = JointState(name=["hitch_rockshaft_joint"], position=[2.0])
    data = serialize_message(message)
    prediction = predictor.predict(2.0)
    steps = {
        "table lookup": lambda: predictor.table.interpolate(2.0),
        "prediction, lookup included": lambda: predictor.predict(2.0),
        "its bytes": lambda: encode_prediction(prediction, 0, 0, ""),
        "joint state from its bytes (rclpy)": lambda: deserialize_message(data, JointState),
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
    return "What Python costs in our callback, each step by itself:\n\n" + table(
        ["step", "us", "a mark is 1 us"], rows
    )


def draw(runs: dict[tuple[str, float], list[Run]], picture: Path) -> None:
    """Draw the distribution of latencies of each node at each rate."""
    from matplotlib.figure import Figure

    from linkage_vibration.plots import COLOURS, INK

    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    axes = figure.subplots(1, len(RATES), sharey=True)
    for ax, rate in zip(axes, RATES, strict=True):
        for name, colour in zip(NODES, (INK, *COLOURS), strict=False):
            values = np.sort(np.concatenate([1e3 * r.latencies for r in runs[name, rate]]))
            above = 1.0 - np.arange(len(values)) / len(values)
            ax.loglog(values, above, color=colour, lw=1.5, label=name)
        ax.set(xlabel="latency [ms]", title=f"{rate:g} Hz")
        ax.grid(color="#dddddd", linewidth=0.6)
    axes[0].set(ylabel="share of messages that take longer")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main()
