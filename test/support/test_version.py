# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A library that is older than the package needs is refused in one sentence."""

import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import pytest

import linkage_vibration
from linkage_vibration.support.version import OLDEST, OldLibraryError, check_versions

SENTENCE = (
    "linkage_vibration needs numpy 1.26.4 or later, but 1.26.3 is installed; "
    "run `pip install 'numpy>=1.26.4'`."
)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder before all others in which metadata of distributions are looked for."""
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def install(folder: Path, name: str, version: str, file: str = "dist-info/METADATA") -> None:
    """Write the metadata of a distribution, and no module."""
    path = folder / f"{name}-{version}.{file}"
    path.parent.mkdir(exist_ok=True)
    text = (
        f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n\nVersion: 9.9 is described.\n"
    )
    path.write_text(text)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("numpy", ["1.26.3", "1.9.10", "0.30", "1.26"], ["1.26.4", "1.26.10", "2.0.0rc1", "10.0"]),
        ("matplotlib", ["3.6.2", "2.9", "3.6"], ["3.6.3", "3.6.3.post1", "3.10"]),
    ],
)
def test_both_sides_of_the_oldest_version(
    installed: Path, name: str, old: list[str], new: list[str]
) -> None:
    """A version is compared number by number; it is refused below the limit, and not at it."""
    for version in old + new:
        for each in installed.iterdir():
            (each / "METADATA").unlink()
            each.rmdir()
        install(installed, name, version)
        importlib.invalidate_caches()
        if version in old:
            with pytest.raises(OldLibraryError, match=f"{name} .* or later, but {version} is"):
                check_versions(name)
        else:
            check_versions(name)


def test_library_that_is_missing_is_left_to_the_import(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library without metadata is not refused; the import of one that is missing names it."""
    monkeypatch.setitem(OLDEST, "no-such-library", "1.0")
    check_versions("no-such-library")


def test_public_names_refuse_an_old_library(installed: Path) -> None:
    """The sentence appears where a script takes a name from the package."""
    install(installed, "numpy", "1.26.3")
    with pytest.raises(OldLibraryError) as error:
        linkage_vibration.__getattr__("Table")
    assert str(error.value) == SENTENCE


@pytest.mark.parametrize(
    ("module", "command"),
    [("linkage_vibration.ros.node", "linkage_vibration_node"), ("linkage_vibration.cli", None)],
)
def test_old_library_ends_the_commands(tmp_path: Path, module: str, command: str | None) -> None:
    """The node and the command line print the sentence and nothing else, before they import it."""
    install(tmp_path, "numpy", "1.26.3")
    code = (
        "import runpy, sys; sys.modules['numpy'] = None; sys.argv[1:] = ['predict', '90'];"
        f"runpy.run_module('{module}', run_name='__main__')"
    )
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    run = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert run.returncode == 1
    assert run.stderr == f"{command or 'linkage-vibration'}: {SENTENCE}\n"
