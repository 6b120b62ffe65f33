# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""No command writes over its inputs or a device, leaves files behind, or hides a problem."""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

import linkage_vibration
from linkage_vibration.bags.recovery import recover
from linkage_vibration.cli.main import SUBCOMMANDS, argument_parser, main
from linkage_vibration.playback.replay import replay
from linkage_vibration.support.atomic_files import OutputError, check_outputs, write_bytes
from linkage_vibration.support.exit_codes import ended_by_signals
from linkage_vibration.support.resources import config_file
from test.support.failing.runs import outcomes
from test.support.programs import require

DRIVE = config_file("drives/hitch_duty_cycle.mcap")
# Each command that writes a file, with an output that is one of its inputs.
OVERWRITES = (
    "build linkage.yaml -o linkage.yaml",
    "build linkage.yaml --plan --angle-deg 120 -o linkage.yaml",
    "measure 120:linkage.csv --mechanism linkage.yaml -o linkage.yaml",
    "listen log.mcap --sensors fit.yaml --amplitudes fit.yaml",
    "calibrate fit.yaml -o linkage.yaml",
    "calibrate drive.mcap --times 1=2 --mechanism linkage.yaml -o linkage.yaml",
    "recover log.mcap -o log.mcap",
    "replay log.mcap --params-file fit.yaml -o fit.yaml",
    "review log.mcap -o log.mcap",
    "review log.mcap --limits fit.yaml --junit fit.yaml",
    "advise 165 30 --mechanism linkage.yaml --csv linkage.yaml",
    "plot linkage.yaml -o linkage.yaml",
    "predict linkage.yaml 120 --csv linkage.yaml",
    "pose linkage.yaml -o linkage.yaml",
    "export table.npz --fmu table.npz",
)
FOLDERS = {"demo"}  # This command writes new files into a folder.


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a bag, its log, a mechanism, and a file that names the mechanism."""
    folder = tmp_path_factory.mktemp("made")
    shutil.copy(DRIVE, folder / "drive.mcap")
    replay(DRIVE, folder / "log.mcap")
    shutil.copy(config_file("three_point_linkage.yaml"), folder / "linkage.yaml")
    shutil.copy(config_file("tables/three_point_linkage.npz"), folder / "table.npz")
    (folder / "fit.yaml").write_text("mechanism: linkage.yaml\n")
    return folder


@pytest.fixture
def files(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of the folder, which is the current one."""
    folder = tmp_path / "files"
    shutil.copytree(made, folder)
    monkeypatch.chdir(folder)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    """Return the names and the contents of the files of a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_every_command_that_writes_is_tried() -> None:
    """A new command with an output needs a case here."""
    parsers: Any = next(
        action
        for action in argument_parser()._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    texts = {name: parsers.choices[name].format_help() for name in SUBCOMMANDS}
    options = "--output", "--fmu", "--csv", "--junit"
    writing = {name for name, text in texts.items() if any(option in text for option in options)}
    assert writing == {words.split()[0] for words in OVERWRITES} | FOLDERS


@pytest.mark.parametrize("command", OVERWRITES)
def test_inputs_are_never_replaced(files: Path, capsys: Any, command: str) -> None:
    """An output that is an input is refused, also one that another input names."""
    before = contents(files)
    assert main(command.split()) == 1
    assert "is an input" in (actual := capsys.readouterr().err) or "exists already" in actual
    assert contents(files) == before


@pytest.mark.parametrize(
    ("option", "link"), [("--csv", os.symlink), ("--png", os.link), ("-o", os.symlink)]
)
def test_links_to_inputs(files: Path, capsys: Any, option: str, link: Any) -> None:
    """A symbolic or a hard link to an input is refused for each output."""
    link("log.mcap", "other")
    before = contents(files)
    assert main(["review", "log.mcap", option, "other"]) == 1
    assert "other is an input (log.mcap)" in capsys.readouterr().err
    assert contents(files) == before


def test_files_of_a_bag_s_folder_are_inputs(files: Path) -> None:
    """A file in the folder of a bag is not replaced."""
    with pytest.raises(OutputError, match="is an input"):
        check_outputs([files / "new" / ".." / "log.mcap"], [files])


def test_names_in_other_files_are_no_inputs(files: Path) -> None:
    """A YAML file names inputs, and a text that looks the same does not."""
    for name in ("notes.txt", "notes.yaml"):
        (files / name).write_text("log: log.mcap")
    check_outputs([files / "log.mcap"], [files / "notes.txt"])
    with pytest.raises(OutputError, match="is an input"):
        check_outputs([files / "log.mcap"], [files / "notes.yaml"])


def test_one_name_for_two_outputs(files: Path, capsys: Any) -> None:
    """Two outputs need two names."""
    assert main(["review", "log.mcap", "-o", "x", "--csv", "x"]) == 1
    assert "x and x are one file" in capsys.readouterr().err
    assert "x" not in contents(files)


@pytest.mark.parametrize("command", [["replay", "drive.mcap"], ["review", "log.mcap"]])
def test_device_or_pipe_is_refused(files: Path, capsys: Any, command: list[str]) -> None:
    """A pipe remains a pipe; a function that writes refuses it, too."""
    os.mkfifo("pipe")
    assert main([*command, "-o", "pipe"]) == 1
    assert "pipe: is no regular file; give the name of a file." in capsys.readouterr().err
    with pytest.raises(OutputError, match="pipe: is no regular file"):
        write_bytes(files / "pipe", b"x", OutputError)
    assert (files / "pipe").is_fifo()


def test_one_room_writes_files() -> None:
    """Only these modules open files to write, so that every command ends cleanly on signals.

    The others write through `replacement`. A log grows while the node runs; a chunk log and a
    recovery are written inside of a replacement, a model and the sources of an FMU inside of a
    temporary folder. The demonstration writes into its own folder. A process that builds a table
    for the node writes its progress into a temporary folder, and so is a compressed bag unpacked.
    A pipe is opened by `os.fdopen`.
    """
    writes = re.compile(r"\.write_(text|bytes)\(|(?<!fd)open\([^)]*\"[wxa]b?\"|savefig\((?!png)")
    root = Path(linkage_vibration.__file__).parent
    actual = {
        path.relative_to(root).as_posix()
        for path in root.rglob("*.py")
        if writes.search(path.read_text())
    }
    logs = {f"bags/{name}.py" for name in ("log_writer", "reading", "recovery")}
    assert actual == logs | {
        *("demo/demo.py", "export/fmu.py", "review/log.py", "support/atomic_files.py"),
        "prediction/answers.py",
    }


def test_links_are_followed(files: Path) -> None:
    """The file behind a symbolic link is written, and the link remains."""
    (files / "there").mkdir()
    for name in ("table.csv", "new.csv"):
        (files / name).symlink_to(files / "there" / name)
    (files / "there" / "table.csv").write_text("old")
    for name in ("table.csv", "new.csv"):
        write_bytes(files / name, b"new", OutputError)
        assert (files / name).is_symlink()
        assert (files / "there" / name).read_text() == "new"
    assert len(list((files / "there").iterdir())) == 2


@pytest.mark.parametrize("options", [["-o"], ["-o", "page", "--csv"], ["-o", "page", "--png"]])
def test_folder_that_cannot_be_written(files: Path, capsys: Any, options: list[str]) -> None:
    """A folder that takes no files is an error of one sentence, also for root."""
    assert main(["review", "log.mcap", *options, "/proc/self/out"]) == 1
    assert "/proc/self/out: cannot be written" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_signals_leave_nothing_behind(files: Path, number: signal.Signals) -> None:
    """SIGTERM and SIGHUP end a command with 128 + their number, and remove temporary files."""
    before = contents(files)
    code = (
        "import signal, sys\nfrom pathlib import Path\n"
        "from linkage_vibration.support.atomic_files import OutputError, replacement\n"
        "from linkage_vibration.support.exit_codes import ended_by_signals\n"
        "with ended_by_signals(), replacement(Path('log.mcap'), OutputError) as new:\n"
        "    new.write_bytes(b'x')\n"
        "    print(new, flush=True)\n"
        "    signal.pause()\n"
    )
    # A signal that arrives while coverage.py holds its lock would block the command forever.
    own = {name: value for name, value in os.environ.items() if not name.startswith("COVERAGE")}
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        env=own,
        stdout=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),  # nohup ignores SIGHUP
    )
    assert process.stdout is not None
    assert Path(process.stdout.readline().decode().strip()).read_bytes() == b"x"
    process.send_signal(number)
    assert process.wait(timeout=30) == 128 + number
    assert contents(files) == before


def test_ignored_signal() -> None:
    """A signal that is ignored, as by nohup, remains ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_exit_codes_of_replay(files: Path, capsys: Any) -> None:
    """Without a number a replay is incomplete; one bag twice is an error."""
    assert main(["replay", "drive.mcap", "-o", "far.mcap", "--offset", "9"]) == 3
    assert "No prediction has numbers" in capsys.readouterr().err
    os.link("drive.mcap", "same.mcap")
    assert main(["replay", "drive.mcap", "same.mcap", "-o", "two.mcap"]) == 1
    assert "give each bag once" in capsys.readouterr().err
    assert not Path("two.mcap").exists()
    partly = ["replay", "drive.mcap", "-o", "partly.mcap", "--offset", "0.3"]
    assert main([*partly, "--strict"]) == 3
    assert "1061 predictions have no numbers" in capsys.readouterr().err
    assert main(["review", "partly.mcap", "--strict"]) == 3
    assert (
        main(["review", "partly.mcap", "--against", "log.mcap"]) == 1
    )  # all angles are 17 deg apart
    assert "not of one drive, or of one calibration of its angle" in capsys.readouterr().err
    assert main(["replay", "drive.mcap", "-o", "near.mcap", "--offset", "0.01"]) == 0
    assert main(["review", "near.mcap", "--against", "log.mcap"]) == 0
    assert main(["review", "near.mcap", "--against", "log.mcap", "--strict"]) == 3
    shutil.copy("log.mcap", "copy.mcap")
    assert main(["review", "copy.mcap", "--against", "log.mcap", "--strict"]) == 0


