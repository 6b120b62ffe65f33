# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A dry run of bloom: the dependencies that it writes for Debian can be satisfied."""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import pytest

from test.support.debian_control import PIP, resolve
from test.support.programs import require

ROOT = Path(__file__).resolve().parents[1]
LICENSES = "LICENSE", "linkage_vibration/review/page/uPlot.LICENSE.txt"
UBUNTU = {
    "python3-hypothesis": "6.98.15-1",
    "python3-matplotlib": "3.6.3-1ubuntu5",
    "python3-numpy": "1:1.26.4+ds-6ubuntu1",
    "python3-packaging": "24.0-1",
    "python3-pytest": "7.4.4-1",
    "python3-pytest-timeout": "2.2.0-1",
    "python3-scipy": "1.11.4-6build1",
    "python3-tqdm": "4.66.2-2",
    "python3-yaml": "6.0.1-2build2",
}
"""Versions of packages in Ubuntu 24.04."""
INCREMENT = "-3noble.20261120.101500"
"""What the build farm appends to a version."""


def control(folder: Path) -> dict[str, str]:
    """Return the fields of the debian/control that bloom writes for a package in a folder."""
    if find_spec("bloom") is None:
        pytest.skip("bloom is not installed; it is in the extra test")
    index = folder / "index.yaml"
    index.write_text(
        "type: index\nversion: 4\ndistributions:\n  jazzy: {distribution: [jazzy.yaml], "
        "distribution_status: active, distribution_type: ros2, python_version: 3}\n"
    )
    run = [sys.executable, "-m", "test.support.debian_control", str(folder)]
    environment = {**os.environ, "ROSDISTRO_INDEX_URL": index.as_uri()}
    done = subprocess.run(run, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    text = (folder / "debian" / "control").read_text(encoding="utf-8")
    return dict(re.findall(r"^([\w-]+): *(.*)$", text, re.MULTILINE))


def dependencies(depends: str) -> list[str]:
    """Return the dependencies in a field, without those that Debian's tools find themselves."""
    return [each for each in depends.split(", ") if not each.startswith("${")]


def is_satisfied(dependency: str, versions: dict[str, str]) -> bool:
    """Return whether Ubuntu, or the build farm, has a package that meets a dependency."""
    match = re.fullmatch(r"([a-z0-9.+-]+)(?: \((<<|<=|=|>=|>>) (\S+)\))?", dependency)
    assert match is not None, dependency
    name, relation, limit = match.groups()
    if relation is None:
        return name in versions or name.startswith("ros-jazzy-")
    compare = [require("dpkg"), "--compare-versions", versions[name], relation, limit]
    return subprocess.run(compare, check=False).returncode == 0


def test_keys_that_block_a_release() -> None:
    """Rosdep installs only the keys with pip that CONTRIBUTING names; bloom refuses such keys."""
    keys = [each.text or "" for each in ElementTree.parse(ROOT / "package.xml").iter("exec_depend")]
    assert {key for key in keys if resolve(key)[1] == "pip"} == set(PIP)
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert all(f"`{key}`" in contributing for key in PIP)


def test_dependencies_can_be_satisfied(tmp_path: Path) -> None:
    """All packages of Ubuntu and of the build farm are in our ranges, and an equal version is none.

    A build farm appends a revision to a version, so that no package has the version alone. The keys
    that block a release are left out, as CONTRIBUTING says.
    """
    for name in ("CHANGELOG.rst", "setup.cfg", *LICENSES):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    text = (ROOT / "package.xml").read_text(encoding="utf-8")
    for key in PIP:
        text = re.sub(rf" *<exec_depend[^>]*>{key}</exec_depend>\n", "", text)
    [version] = re.findall("<version>(.*)</version>", text)
    (tmp_path / "package.xml").write_text(text)
    fields = control(tmp_path)
    assert fields["Package"] == "ros-jazzy-linkage-vibration"
    interfaces = "ros-jazzy-linkage-vibration-interfaces"
    versions = {**UBUNTU, interfaces: version + INCREMENT}
    depends = dependencies(fields["Depends"])
    assert [each for each in depends if not is_satisfied(each, versions)] == []
    assert not is_satisfied(f"{interfaces} (= {version})", versions)


def test_interfaces_depend_on_ros_alone(tmp_path: Path) -> None:
    """The package of the messages needs no package but those of ROS."""
    shutil.copytree(ROOT / "linkage_vibration_interfaces", tmp_path, dirs_exist_ok=True)
    fields = control(tmp_path)
    assert fields["Package"] == "ros-jazzy-linkage-vibration-interfaces"
    names = dependencies(fields["Depends"])
    assert {"ros-jazzy-std-msgs", "ros-jazzy-rosidl-default-runtime"} <= set(names)
    assert all(name.startswith("ros-jazzy-") for name in names)
