# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Times commands beside the import of what they need: ``python -m benchmark.commands``.

With ``--against PATH``, the commands of another checkout, whose environment is in its .venv, run in
turn with these. All times are of the processor, except those of a browser.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tqdm import tqdm

from benchmark.replay import write_mcap
from benchmark.report import machine, publish, table
from benchmark.review_page import write_bag
from linkage_vibration.support.resources import config_file
from test.support.browser import Browser

IMPORTS = ("-c", "import numpy, scipy.linalg, scipy.interpolate, scipy.optimize")
CLI = ("-m", "linkage_vibration.cli")
GOALS = {"predict": "1.2 times", "replay": "2.5 times", "plot": "4 s"}
REPLAY = """
import sys, time
import linkage_vibration as lv
short, bag, output = sys.argv[1:]
for path in short, bag:
    begin = time.process_time()
    lv.replay(path, output)
print(time.process_time() - begin)
"""
RATES = {100: 300, 1000: 60}  # Hz, and the seconds of a bag with it
OPENED = 3  # times that a page is opened


@dataclass(frozen=True)
class Checkout:
    """A checkout of the package with an environment and a cache of its own."""

    name: str
    python: str
    folder: Path  # for the cache and all files that commands write

    def run(self, *arguments: str) -> tuple[float, str]:
        """Run its Python; return the processor time, s, and the output."""
        environment = {**os.environ, "XDG_CACHE_HOME": str(self.folder / "cache")}
        with tempfile.TemporaryFile("w+") as output:
            process = subprocess.Popen(
                [self.python, *arguments],
                stdout=output,
                stderr=subprocess.DEVNULL,
                cwd=self.folder,
                env=environment,
            )
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            assert process.returncode == 0, (self.name, arguments)
            output.seek(0)
            return used.ru_utime + used.ru_stime, output.read()


def main() -> None:
    """Time everything, and publish the medians with their spread."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--against", type=Path, help="another checkout with a .venv")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--minutes", type=float, default=60.0, help="of the log of the page")
    options = parser.parse_args()
    before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        own = Checkout("here", sys.executable, Path(name) / "here")
        checkouts = [own]
        if options.against:
            python = options.against.resolve() / ".venv" / "bin" / "python"
            checkouts.append(Checkout("there", str(python), Path(name) / "there"))
        for each in checkouts:
            each.folder.mkdir()
        whole = time_commands(checkouts, options.turns)
        replays = time_replays(checkouts, Path(name), options.turns)
        pages = time_pages(checkouts, Path(name), options.minutes)
    columns = [f"{each.name}, {what}" for each in checkouts for what in ("times", "s")]
    names = [each.name for each in checkouts]
    load = f"{before:.1f} at the beginning and {os.getloadavg()[0]:.1f} at the end"
    there = " `there` is the checkout that was given by `--against`." if options.against else ""
    publish(
        "commands",
        "Commands",
        [
            "This page shows what commands cost, as medians with the lowest and the highest of "
            f"{options.turns} turns. The average load of the machine was {load}.{there}",
            "The first table shows the processor time of whole commands for the shipped tractor "
            "and its drive of 20 s, also in multiples of the time in which Python imports numpy, "
            "scipy.linalg, scipy.interpolate and scipy.optimize in the same turn. Levels are in "
            "the user's cache.",
            table(["command", "goal", *columns], whole),
            "The next table shows the replay without its start: the seconds of a recording that "
            "are replayed in a second of processor time, and the time with the speeds of engine, "
            "PTO and ground over that without.",
            table(["readings", *names], replays),
            f"The last table is for the page of {options.minutes:g} min at 100 Hz with all "
            f"speeds. A browser opened it {OPENED} times, and its time passed by the clock.",
            table(["page", *names], pages),
        ],
        machine("mcap", "matplotlib"),
    )


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Return the median of values, with the lowest and the highest one."""
    texts = [f"{each:.{digits}f}" for each in (statistics.median(values), min(values), max(values))]
    return f"{texts[0]} ({texts[1]} to {texts[2]})"