def test_exit_codes_of_recover(files: Path, capsys: Any) -> None:
    """A recovery of a damaged log succeeds, unless it is strict."""
    Path("cut.mcap").write_bytes(DRIVE.read_bytes()[:-1000])
    assert main(["recover", "cut.mcap", "-o", "a.mcap"]) == 0
    assert main(["recover", "cut.mcap", "-o", "b.mcap", "--strict"]) == 3
    assert main(["recover", "drive.mcap", "-o", "c.mcap", "--strict"]) == 0
    assert sum(recover(Path("a.mcap"), Path("d.mcap")).saved.values()) == 2400


def shell(command: str) -> "subprocess.CompletedProcess[bytes]":
    """Run a command of the shell in which $L is the program."""
    program = {"L": f"{sys.executable} -m linkage_vibration.cli"}
    return subprocess.run(
        ["bash", "-c", f"set -o pipefail; {command}"],
        env={**os.environ, **program},
        capture_output=True,
        timeout=120,
        check=False,
    )


def test_output_beside_the_logs(files: Path) -> None:
    """The list of the logs of a folder may be written into this folder."""
    for name in ("drive.mcap", "fit.yaml"):
        Path(name).unlink()
    assert shell("$L review . --json > list.json").returncode == 0
    assert Path("list.json").read_bytes().startswith(b"{")


