# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares two versions of this package: ``python -m benchmark.two_trees OLD_TREE [NAME ...]``.

Each job is a command line that runs in a folder of its own with the code of each tree. Exit codes
and printed text must be equal, apart from times and paths; tables, logs and CSV files must hold
equal numbers. A rearrangement of the code must not change any of them.
"""

import csv
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.reader import make_reader
from tqdm import tqdm

from benchmark.replay import write_mcap, write_ros1, write_ros2
from benchmark.report import machine, publish, table

NEW = Path(__file__).parents[1]
MECHANISMS = (
    "three_point_linkage_on_tractor",
    "three_point_linkage",
    "three_point_linkage_as_printed",
    "four_bar",
    "stephenson_six_bar",
)
LIMIT = 1e-12  # relative difference of numbers in tables
# What may differ in printed text: durations, sizes, names of tables, and folders.
VARIABLE = re.compile(
    r"\b[0-9a-f]{16}\b|\d+(\.\d+)? ?(s|ms|us|MB|kB|it/s)\b|/[\w./-]*/|\x1b\[[0-9;]*m"
)
RATE = "resonance_rate"  # a parameter that only newer trees have


@dataclass(frozen=True)
class Job:
    """A command line, and commands that prepare its inputs in the same folder."""

    name: str
    arguments: tuple[str, ...]
    before: tuple[tuple[str, ...], ...] = ()


def jobs() -> Iterator[Job]:
    """Yield all jobs; their inputs are in the folder in which they run."""
    for name in MECHANISMS:
        file, angles = f"{name}.yaml", ["95", "110.5", "130", "152", "171", "179"]
        yield Job(f"build {name}", ("build", file, "-o", "t.npz"))
        yield Job(f"build {name} 1e-4", ("build", file, "-o", "t.npz", "--tolerance", "1e-4"))
        yield Job(f"pose {name}", ("pose", file))
        if name.startswith("three") and "printed" not in name:
            yield Job(f"predict {name}", ("predict", *angles, "--mechanism", file))
            shares = ("--shares", "--angle-stddev-deg", "0.2")
            yield Job(f"shares {name}", ("predict", *angles, *shares, "--mechanism", file))
    for name, bag in {"drive": "drive.mcap", "speeds": "speeds.mcap", "ros2": "ros2"}.items():
        for excitations in ("plain", "amplitudes", "calibrated"):
            yield from _replays(f"{name} {excitations}", bag, f"{excitations}.yaml")
    for name, bag in {"ros1": "ros1.bag", "foreign": "foreign.bag", "can": "can.log"}.items():
        yield from _replays(name, bag, "can.yaml" if name == "can" else "plain.yaml")
    yield from _variants()
    yield from _refusals()
    for options in ((), ("--excitations", "on_tractor.yaml")):
        yield Job(f"export {' '.join(options)}", ("export", "--c", "c", *options))
    replayed = ("replay", "drive.mcap", "-o", "a.mcap", "--params-file", "plain.yaml")
    heavier = (*replayed[:3], "b.mcap", *replayed[4:], "--implement-mass", "1200")
    yield Job("diff", ("diff", "a.mcap", "b.mcap"), (replayed, heavier))
    yield Job("diff of one", ("diff", "a.mcap", "a.mcap"), (replayed,))
    for damage in ("cut", "hole", "zeros"):
        yield Job(f"recover {damage}", ("recover", f"{damage}.mcap", "-o", "r.mcap"))
    yield Job("calibrate", ("calibrate", "calibration.yaml", "-o", "c.yaml", "--starts", "2"))
    readings = ("0.12=-1.8", "0.35=-16.3", "0.62=-32.5", "0.88=-47.0", "1.15=-63.9", "1.42=-78.4")
    yield Job("inclinometer", ("inclinometer", "--readings", *readings))


def _replays(name: str, bag: str, parameters: str) -> Iterator[Job]:
    """Yield a replay, and what is made of its log."""
    replay = ("replay", bag, "-o", "log.mcap", "--params-file", parameters)
    yield Job(f"replay {name}", replay)
    yield Job(f"summary {name}", ("summary", "log.mcap"), (replay,))
    yield Job(f"csv {name}", ("review", "log.mcap", "-o", "p.html", "--csv", "l.csv"), (replay,))


def _variants() -> Iterator[Job]:
    """Yield predictions and tables of random changes of the numbers of the shipped mechanisms."""
    for number in range(40):
        file = f"variant_{number}.yaml"
        yield Job(f"build {file}", ("build", file, "-o", "t.npz", "--tolerance", "1e-4"))
        yield Job(f"pose {file}", ("pose", file, "--at", "120"))


def _refusals() -> Iterator[Job]:
    """Yield jobs whose inputs are wrong, and are refused with the same sentence."""
    for number in range(40):
        yield Job(f"refused {number}", ("build", f"wrong_{number}.yaml", "-o", "t.npz"))
    for words in (
        ("predict", "abc"),
        ("predict", "20"),
        ("predict", "100", "--mechanism", "missing.yaml"),
        ("replay", "missing.mcap", "-o", "x.mcap"),
        ("replay", "drive.mcap", "-o", "drive.mcap"),
        ("replay", "drive.mcap", "-o", "x.mcap", "--joint", "no_such_joint"),
        ("replay", "drive.mcap", "-o", "x.mcap", "--params-file", "four_bar.yaml"),
        ("review", "drive.mcap"),
        ("review", "four_bar.yaml"),
        ("diff", "drive.mcap", "drive.mcap"),
        ("export",),
        ("export", "four_bar.yaml", "--c", "c"),
        ("recover", "four_bar.yaml"),
        ("calibrate", "four_bar.yaml"),
        ("measure", "100:four_bar.yaml"),
        ("inclinometer", "--times", "1=2"),
        ("build", "four_bar.yaml", "-o", "t.npz", "--tolerance", "1e-40"),
        ("unknown",),
        (),
    ):
        yield Job(f"refused {' '.join(words)}", words)


def prepare(folder: Path) -> None:
    """Write the inputs of all jobs."""
    from test.support.can_bus import BusFrame, identifier, synthetic_hitch, write_candump

    for name in MECHANISMS:
        shutil.copy(NEW / "config" / f"{name}.yaml", folder)
    shutil.copy(NEW / "config/drives/hitch_duty_cycle.mcap", folder / "drive.mcap")
    shutil.copy(NEW / "config/excitations.yaml", folder / "on_tractor.yaml")
    mapping = yaml.safe_load((NEW / "config/calibrations/paper.yaml").read_text())
    mapping["mechanism"] = Path(mapping["mechanism"]).name
    (folder / "calibration.yaml").write_text(yaml.safe_dump(mapping))
    write_mcap(folder / "speeds.mcap", 20, speeds=True)
    write_ros2(folder / "ros2", 10)
    write_ros1(folder / "ros1.bag", 10)
    foreign = NEW.parent / "shared/data/fake_joint_state.bag"
    if foreign.is_file():
        shutil.copy(foreign, folder / "foreign.bag")
    times = [1_700_000_000 * 10**9 + 10**8 * i for i in range(300)]
    frames = synthetic_hitch(times, [round(125 + 100 * np.sin(0.1 * i)) for i in range(300)])
    engine = [8 * (1500 + i) for i in range(300)]
    frames += [
        BusFrame(time, identifier(61444), bytes(3) + value.to_bytes(2, "little") + bytes(3))
        for time, value in zip(times, engine, strict=True)
    ]
    write_candump(folder / "can.log", frames)
    _write_changed(folder)
    content = (folder / "drive.mcap").read_bytes()
    third = len(content) // 3
    (folder / "cut.mcap").write_bytes(content[: 2 * third])
    (folder / "hole.mcap").write_bytes(content[:third] + content[third + 5000 :])
    (folder / "zeros.mcap").write_bytes(content[:third] + bytes(5000) + content[third + 5000 :])


def _write_changed(folder: Path) -> None:
    """Write mechanisms with other numbers, and with wrong ones."""
    random = np.random.default_rng(1)
    for number in range(40):
        for kind in ("variant", "wrong"):
            source = folder / f"{MECHANISMS[number % len(MECHANISMS)]}.yaml"
            mapping = yaml.safe_load(source.read_text())
            places = list(_numbers(mapping))
            if kind == "variant":
                for parent, key in places:
                    if key in ("mass", "density", "youngs_modulus", "height", "width", "inertia"):
                        parent[key] = float(parent[key]) * float(random.uniform(0.8, 1.25))
            else:
                parent, key = places[random.integers(len(places))]
                parent[key] = [-1.0, "abc", None, [1.0], float("nan")][number % 5]
            (folder / f"{kind}_{number}.yaml").write_text(yaml.safe_dump(mapping, sort_keys=False))


def _numbers(tree: Any) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield the mapping and the key of each number in a YAML file."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                yield tree, key
            yield from _numbers(value)


def write_parameters(folder: Path, tree: Path) -> None:
    """Write the parameters of the node; resonances are assessed for each reading."""
    name = "hitch_rockshaft_joint"
    rate = {RATE: 0.0} if _has_rate(tree) else {}
    values: dict[str, dict[str, Any]] = {
        "plain": {"joint_name": name},
        "amplitudes": {"excitation_file": "on_tractor.yaml", "angle_stddev": 0.002},
        "calibrated": {"offset": 0.01, "scale": 0.98, "mechanism_file": "three_point_linkage.yaml"},
        "can": {"input": "can", "engine_input": "can"},
    }
    for file, parameters in values.items():
        whole = {"/**": {"ros__parameters": {**parameters, **rate}}}
        (folder / f"{file}.yaml").write_text(yaml.safe_dump(whole))


def _has_rate(tree: Path) -> bool:
    return RATE in (tree / "config/linkage_vibration.params.yaml").read_text()


def outcome(job: Job, tree: Path, inputs: Path) -> dict[str, object]:
    """Run a job with the code of a tree; return its exit code, text and numbers."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path in inputs.iterdir():
            (folder / path.name).symlink_to(path)
        write_parameters(folder, tree)
        for words in (*job.before, job.arguments):
            before = set(folder.iterdir())
            done = subprocess.run(
                [sys.executable, "-m", "linkage_vibration.cli", *words],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
                timeout=600.0,
            )
        text = VARIABLE.sub("*", (done.stdout + done.stderr).split("\r")[-1])
        result: dict[str, object] = {"exit code": done.returncode, "text": text}
        for path in sorted(set(folder.iterdir()) - before):
            result |= {f"{path.name} {key}": value for key, value in contents(path).items()}
        return result


