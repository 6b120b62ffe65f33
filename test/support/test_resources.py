# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages name commands that work where the package is installed."""

from pathlib import Path

import pytest

from linkage_vibration.support.resources import command
from linkage_vibration.table.table import TableError, load_table


def program(path: Path) -> Path:
    """Make an executable file."""
    path.parent.mkdir(parents=True)
    path.touch(0o755)
    return path


def test_colcon_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Colcon puts programs below lib, which is not on PATH; pip puts them on PATH."""
    program(tmp_path / "install" / "lib" / "linkage_vibration" / "linkage-vibration")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/opt/ros/jazzy:{tmp_path / 'install'}")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    assert command("recover a") == "ros2 run linkage_vibration linkage-vibration recover a"
    with pytest.raises(TableError, match="`ros2 run linkage_vibration linkage-vibration build`"):
        load_table(tmp_path / "none.npz")
    program(tmp_path / "bin" / "linkage-vibration")
    assert command("recover a") == "linkage-vibration recover a"


def test_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the program is in neither place, its name is said."""
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setenv("PATH", "")
    assert command("--help", "linkage_vibration_node") == "linkage_vibration_node --help"
