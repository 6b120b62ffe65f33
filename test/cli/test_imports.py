# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""No command imports a slow library, or the reader of logs, that it does not use."""

import json
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from linkage_vibration import cli
from linkage_vibration.cli import __main__
from linkage_vibration.cli.main import SUBCOMMANDS

SLOW = ["scipy.signal", "scipy.stats", "scipy.ndimage", "matplotlib", "mcap", "rosbags", "rclpy"]
SLOW += ["scipy.interpolate", "linkage_vibration.review.log", "linkage_vibration.listening"]
LOG, BAG, LISTENING = "linkage_vibration.review.log", "mcap", "linkage_vibration.listening"
SPLINES = "scipy.interpolate"
EXPECTED = {
    "calibrate": {BAG},
    "build": {SPLINES},
    "measure": {"scipy.ndimage", SPLINES},
    "listen": {BAG, LOG, LISTENING, SPLINES},
    "recover": {BAG},
    "replay": {BAG},
    "review": {BAG, LOG},
    "demo": {BAG, LOG},
    "play": {BAG, "rclpy"},
    "node": {"rclpy"},
}
# A process is forked for each command, which executes all imports of its module, also those in
# functions. What commands have in common is imported before.
SCRIPT = """
import ast, json, os, sys
from importlib import import_module
from pathlib import Path

def imports(path):
    for node in ast.walk(ast.parse(Path(path).read_text())):
        if isinstance(node, ast.ImportFrom):
            yield compile(ast.Module([node], []), path, "exec")

def execute(name):
    for statement in imports(import_module(name).__file__):
        exec(statement, {})

slow = json.loads(sys.argv[1])
execute("linkage_vibration.cli.arguments")
for command in sys.argv[2:]:
    if os.fork():
        os.wait()
        continue
    execute("linkage_vibration." + ("ros.spinning" if command == "node" else f"cli.{command}"))
    print(json.dumps([command, [name for name in slow if name in sys.modules]]), flush=True)
    os._exit(0)
"""


@pytest.fixture(scope="module")
def imported() -> dict[str, set[str]]:
    """Return which of the slow modules each command imports."""
    arguments = [sys.executable, "-c", SCRIPT, json.dumps(SLOW), *SUBCOMMANDS, "node"]
    run = subprocess.run(arguments, capture_output=True, text=True, check=True)
    return {name: set(found) for name, found in map(json.loads, run.stdout.splitlines())}


@pytest.mark.parametrize("command", [*SUBCOMMANDS, "node"])
def test_imports_of_commands(imported: dict[str, set[str]], command: str) -> None:
    """Each command imports the slow modules that its work needs, and no other."""
    assert imported[command] == EXPECTED.get(command, set())


def test_a_prediction_reads_no_log_and_no_bag() -> None:
    """A whole run of `predict` imports no slow module and nothing of the page of a log."""
    code = "import sys; from linkage_vibration.cli.main import main; main(sys.argv[1:])\n"
    code += "print(*sys.modules)"
    command = [sys.executable, "-c", code, "predict", "90"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    *_, modules = run.stdout.splitlines()
    more = ["scipy.linalg", "scipy.optimize", "scipy.special", "linkage_vibration.review"]
    more += ["linkage_vibration.table.tabulation"]
    assert not {*SLOW, *more} & set(modules.split())
    assert "linkage_vibration.table.table" in modules.split()


def test_an_interrupt_while_modules_are_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C then ends the command with the exit code of shells, 128 + SIGINT, without a word."""

    def find_spec(name: str, *_: object) -> None:
        if name == "linkage_vibration.cli.main":
            raise KeyboardInterrupt

    monkeypatch.delattr(cli, "main")
    monkeypatch.delitem(sys.modules, "linkage_vibration.cli.main")
    monkeypatch.setattr(sys, "meta_path", [SimpleNamespace(find_spec=find_spec), *sys.meta_path])
    assert __main__.main() == 128 + signal.SIGINT
