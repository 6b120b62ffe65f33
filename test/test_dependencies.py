# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every library that is imported is declared in setup.py and package.xml, and is public."""

import ast
import importlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import setuptools  # type: ignore[import-untyped]

from linkage_vibration.support.version import OLDEST

ROOT = Path(__file__).parents[1]
OURS = {"linkage_vibration", "benchmark", "linkages", "test", "tools"}

# Imported name: distribution, and the key of package.xml where rosdep has one.
DISTRIBUTIONS = {
    "bloom": ("bloom", None),
    "can": ("python-can", None),
    "cantools": ("cantools", None),
    "catkin_pkg": ("bloom", None),  # needs it
    "coverage": ("coverage", None),
    "distributed": ("distributed", None),
    "exudyn": ("exudyn", None),
    "fmpy": ("fmpy", None),
    "gmsh": ("gmsh", None),
    "hypothesis": ("hypothesis", "python3-hypothesis"),
    "launch": (None, "launch"),  # comes with ROS 2 alone
    "launch_ros": (None, "launch_ros"),
    "launch_testing": (None, "launch_testing"),
    "linkage_vibration_interfaces": (
        "linkage_vibration_interfaces",
        "linkage_vibration_interfaces",
    ),
    "lz4": ("lz4", "mcap-ros2-support"),  # needs mcap, which needs lz4 and zstandard
    "matplotlib": ("matplotlib", "python3-matplotlib"),
    "mcap": ("mcap", "mcap-ros2-support"),
    "mcap_ros2": ("mcap-ros2-support", "mcap-ros2-support"),
    "meshio": ("meshio", None),
    "numpy": ("numpy", "python3-numpy"),
    "packaging": ("packaging", "python3-packaging"),
    "pyfbs": ("pyfbs", None),
    "pyoma2": ("pyoma-2", None),
    "pytest": ("pytest", "python3-pytest"),
    "pyuff": ("pyuff", None),
    "rclpy": ("ros-rclpy", "rclpy"),
    "replay_testing": (None, "replay_testing"),  # comes with ROS 2 alone
    "rerun": ("rerun-sdk", None),
    "rosbags": ("rosbags", "python3-rosbags-pip"),
    "scipy": ("scipy", "python3-scipy"),
    "sdynpy": ("sdynpy", None),
    "setuptools": (None, None),  # comes with pip and with colcon
    "skfem": ("scikit-fem", None),
    "tqdm": ("tqdm", "python3-tqdm"),
    "pandas": ("pandas", None),
    "xarray": ("xarray", None),
    "yaml": ("pyyaml", "python3-yaml"),
    "zstandard": ("zstandard", "mcap-ros2-support"),
}
for name in [
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "lifecycle_msgs",
    "rcl_interfaces",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
]:
    DISTRIBUTIONS[name] = (f"ros-{name.replace('_', '-')}", name)

# What a folder needs when it is used: lists of setup.py, and whether package.xml installs it.
USER = {"bags", "can", "plots", "ros", "uff", "xarray"}
FOLDERS = {
    "linkage_vibration": (USER, "exec_depend"),
    "launch": (USER, "exec_depend"),
    "examples": (USER, None),
    "test": ({"ros", "test"}, "test_depend"),
    "benchmark": ({"ros", "bench", "test"}, None),
}