@pytest.mark.parametrize("option", ["log", "log.mcap --params-file", "log.mcap --mechanism"])
def test_pipe_as_input(files: Path, capsys: Any, option: str) -> None:
    """A pipe without a writer is refused instead of waited for."""
    os.mkfifo("pipe.mcap")
    command = "review pipe.mcap" if option == "log" else f"replay {option} pipe.mcap -o new.mcap"
    assert main(command.split()) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert "pipe.mcap: is no regular file" in line


@pytest.mark.parametrize(
    "command",
    [
        "measure 120:pipe.csv --mechanism linkage.yaml",
        "measure 120:pipe.mcap --mechanism linkage.yaml",
        "calibrate fit.yaml -o new.yaml",
        "replay drive.mcap --params-file parameters.yaml -o new.mcap",
    ],
)
def test_pipe_that_a_word_or_a_file_names(files: Path, capsys: Any, command: str) -> None:
    """A pipe is also refused where a word or a YAML file names it."""
    for name in ("pipe.csv", "pipe.mcap", "pipe.yaml"):
        os.mkfifo(name)
    Path("fit.yaml").write_text(Path("fit.yaml").read_text().replace("linkage.yaml", "pipe.yaml"))
    parameters = {"/**": {"ros__parameters": {"mechanism_file": str(files / "pipe.yaml")}}}
    Path("parameters.yaml").write_text(yaml.safe_dump(parameters))
    assert main(command.split()) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert " is a pipe, not a file" in line


