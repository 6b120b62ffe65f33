# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Runs a command once for each operation that fails, n = 1, 2, 3... until one has fewer of them.

An operation is an open, a write, an fsync or a rename; see ``failing.c``, which needs gcc. Calls
count below the folder of the command. Each run is a fork of one process that has imported
everything, so that only operations of the command itself fail.
"""

import ctypes
import faulthandler
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

import numpy as np
from mcap.reader import make_reader

from linkage_vibration.bags.recorder import Provenance, Recorder
from linkage_vibration.bags.recovery import RecoveryError, recover
from linkage_vibration.bags.writing import Topic
from linkage_vibration.cli.main import main as run_command
from linkage_vibration.support.resources import config_file

KINDS = ("open", "write", "fsync", "rename")
# It is named, so that no further line says which table is used.
TABLE = str(config_file("tables/three_point_linkage_on_tractor.npz"))
# Each command with its outputs, all of which exist before.
COMMANDS = {
    "record": ([], []),
    "replay": (["drive.mcap", "--mechanism", TABLE, "-o", "new.mcap"], ["new.mcap"]),
    "recover": (["cut.mcap", "-o", "fresh.mcap"], ["fresh.mcap"]),
    "review": (["log.mcap", "-o", "page.html", "--csv", "table.csv"], ["page.html", "table.csv"]),
    "export": (["table.npz", "--c", "code"], []),
    "build": (["linkage.yaml", "-o", "new.npz", "--tolerance", "1e-2"], ["new.npz"]),
}
OLD = b"old"
RECORDED = 200  # messages
DENSE = 40  # the number of the operation that fails grows by one up to this, then by a tenth


def outcomes(command: str, kind: str) -> Counter[str]:
    """Return how runs of a command ended, each with another operation of a kind that fails."""
    here = Path(__file__).parent
    with tempfile.TemporaryDirectory() as name:
        library = Path(name) / "failing.so"
        options = ["-shared", "-fPIC", "-O1", "-o", str(library)]
        subprocess.run(["gcc", *options, str(here / "failing.c"), "-ldl"], check=True)
        done = subprocess.run(
            [sys.executable, "-m", __name__, command, kind],
            cwd=here.parents[2],
            env={**os.environ, "LD_PRELOAD": str(library)},
            check=True,
            capture_output=True,
        )
    return Counter(json.loads(done.stdout))


def main() -> None:
    """Let the operations of a command fail one after another; print the outcomes as JSON."""
    command, kind = sys.argv[1:]
    shim = ctypes.CDLL(os.environ["LD_PRELOAD"])
    ends: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        files, folder = Path(name) / "files", Path(name) / "run"
        _prepare(files)
        _child(shim, files, folder, command, kind, 10**9)  # to import everything
        number, reached = 0, True
        while reached:
            number += max(1, number // 10 if number >= DENSE else 1)
            code, reached, error = _child(shim, files, folder, command, kind, number)
            ends[_verdict(folder, command, code, error)] += 1
    print(json.dumps(ends))


def _prepare(files: Path) -> None:
    """Write the inputs of the commands."""
    files.mkdir()
    drive = config_file("drives/hitch_duty_cycle.mcap")
    shutil.copy(drive, files / "drive.mcap")
    (files / "cut.mcap").write_bytes(drive.read_bytes()[:-1000])
    shutil.copy(config_file("three_point_linkage.yaml"), files / "linkage.yaml")
    shutil.copy(config_file("tables/three_point_linkage.npz"), files / "table.npz")
    os.chdir(files)
    with open(os.devnull, "w") as sys.stdout:
        run_command(["replay", "drive.mcap", "-o", "log.mcap"])
    sys.stdout = sys.__stdout__


def _child(
    shim: ctypes.CDLL, files: Path, folder: Path, command: str, kind: str, number: int
) -> tuple[int, bool, str]:
    """Run a command in a fork in a new folder; return its code, whether it failed, its errors."""
    os.chdir("/")
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(files, folder)
    for output in COMMANDS[command][1]:
        if command != "recover":
            (folder / output).write_bytes(OLD)
    os.chdir(folder)
    errors = folder.parent / "errors.txt"
    if (process := os.fork()) == 0:
        for stream, path in ((1, os.devnull), (2, str(errors))):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        shim.failing_arm(1 + KINDS.index(kind), ctypes.c_long(number), str(folder).encode())
        faulthandler.enable()
        code = 2
        try:
            words = [command, *COMMANDS[command][0]]
            code = _record(folder) if command == "record" else run_command(words)
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            reached = bool(shim.failing_done())
            os._exit(code | 64 * reached)
    status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    reached = status < 0 or bool(status & 64)
    return (status if status < 0 else status & 63), reached, errors.read_text()


def _record(folder: Path) -> int:
    """Record messages; return 1 with a sentence if the recorder reports an error."""
    topic = Topic("/numbers", "std_msgs/msg/Float64", "float64 data\n", "", "")
    recorder = Recorder(folder, [topic], Provenance())
    error: Exception | None = None
    try:
        recorder.start()
        for k in range(RECORDED):
            recorder.write([("/numbers", bytes(12), k, k)])
            while k == RECORDED // 2 and recorder.written <= k and recorder.error is None:
                time.sleep(1e-3)
        recorder.stop()
        error = recorder.error
    except Exception as problem:  # a LogError of start
        error = problem
    if error is not None:
        print(f"linkage-vibration: {error}", file=sys.stderr)
    return int(error is not None)


def _verdict(folder: Path, command: str, code: int, error: str) -> str:
    """Return how a run ended: "new file", "old file", or what is wrong."""
    if code < 0:
        place = [line.split("/")[-1] for line in error.splitlines() if line.startswith("  File")]
        left_files = " and ".join(sorted(_states(folder, command)))
        where = re.sub(r'", line \d+', "", place[0]) if place else "a library"
        return f"killed by signal {-code} in {where}" + (f", {left_files}" if left_files else "")
    if code not in (0, 1) or (code == 1) != bool(error):
        return f"exit code {code} with {error[:200]!r}"
    if code == 1 and (error.count("\n") != 1 or not error.startswith("linkage-vibration: ")):
        return f"not one sentence: {error.splitlines()[-1][:200]}"
    if left := [path.name for path in folder.rglob("*") if path.name.startswith(".")]:
        return f"a temporary file is left: {left[0]}"
    states = _states(folder, command)
    if "part" in states or (code == 0 and "old" in states):
        return f"{' and '.join(sorted(states))} file with exit code {code}"
    what = " and ".join(sorted(states)) or ("readable" if command == "record" else "no file")
    return f"{what}, {'one sentence' if code else 'no word'}"


def _states(folder: Path, command: str) -> set[str]:
    """Return which of "old", "new" and "part" the outputs are."""
    if command == "record":
        logs = [path for path in folder.glob("linkage_vibration_*.mcap") if not _recovers(path)]
        return {"part"} if logs else set()
    if command == "export":
        # The files of an export are new in a new folder, or not there.
        code = [*folder.glob("code/*")]
        whole = all(path.read_bytes().endswith(b"\n") for path in code)
        return (
            ({"new"} if code else set()) | ({"old"} if len(code) < 3 else set())
            if whole
            else {"part"}
        )
    return {_state(folder / name) for name in COMMANDS[command][1]}


def _state(path: Path) -> str:
    content = path.read_bytes() if path.exists() else OLD
    if content == OLD:
        return "old"
    try:
        if path.suffix == ".mcap":
            with path.open("rb") as file:
                sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
        elif path.suffix == ".npz":
            with np.load(path) as archive:
                hashlib.sha256(b"".join(archive[name].tobytes() for name in archive))
        elif path.suffix == ".html":
            assert content.rstrip().endswith(b"</html>")
        else:
            assert content.endswith(b"\n")
            assert len({line.count(b",") for line in content.split()})
    except Exception:
        return "part"
    return "new"


def _recovers(log: Path) -> bool:
    """Return whether a log can be read, or saved by a recovery."""
    if _state(log) == "new":
        return True
    try:
        recover(log, log.with_name("recovered.mcap"))
        log.with_name("recovered.mcap").unlink()
    except RecoveryError:
        return log.stat().st_size < 2**12  # nothing was in it
    return True


if __name__ == "__main__":
    main()
