# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What many tests start from: the shipped mechanisms."""

import gc
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import settings

from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import config_file
from test.support.programs import missing_programs

# Times say nothing on a machine that others share. Each run tries other examples.
settings.register_profile("few", deadline=None, max_examples=25)
settings.load_profile("few")

collect_ignore = ["ros/launched_node.py"]  # launch_test runs it, which ros/test_launch.py calls


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makemodule(module_path: Path, parent: Any) -> pytest.Module | None:
    """Collect a test module as pytest does, where ROS 2 has installed launch_testing.

    launch_testing imports each module too early: one that skips itself, because a library is
    missing, would skip all tests.
    """
    if module_path.name == "__init__.py":
        return None
    return pytest.Module.from_parent(parent, path=module_path)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Keep the collector of garbage off the thousands of tests, which all stay until the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


COLLECTED = pytest.StashKey[list[pytest.Item]]()
"""All tests of the modules of this run, also those of the nightly set, which may not run."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep what was collected, before options choose from it."""
    config.stash[COLLECTED] = list(items)


def pytest_configure(config: pytest.Config) -> None:
    """Let the tests keep what programs cache beside what pytest does, not in the user's home."""
    os.environ["XDG_CACHE_HOME"] = str(config.rootpath / ".pytest_cache" / "programs")


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Name the programs that would enable more tests."""
    skipped = terminalreporter.stats.get("skipped", [])
    if line := missing_programs(str(report.longrepr) for report in skipped):
        terminalreporter.write_line(line)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Mount a disk of 4 MiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(folder)]
    try:
        subprocess.run(mount, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("no small disk: mounting a tmpfs is not allowed here")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.fixture(scope="session")
def mechanism_file() -> Path:
    """Return the path of the paper's linkage."""
    return config_file("three_point_linkage.yaml")


@pytest.fixture(scope="session")
def mechanism(mechanism_file: Path) -> Mechanism:
    """Return the paper's linkage."""
    return read_mechanism(mechanism_file)


@pytest.fixture(scope="session")
def printed() -> Mechanism:
    """Return the linkage with the upper link as the paper's table prints it."""
    return read_mechanism(config_file("three_point_linkage_as_printed.yaml"))


@pytest.fixture(scope="session")
def model(mechanism: Mechanism) -> LinkageModel:
    """Return the paper's linkage, ready to be solved."""
    return LinkageModel(mechanism)


@pytest.fixture
def mapping(mechanism_file: Path) -> Any:
    """Return the paper's linkage as a mapping that a test may spoil."""
    return yaml.safe_load(mechanism_file.read_text())
