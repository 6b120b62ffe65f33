# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Plays a drive to the node over DDS, shows its predictions, and draws its log.

The node runs in a process of its own, as an integrator starts it.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import yaml

from linkage_vibration.demo.domain import reserve_domain
from linkage_vibration.drawing.live_line import LiveLine
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.playback.readings import read_numbers
from linkage_vibration.prediction.settings import Parameters, with_values
from linkage_vibration.review.log import read_log
from linkage_vibration.review.picture import plot
from linkage_vibration.support.atomic_files import make_folder
from linkage_vibration.support.resources import DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table
from linkage_vibration.testing.bag_checks import latencies

DRIVE = "drives/hitch_duty_cycle.mcap"
# The table's range is shortened by this at each end, so that rounding does not leave it.
MARGIN = 1e-9  # rad
STOP_TIMEOUT = 10.0  # s
NODE_MODULE = "linkage_vibration.ros.node"
# Both files are beside the log. The node's messages would break the live line on the terminal.
NODE_PARAMETERS, NODE_OUTPUT = "node_parameters.yaml", "node_output.txt"


class DemoError(LinkageVibrationError):
    """The demo cannot run, or its node has failed."""


def run_demo(bag: Path | None, joint: str | None, output: Path) -> int:
    """Play a drive to the node, print what it predicts, and draw its log into a folder.

    Return 0 if each joint state had one prediction. The joint's range in a bag is mapped onto the
    table's. A `DemoError` names what cannot be used, or that the node fails.
    """
    drive, followed = bag or config_file(DRIVE), joint or Parameters().joint_name
    parameters: dict[str, object] = {"joint_name": followed, "record": True}
    table = load_table(config_file(DEFAULT_TABLE))
    if bag is not None or joint is not None:
        low, high = _swing(drive, followed)
        first, last = table.alpha3_range
        scale = (last - first - 2 * MARGIN) / (high - low)
        parameters |= {"hitch_scale": scale, "hitch_offset": first + MARGIN - scale * low}
    make_folder(output, DemoError)
    parameters["log_directory"] = str(output.resolve())
    _set_environment(output)
    try:
        from linkage_vibration.ros.bag_player import play_bag
    except ImportError as error:
        raise DemoError(
            f"ROS 2 cannot be imported ({error}); source an installation, or "
            "`pip install linkage_vibration[ros] ./linkage_vibration_interfaces`."
        ) from None
    settings = with_values(Parameters(), parameters)
    logs_before = set(output.glob("*.mcap"))
    print(f"Playing {followed} of {drive} to the node on ROS domain {os.environ['ROS_DOMAIN_ID']}.")
    live = LiveLine(sys.stdout)
    with _node(parameters, output) as check, closing(live):
        play_bag(drive, settings, {}, live, check=check)
    log = max(set(output.glob("*.mcap")) - logs_before, key=lambda path: path.stat().st_mtime)
    plot(read_log(log), log.with_suffix(".png"))
    return _report(len(read_numbers([drive], settings)[1]), log)


def _set_environment(output: Path) -> None:
    """Set the variables of ROS 2 that the user has not set."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_DOMAIN_ID"] = str(reserve_domain())
    if "HOME" not in os.environ:
        # ROS 2 writes its logs below one of the two, and does not start without either.
        os.environ.setdefault("ROS_LOG_DIR", str(output.resolve()))


def _report(sent: int, log: Path) -> int:
    """Print what was played and predicted; return 1 if a joint state was not answered."""
    waits = latencies(log)
    median, late = 1e3 * np.percentile(waits, (50, 99))
    print(
        f"joint states in    {sent}\n"
        f"predictions out    {waits.size}\n"
        f"latency            median {median:.2f} ms, 99th percentile {late:.2f} ms\n"
        f"log                {log}\n"
        f"picture            {log.with_suffix('.png')}"
    )
    if sent == waits.size:
        return 0
    print(
        f"Of {sent} joint states {waits.size} were answered. The machine is too busy, or another "
        f"node is on this ROS domain; see {log.with_name(NODE_OUTPUT)}, and run the demo again.",
        file=sys.stderr,
    )
    return 1


def _swing(bag: Path, joint: str) -> tuple[float, float]:
    """Return the smallest and the largest position of a joint in a bag."""
    _, positions = read_numbers([bag], Parameters(joint_name=joint))
    # fmin and fmax ignore NaN, which broadcasters send for unknown positions.
    low, high = float(np.fmin.reduce(positions)), float(np.fmax.reduce(positions))
    if not low < high < np.inf:
        raise DemoError(
            f"Joint {joint} of {bag} does not move between two finite positions; choose another "
            "one with --joint."
        )
    return low, high


@contextmanager
def _node(parameters: dict[str, object], folder: Path) -> Iterator[Callable[[], None]]:
    """Run the node; yield a function that raises an error if the node has ended by itself."""
    settings, printed = folder / NODE_PARAMETERS, folder / NODE_OUTPUT
    try:
        settings.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}), "utf-8")
        sink = printed.open("wb")
    except OSError as error:
        raise DemoError(
            f"{folder} cannot be written to: {error.strerror}; give another folder with -o."
        ) from None
    with sink:
        process = subprocess.Popen(
            [sys.executable, "-m", NODE_MODULE, "--ros-args", "--params-file", str(settings)],
            stdin=subprocess.DEVNULL,
            stdout=sink,
            stderr=subprocess.STDOUT,
        )

    def check() -> None:
        if process.poll() is not None:
            last = "\n".join(printed.read_text("utf-8", errors="replace").splitlines()[-10:])
            raise DemoError(
                f"The node ended with exit code {process.returncode}; fix what its last messages "
                f"({printed}) name:\n{last}"
            )

    try:
        yield check
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    if process.returncode != 0:
        check()