def commands(turn: int) -> dict[str, tuple[str, ...]]:
    """Return the arguments of each command; no turn replaces the files of another."""
    drive, log = str(config_file("drives/hitch_duty_cycle.mcap")), f"log{turn}.mcap"
    return {
        "replay": (drive, "-o", log),
        "predict": ("90", "140", "180"),
        "plot": ("-o", f"plot{turn}.png"),
        "advise": ("165", "30", "--engine-rpm", "1800"),
        "pose": ("120",),
        "review": (log, "-o", f"page{turn}.html"),
    }


def time_commands(checkouts: Sequence[Checkout], turns: int) -> list[list[str]]:
    """Return rows of the first table, after one more replay, which fills the cache."""
    busy: dict[tuple[str, str], list[float]] = {}
    multiples: dict[tuple[str, str], list[float]] = {}
    for turn in tqdm(range(turns + 1), desc="commands"):
        base, _ = checkouts[0].run(*IMPORTS)
        for command, arguments in commands(turn).items():
            if not turn and command != "replay":
                break
            for each in checkouts:
                took, _ = each.run(*CLI, command, *arguments)
                if turn:
                    busy.setdefault((command, each.name), []).append(took)
                    multiples.setdefault((command, each.name), []).append(took / base)
    return [
        [
            command,
            GOALS.get(command, ""),
            *(
                spread(values[command, each.name])
                for each in checkouts
                for values in (multiples, busy)
            ),
        ]
        for command in commands(0)
    ]


def time_replays(checkouts: Sequence[Checkout], folder: Path, turns: int) -> list[list[str]]:
    """Return rows of the second table."""
    rows = []
    short = write_mcap(folder / "short.mcap", 2, speeds=True)
    for rate, seconds in RATES.items():
        bags = [
            write_mcap(folder / f"{rate}{speeds}.mcap", seconds, speeds=speeds, rate=rate)
            for speeds in (False, True)
        ]
        took: dict[tuple[str, Path], list[float]] = {}
        for _ in tqdm(range(turns), desc=f"{rate} Hz"):
            for each in checkouts:
                for bag in bags:
                    files = str(short), str(bag), str(folder / "out.mcap")
                    used = float(each.run("-c", REPLAY, *files)[1])
                    took.setdefault((each.name, bag), []).append(used)
        plain, with_speeds = ([took[each.name, bag] for each in checkouts] for bag in bags)
        for label, values in (("without speeds", plain), ("with speeds", with_speeds)):
            factors = [spread([seconds / each for each in own], 0) for own in values]
            rows.append([f"{rate} Hz, {label}, times real time", *factors])
        pairs = zip(with_speeds, plain, strict=True)
        over = [spread([a / b for a, b in zip(*both, strict=True)], 1) for both in pairs]
        rows.append([f"{rate} Hz, with speeds over without", *over])
    return rows


def time_pages(checkouts: Sequence[Checkout], folder: Path, minutes: float) -> list[list[str]]:
    """Return rows of the last table."""
    bag, log = folder / "long_bag.mcap", folder / "long.mcap"
    write_bag(bag, minutes)
    checkouts[0].run(*CLI, "replay", str(bag), "-o", str(log))
    sizes, making, opening = (
        ["size [MB] (goal: 15)"],
        ["made in [s]"],
        ["usable after [s] (goal: 3)"],
    )
    for each in checkouts:
        page = each.folder / "long.html"
        making.append(f"{each.run(*CLI, 'review', str(log), '-o', str(page))[0]:.1f}")
        sizes.append(f"{page.stat().st_size / 1e6:.1f}")
        with Browser(1920, 1080) as browser:
            seconds = []
            for _ in range(OPENED):
                begin = time.perf_counter()
                browser.open(page)
                seconds.append(time.perf_counter() - begin)
        opening.append(spread(seconds, 1))
    return [sizes, making, opening]


if __name__ == "__main__":
    main()