def contents(path: Path) -> dict[str, object]:
    """Return what a file holds, by names."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            return {name: arrays[name] for name in arrays.files if name != "table_id"}
    if path.suffix == ".mcap":
        with path.open("rb") as file:
            messages = make_reader(file).iter_messages()
            return {
                f"{channel.topic} {message.log_time} {number}": message.data
                for number, (_, channel, message) in enumerate(messages)
            }
    if path.suffix == ".csv":
        lines = path.read_text().splitlines()
        return {f"row {number}": row for number, row in enumerate(csv.reader(lines))}
    if path.suffix == ".json":
        return dict(json.loads(path.read_text()))
    if path.is_dir():
        return {file.name: file.read_bytes() for file in path.iterdir()}
    return {} if path.suffix in (".html", ".nc") else {"bytes": path.read_bytes()}


def difference(old: dict[str, object], new: dict[str, object]) -> str:
    """Return what differs between two outcomes first; empty if they are equal."""
    if old.keys() != new.keys():
        names = sorted(old.keys() ^ new.keys())
        return f"{len(names)} only in one of them, such as {names[0]}"
    for name, value in old.items():
        other = new[name]
        if isinstance(value, np.ndarray) and isinstance(other, np.ndarray):
            if not _equal(value, other):
                return name
        elif value != other:
            return f"{name}: {str(value)[:300]!r} is now {str(other)[:300]!r}"
    return ""


def _equal(old: np.ndarray, new: np.ndarray) -> bool:
    if old.shape != new.shape or old.dtype != new.dtype:
        return False
    if old.dtype.kind != "f":
        return bool(np.array_equal(old, new))
    return bool(np.allclose(old, new, rtol=LIMIT, atol=0.0, equal_nan=True))


def main() -> None:
    """Run all jobs, or those whose names contain a word, and publish what differs."""
    old, words = Path(sys.argv[1]).resolve(), sys.argv[2:]
    chosen = [job for job in jobs() if not words or any(word in job.name for word in words)]
    rows = []
    with tempfile.TemporaryDirectory() as name:
        inputs = Path(name)
        prepare(inputs)

        def compare(job: Job) -> str:
            return difference(outcome(job, old, inputs), outcome(job, NEW, inputs))

        with ThreadPoolExecutor(2) as pool:
            texts = list(tqdm(pool.map(compare, chosen), total=len(chosen), unit="job"))
        for job, text in zip(chosen, texts, strict=True):
            if text:
                rows.append([job.name, text.replace("|", "/").replace("\n", " ")])
    publish(
        "two_trees",
        "Two versions of the package",
        [
            "This page shows which outcomes of the command line differ between two versions of "
            "the package. Each command ran with both. Exit codes and printed text were compared, "
            "apart from times and paths, and the numbers of tables (relative difference up to "
            f"{LIMIT:g}), logs, CSV files and exports. Resonances were assessed for each reading.",
            f"{len(chosen)} commands ran, and {len(rows)} outcomes differ.",
            *([table(["command", "difference"], rows)] if rows else []),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
