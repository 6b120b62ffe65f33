# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares the latency of nodes: ``python -m benchmark.latency [TURNS]``; 18 turns take 6 minutes.

The nodes are two plain rclpy nodes that echo, and ours with and without recording. All run all the
time and take short turns, so that the load of the machine affects them equally. In every other turn
two processes keep two cores busy. The result is a page for each ROS 2 distribution.
"""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmark.latency.driver import SPEED_RATE, Driver, Run, named, running
from benchmark.paper.figures import add_legend
from benchmark.report import RESULTS, machine, publish, table
from linkage_vibration.support.resources import config_file

TURNS = 18
SECONDS = {10.0: 2.0, 100.0: 1.0, 1000.0: 1.0}  # length of a turn by rate in Hz
RESAMPLED = 1000
MACHINES = {"quiet": 0, "busy": 2}  # processes that compute without a pause
TARGETS = np.array([1.1, math.nan, 1.5])  # of the ratios: median, none, processor time

ECHO = ["-m", "benchmark.latency.echo"]
OURS = ["-m", "linkage_vibration.ros.node"]
# Those whose names contain "speeds" receive the speeds of engine, PTO and ground.
COMMANDS = {
    "echo": [*ECHO, "events"],
    "echo, speeds": [*ECHO, "events", "speeds"],
    "echo, single-threaded": [*ECHO, "single-threaded"],
    "ours, no speed": OURS,
    "ours, speeds": OURS,
    "ours, speeds, recording": OURS,
}


def parameters(name: str) -> list[str]:
    """Return the parameters of a node, for its command line."""
    return ["-p", "record:=true"] if "recording" in name else []


def ros_name(name: str) -> str:
    """Return the name of a node in ROS."""
    return name.translate({ord(" "): "_", ord("-"): "_", ord(","): None})


NODES = {
    name: [*command, *named(ros_name(name), *parameters(name))]
    for name, command in COMMANDS.items()
}
FLOODED = "ours, no speed"
Runs = dict[tuple[str, str, float], list[Run]]


def main() -> None:
    """Measure all nodes, and publish their figures and the ratios to the echoes."""
    turns = int(sys.argv[1]) if len(sys.argv) > 1 else TURNS
    load = os.getloadavg()[0]  # of other processes
    runs: Runs = {(n, m, r): [] for m in MACHINES for r in SECONDS for n in NODES}
    driver = Driver()
    with ExitStack() as stack:
        processes = {}
        for name, command in NODES.items():
            processes[name] = stack.enter_context(running(command))
            driver.meet(ros_name(name), speeds="speeds" in name)
        for turn in tqdm(range(turns), unit="turn"):
            kind = list(MACHINES)[turn % 2]
            with busy(MACHINES[kind]):
                for rate in SECONDS:
                    for name in rotated(list(NODES), turn // 2):
                        count = round(rate * SECONDS[rate])
                        run = driver.run(ros_name(name), processes[name], rate, count)
                        runs[name, kind, rate].append(run)
        flooded = floods(driver, {name: processes[name] for name in ("echo", FLOODED)}, turns // 2)
    driver.close()
    distro = {"7": "jazzy", "9": "kilted", "10": "lyrical"}[version("rclpy").split(".")[0]]
    draw(runs, RESULTS / f"latency_{distro}.png")
    publish(
        "latency",
        f"Latency of the node and of an echo on ROS 2 {distro.capitalize()}",
        [
            "This page compares the latency of our node with that of a plain rclpy node that "
            "echoes each joint state. Our node has its default linkage, on a tractor. It runs "
            f"without a speed; with the speeds of engine, PTO and ground at {SPEED_RATE:g} Hz each "
            "(10 Hz beside joint states at 10 Hz); and with recording as well.",
            "Joint states and predictions pass over DDS between processes, in "
            f"{turns // 2} turns of each node at each rate on a quiet machine (see its load "
            "average below), and in as many while two other processes keep two cores busy. The "
            "latency is the time from just before the driver publishes a joint state until it "
            "takes the prediction. The brackets contain 90 % of the ratios when turns are "
            "resampled (bootstrap).",
            "The echo runs on the events executor of rclpy, as our readings do, and receives no "
            f"speed. The targets of the ratios to it are {TARGETS[0]:g} for the median and "
            f"{TARGETS[2]:g} for the processor time, at 100 Hz and 1 kHz on a quiet machine; "
            "nothing may be lost. The last column names what exceeds them. A second echo receives "
            "the speeds, too, without using them. A third uses the single-threaded executor, which "
            "is rclpy's default.",
            table(COLUMNS, rows(runs)),
            "While two clients flood three of the services of our node, the target of the 99th "
            "percentile of its 1000 readings a second is 10 ms. The flooded node and the echo, "
            "which has no services, take turns, so the figures of the echo show what the clients "
            "cost any process on this machine:",
            table(["node", "our services", "median [ms]", "p99 [ms]", "CPU [%]", "lost"], flooded),
            parts(),
            f"![](latency_{distro}.png)",
        ],
        machine(f"rclpy {version('rclpy')}", f"load average {load:.1f} at the start"),
        f"latency_{distro}",
    )


@contextmanager
def busy(n: int) -> Iterator[None]:
    """Keep ``n`` cores busy."""
    program = [sys.executable, "-c", "while True: pass"]
    others = [subprocess.Popen(program) for _ in range(n)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def floods(driver: Driver, processes: dict[str, int], turns: int) -> list[list[str]]:
    """Return the rows of the table of nodes at 1 kHz, while no or two clients flood ours."""
    lines = []
    for kind, n in {"idle": 0, "flooded": 2}.items():
        with ExitStack() as stack:
            for _ in range(n):
                flood = ["-m", "benchmark.latency.flood", f"/{ros_name(FLOODED)}"]
                stack.enter_context(running(flood, signal.SIGKILL))
            time.sleep(5.0)
            runs: dict[str, list[Run]] = {name: [] for name in processes}
            for _ in range(turns):
                for name, process in processes.items():
                    runs[name].append(driver.run(ros_name(name), process, 1000.0, 1000))
        lines += [[name, kind, *texts(own)] for name, own in runs.items()]
    return lines


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


def ratios(own: Sequence[Run], echo: Sequence[Run]) -> tuple[NDArray[np.float64], list[str]]:
    """Return the ratios of the figures, (3,), and their texts with bootstrap intervals."""
    random = np.random.default_rng(1)
    result = []
    for _ in range(RESAMPLED):
        sample = random.integers(len(own), size=len(own))
        result.append(figures([own[i] for i in sample]) / figures([echo[i] for i in sample]))
    low, high = np.percentile(result, [5.0, 95.0], axis=0)
    middle = figures(own) / figures(echo)
    triples = zip(middle, low, high, strict=True)
    return middle, [f"{m:.2f} ({a:.2f} to {b:.2f})" for m, a, b in triples]


def texts(runs: Sequence[Run]) -> list[str]:
    """Return the median and 99th percentile (ms), the CPU (%) and the losses of runs, as texts."""
    median, high, cpu = figures(runs)
    return [f"{median:.2f}", f"{high:.2f}", f"{cpu:.1f}", f"{sum(run.lost for run in runs)}"]


COLUMNS = ["machine", "rate [Hz]", "node", "median [ms]", "p99 [ms]", "CPU [%]", "lost"]
COLUMNS += ["median / echo", "p99 / echo", "CPU / echo", "missed"]


def rows(runs: Runs) -> list[list[str]]:
    """Return the rows of the table: the figures of each node on each machine at each rate."""
    lines = []
    for (name, kind, rate), own in runs.items():
        values, ratio_texts = ratios(own, runs["echo", kind, rate])
        missed = ""
        if name.startswith("ours") and kind == "quiet" and rate > 10.0:
            beyond = [*(values > TARGETS), any(run.lost for run in own)]
            words = ("median", "p99", "CPU", "lost")
            missed = ", ".join(w for w, b in zip(words, beyond, strict=True) if b) or "none"
        lines.append([kind, f"{rate:g}", name, *texts(own), *ratio_texts, missed])
    return lines


def parts() -> str:
    """Return a table of the times of the Python steps of a prediction, with bars of text."""
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import JointState

    from linkage_vibration.bags.field_reader import FieldReader
    from linkage_vibration.bags.message_types import JOINT_STATE
    from linkage_vibration.bags.schemas import schema_of_text
    from linkage_vibration.messages.definitions import message_definition
    from linkage_vibration.messages.encoding import encode_message
    from linkage_vibration.messages.topics import PREDICTION
    from linkage_vibration.prediction.health import ReadingWatch
    from linkage_vibration.prediction.motion import crank_filter
    from linkage_vibration.prediction.predictor import Predictor
    from linkage_vibration.support.resources import PAPER_TABLE
    from linkage_vibration.table.table import load_table

    predictor = Predictor(load_table(config_file(PAPER_TABLE)))
    message = JointState(name=["hitch_rockshaft_joint"], position=[2.0])
    schema = schema_of_text(message_definition(JOINT_STATE), JOINT_STATE)
    reader = FieldReader(schema, JOINT_STATE, f"position[{message.name[0]}]", "velocity")
    data = serialize_message(message)
    prediction = predictor.predict(2.0)
    motion, watch, stamps = crank_filter(), ReadingWatch(), count(10**18, 10**6)

    def keep() -> None:
        stamp = next(stamps)
        watch.take(1e-9 * stamp, stamp, stamp, 2.0, math.nan, known=True)

    steps: dict[str, Callable[[], object]] = {
        "table lookup": lambda: predictor.table.interpolate(2.0),
        "prediction, lookup included": lambda: predictor.predict(2.0),
        "encoding the prediction": lambda: encode_message(PREDICTION, prediction, 0, 0, ""),
        "noting the motion": lambda: motion.add(next(stamps), 2.0),
        "keeping it for the watch": keep,
        "decoding the joint state": lambda: reader.read_one(data),
        "decoding by rclpy, as in the echo": lambda: deserialize_message(data, JointState),
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


def draw(runs: Runs, picture: Path) -> None:
    """Draw the distribution of latencies of each node on each machine at each rate."""
    from matplotlib.figure import Figure

    from linkage_vibration.drawing.palette import COLOURS, INK

    figure = Figure(figsize=(9.6, 6.4), layout="constrained")
    axes = figure.subplots(len(MACHINES), len(SECONDS), sharey=True)
    for kind, line in zip(MACHINES, axes, strict=True):
        for ax, rate in zip(line, SECONDS, strict=True):
            for name, colour in zip(NODES, (INK, *COLOURS), strict=True):
                values = np.sort(
                    np.concatenate([1e3 * r.latencies for r in runs[name, kind, rate]])
                )
                above = 1.0 - np.arange(len(values)) / len(values)
                ax.loglog(values, above, color=colour, lw=1.5, label=name)
            ax.xaxis.set_minor_formatter("")
            ax.set(xlabel="latency [ms]", title=f"{rate:g} Hz, {kind} machine")
            ax.grid(color="#dddddd", linewidth=0.6)
        line[0].set(ylabel="share of messages that take longer")
    add_legend(figure, axes[0][0], 4)
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main()