@pytest.mark.parametrize("command", ["review log.mcap --json", "export --c new"])
def test_reader_that_ends(files: Path, command: str) -> None:
    """A reader that wants no more ends a command without a word, after its files are written."""
    done = shell(f"PYTHONUNBUFFERED=1 $L {command} | true")
    assert (done.returncode in (0, 141), done.stderr) == (True, b"")
    if "export" in command:
        assert len(list(Path("new").iterdir())) == 2


@pytest.mark.parametrize(
    ("command", "buffered"), [("review log.mcap --json", "1"), ("build --help", "")]
)
def test_full_standard_output(files: Path, command: str, buffered: str) -> None:
    """Output that cannot be written is an error of one sentence, after those about the logs."""
    done = shell(f"PYTHONUNBUFFERED={buffered} $L {command} > /dev/full")
    *about, last = done.stderr.decode().splitlines()
    assert done.returncode == 1
    assert "The standard output cannot be used (No space left on device)" in last
    assert all(line.startswith("linkage-vibration: log.mcap: ") for line in about), about


def test_no_room_for_temporary_files(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    """The error of tempfile, which names no file, is not one of the standard output."""

    def refuse(arguments: object) -> int:
        raise FileNotFoundError(2, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr("linkage_vibration.cli.main._run", refuse)
    assert main([]) == 1
    start = "linkage-vibration: The temporary folder cannot be used (No usable temporary directory"
    assert capsys.readouterr().err.startswith(start)


def test_name_in_another_encoding(files: Path) -> None:
    """A name that is not UTF-8 is read, written and printed as it is."""
    name = os.fsdecode(b"m\xe9t\xe9o")
    for kind in ("drive", "log"):
        Path(f"{kind}.mcap").rename(f"{kind}_{name}.mcap")
    replayed = shell("$L replay drive_*.mcap -o new_$(printf 'm\\xe9t\\xe9o').mcap")
    assert replayed.returncode == 0, replayed.stderr
    assert replayed.stdout.startswith(b"new_m\xe9t\xe9o.mcap: 2000 predictions")
    done = shell("$L review log_*.mcap")
    assert (done.returncode, done.stderr) == (0, b"")
    assert name.encode(errors="backslashreplace") in Path(f"log_{name}.html").read_bytes()


def test_longest_name(files: Path) -> None:
    """A name of 85 characters of three bytes, the longest that there is, is written."""
    path = Path(83 * "\u6f22" + ".html")
    write_bytes(path, b"x", OutputError)
    assert path.read_bytes() == b"x"


def test_mode_is_kept(files: Path) -> None:
    """A page that only its owner may read stays so when it is written again."""
    Path("log.html").touch(mode=0o600)
    assert main(["review", "log.mcap"]) == 0
    assert Path("log.html").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("option", ["--csv", "--png"])
def test_failed_table_leaves_no_page(files: Path, capsys: Any, option: str) -> None:
    """If the table or the picture of a log cannot be written, its page is not written either."""
    assert main(["review", "log.mcap", option, "/proc/self/out"]) == 1
    assert "/proc/self/out: cannot be written" in capsys.readouterr().err
    assert "log.html" not in contents(files)
    assert [name for name in contents(files) if name.startswith(".")] == []


@pytest.mark.parametrize(
    ("command", "kind"),
    [
        ("recover", "rename"),
        pytest.param("replay", "write", marks=pytest.mark.nightly),
        pytest.param("review", "open", marks=pytest.mark.nightly),
        pytest.param("record", "write", marks=pytest.mark.nightly),
    ],
)
def test_failing_operations(command: str, kind: str) -> None:
    """Whichever operation fails, files are old or new, and a failure is one sentence."""
    require("gcc")
    ends = outcomes(command, kind)
    sound = {f"{state}, {words}" for state in ("old", "readable") for words in ("one sentence",)}
    assert ends.keys() <= sound | {"new, no word", "readable, no word"}
    assert any("no word" in outcome for outcome in ends)


@pytest.mark.parametrize("refused", ["folder", "file", ""])
def test_places_without_permission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: str
) -> None:
    """An output is refused at once if its folder or an old file there cannot be written."""
    path = tmp_path / "old.csv"
    path.write_text("")
    closed = {"folder": tmp_path, "file": path, "": None}[refused]
    monkeypatch.setattr(os, "access", lambda place, mode: Path(place) != closed)
    if refused:
        with pytest.raises(OutputError, match=r"old\.csv: cannot be written \(no permission\)"):
            check_outputs([path], [])
    else:
        check_outputs([path], [])