def imports(folder: str) -> Iterator[tuple[Path, str, list[str]]]:
    """Yield file, module and names of each import of a library below a folder."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                actual = [(node.module or "", [alias.name for alias in node.names])]
            elif isinstance(node, ast.Import):
                actual = [(alias.name, []) for alias in node.names]
            else:
                continue
            for module, names in actual:
                top = module.split(".")[0]
                if top not in OURS and top not in sys.stdlib_module_names:
                    yield path.relative_to(ROOT), module, names


@pytest.fixture(scope="module")
def entries() -> dict[str, list[str]]:
    """Return the lists of requirements of setup.py; that of install_requires has no name."""
    actual: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setuptools, "setup", lambda **options: actual.update(options))
        patch.chdir(ROOT)
        exec(
            compile((ROOT / "setup.py").read_text(), ROOT / "setup.py", "exec"),
            {"__file__": str(ROOT / "setup.py")},
        )
    return {"": actual["install_requires"], **actual["extras_require"]}


@pytest.fixture(scope="module")
def declared(entries: dict[str, list[str]]) -> dict[str, set[str]]:
    """Return the distributions of each list of setup.py."""
    return {
        name: {re.split(r"[^\w-]", entry)[0].lower() for entry in each}
        for name, each in entries.items()
    }


def test_oldest_versions_are_tested(entries: dict[str, list[str]]) -> None:
    """The limits of setup.py are those of package.xml, of start-up, and of one run of the tests.

    mcap alone has no release between the limit and the newest one.
    """
    needed = {entry: entry.partition(">=") for each in entries.values() for entry in each}
    limits = {name.lower(): version for name, _, version in needed.values() if version}
    assert limits.items() >= {name.lower(): version for name, version in OLDEST.items()}.items()
    text = (ROOT / "tools" / "ubuntu-24.04.txt").read_text()
    pinned = dict(re.findall(r"^([\w-]+)==([\d.]+)(?:; python_version <.*)?$", text, re.MULTILINE))
    tested = {name.lower(): version for name, version in pinned.items()}
    # Later releases of FMPy need NumPy 2, and those of pyparsing a later Matplotlib.
    del tested["fmpy"], tested["pyparsing"]
    assert tested.keys() == {*map(str.lower, OLDEST), "hypothesis", "pytest"} - {"mcap"}
    assert tested.items() <= limits.items()
    not_limits = {"mcap-ros2-support", "linkage_vibration_interfaces"}
    keys = {key: name for name, key in DISTRIBUTIONS.values() if key and name != "mcap"}
    for element in ElementTree.parse(ROOT / "package.xml").iter("exec_depend"):
        limit = limits.get(keys.get(element.text, ""))
        assert element.get("version_gte") == limit or element.text in not_limits


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_import_is_declared(folder: str, declared: dict[str, set[str]]) -> None:
    """A fresh environment with the right extras, or rosdep, has everything that is imported."""
    extras, tag = FOLDERS[folder]
    available = set.union(declared[""], *(declared[extra] for extra in extras))
    package = ElementTree.parse(ROOT / "package.xml")
    keys = {
        element.text for kind in {"exec_depend", tag} - {None} for element in package.iter(kind)
    }
    for path, module, _ in imports(folder):
        if path.stem == "pytest_plugin":  # pytest itself loads it
            continue
        distribution, key = DISTRIBUTIONS.get(module.split(".")[0], (module, module))
        assert distribution in available | {None}, f"{path} imports {module}"
        if tag is not None:
            assert key in keys | {None}, f"{path} imports {module}"


@pytest.mark.parametrize("folder", ["linkage_vibration", "launch"])
def test_only_public_names_are_imported(folder: str) -> None:
    """Names with an underscore, or that their module does not list, change without a notice."""
    for path, module, names in imports(folder):
        assert not any(part.startswith("_") for part in [*module.split("."), *names]), path
        if module.startswith("rosbags"):
            assert module.count(".") == 1, f"{path} imports {module}; only packages are documented"
        if module.startswith(("rosbags", "mcap")):
            public = getattr(importlib.import_module(module), "__all__", names)
            assert set(names) <= set(public), f"{path} imports {names} of {module}"


@pytest.mark.nightly(alone="it installs old releases")
@pytest.mark.parametrize("version", ["0.11.0", "0.11.5"])
def test_bags_are_read_with_the_oldest_rosbags(tmp_path: Path, version: str) -> None:
    """The tests of bags pass with the first release that setup.py allows; pip downloads it."""
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", str(tmp_path)]
    subprocess.run([*pip, f"rosbags=={version}"], check=True)
    path = os.pathsep.join([str(tmp_path), str(ROOT), os.environ.get("PYTHONPATH", "")])
    run = [sys.executable, "-m", "pytest", "-q", "test/bags", "-k", "reading or streams"]
    subprocess.run(run, cwd=ROOT, env={**os.environ, "PYTHONPATH": path}, check=True)
