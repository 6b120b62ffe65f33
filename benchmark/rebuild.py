# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Measures the latency while a table is rebuilt: ``python -m benchmark.rebuild [ROUNDS]``."""

import sys
from functools import partial
from typing import Any

import numpy as np
from rclpy.action import ActionClient
from tqdm import tqdm

from benchmark.latency.__main__ import OURS, figures
from benchmark.latency.driver import Driver, named, running
from benchmark.report import machine, publish, table
from linkage_vibration_interfaces.action import SetImplement

RATE, COUNT = 200.0, 800  # Hz, joint states in a run
ROUNDS = 10
MASSES = (600.0, 1000.0)  # kg


def main() -> None:
    """Measure with and without a rebuild in turns, and publish both."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else ROUNDS
    quiet, building = [], []
    driver = Driver()
    client: Any = ActionClient(driver.node, SetImplement, "ours/set_implement")
    with running([*OURS, *named("ours")]) as process:
        driver.meet("ours")
        for number in tqdm(range(rounds), unit="round"):
            quiet.append(driver.run("ours", process, RATE, COUNT))
            goal = SetImplement.Goal(mass=MASSES[number % 2], inertia=200.0)
            answers: list[Any] = []
            ask = partial(asked, client, goal, answers)
            building.append(driver.run("ours", process, RATE, COUNT, ask))
            if not (answers and answers[-1].done() and answers[-1].result().result.success):
                raise RuntimeError(f"the table was not built: {answers}")
    driver.close()
    rows = []
    for name, runs in {"no table is built": quiet, "a table is built": building}.items():
        own = np.array([figures([run]) for run in runs])
        spread = [f"{np.median(v):.2f} ({v.min():.2f} to {v.max():.2f})" for v in own.T[:2]]
        longest = 1e3 * max(run.latencies.max() for run in runs)
        rows.append([name, *spread, f"{longest:.1f}", f"{sum(run.lost for run in runs)}"])
    publish(
        "rebuild",
        "Latency while a table is rebuilt",
        [
            "This page compares the latency of predictions while the node builds the table of "
            f"another implement with the latency at other times. Joint states arrive at {RATE:g} "
            f"Hz, in {rounds} rounds of {COUNT / RATE:g} s in each case. A goal of "
            "`~/set_implement` at the beginning of a round makes the node build the table in "
            "another process. Values are medians over the rounds, with the lowest and the highest "
            "in brackets.",
            table(["", "median [ms]", "p99 [ms]", "longest [ms]", "lost"], rows),
        ],
        machine(),
    )


def asked(client: Any, goal: SetImplement.Goal, answers: list[Any]) -> None:
    """Send the goal, and append the future of its result once it is accepted."""
    sent = client.send_goal_async(goal)
    sent.add_done_callback(lambda done: answers.append(done.result().get_result_async()))


if __name__ == "__main__":
    main()
