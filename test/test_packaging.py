# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The installed files are those of the checkout, and the set-up reports missing tools."""

import importlib.metadata
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from importlib.metadata import entry_points
from pathlib import Path
from xml.etree import ElementTree

import pytest

import linkage_vibration
from linkage_vibration_interfaces.msg import VibrationPrediction

ROOT = Path(__file__).resolve().parents[1]
INTERFACES = ROOT / "linkage_vibration_interfaces"
SHARE = "data/share/linkage_vibration"


def files_below(folder: str) -> set[str]:
    """Return the files below a folder of the checkout, relative to its root."""
    actual = (ROOT / folder).rglob("*")
    return {p.relative_to(ROOT).as_posix() for p in actual if p.is_file() and p.suffix != ".pyc"}


def test_version_is_the_same_everywhere() -> None:
    """Both packages and the installed package agree, and ours accepts patches of its interfaces."""
    ours = ElementTree.parse(ROOT / "package.xml")
    [required] = [e for e in ours.iter("exec_depend") if e.text == INTERFACES.name]
    versions = {
        ours.findtext("version"),
        required.get("version_gte"),
        ElementTree.parse(INTERFACES / "package.xml").findtext("version"),
        importlib.metadata.version(INTERFACES.name),
        linkage_vibration.__version__,
    }
    assert len(versions) == 1
    major, minor, _ = map(int, str(ours.findtext("version")).split("."))
    assert required.get("version_lt") == f"{major}.{minor + 1}.0"
    assert required.get("version_eq") is None  # no Debian revision satisfies it


def test_every_required_wheel_is_pinned() -> None:
    """Each ROS 2 wheel that the packages require has a release for each distribution."""
    required: set[str] = set()
    for path in (ROOT / "setup.py", INTERFACES / "pyproject.toml"):
        required |= set(re.findall(r'"(ros-[a-z-]+)"', path.read_text()))
    pinned = {
        distro: set(re.findall(r"^(ros-[a-z-]+)~=[0-9.]+$", path.read_text(), re.MULTILINE))
        for distro in ("jazzy", "kilted")
        for path in [ROOT / "tools" / f"{distro}.txt"]
    }
    assert pinned["jazzy"] | pinned["kilted"] == required
    # Each distribution has some packages for building that the other does not have.
    assert pinned["kilted"] - pinned["jazzy"] == {"ros-ament-cmake-ros-core"}
    assert "ros-rclpy" in pinned["jazzy"] & pinned["kilted"]


def test_every_interface_file_is_built() -> None:
    """CMake generates code from each interface file of the package, and from no other."""
    listed = re.findall(r'^  "(\w+/\w+\.\w+)"$', (INTERFACES / "CMakeLists.txt").read_text(), re.M)
    kinds = [f"{INTERFACES.name}/{kind}" for kind in ("msg", "srv", "action")]
    assert sorted(f"{INTERFACES.name}/{file}" for file in listed) == sorted(
        file for kind in kinds for file in files_below(kind)
    )


def test_ros_finds_the_package() -> None:
    """`ros2 launch` and `ros2 run` find the launch files and the executables, however installed."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", sys.prefix).split(os.pathsep)
    marker = "share/ament_index/resource_index/packages/linkage_vibration"
    prefix = next(Path(prefix) for prefix in prefixes if Path(prefix, marker).is_file())
    share = prefix / "share" / "linkage_vibration"
    assert (share / "package.xml").read_text() == (ROOT / "package.xml").read_text()
    launch_files = {path.name for path in (share / "launch").iterdir()}
    assert launch_files == {path.name for path in (ROOT / "launch").iterdir()}
    assert os.access(prefix / "lib" / "linkage_vibration" / "linkage_vibration_node", os.X_OK)


def test_status_constants_keep_their_values() -> None:
    """Logs stay readable: a released status keeps its number."""
    assert VibrationPrediction.STATUS_OK == 0
    assert VibrationPrediction.STATUS_OUT_OF_RANGE == 1
    assert VibrationPrediction.STATUS_INVALID_ANGLE == 2


@pytest.mark.parametrize("name", ["linkage-vibration", "linkage_vibration_node"])
def test_console_script_is_installed(name: str) -> None:
    """Each command is where pip or ``ros2 run`` looks for it, and can be loaded."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    folders = [Path(p, "lib", "linkage_vibration") for p in prefixes if p]
    folders.append(Path(sysconfig.get_path("scripts")))
    assert any(os.access(folder / name, os.X_OK) for folder in folders), folders
    (entry,) = set(entry_points(group="console_scripts", name=name))
    assert callable(entry.load())


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a wheel that pip has built from the checkout."""
    pytest.importorskip("pip", reason="pip builds the wheel")
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    made = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "install", "log")
    shutil.copytree(ROOT, source, ignore=made)
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "-qq", "--no-deps", "-w", folder, source], check=True
    )
    (built,) = folder.glob("*.whl")
    return built


@pytest.mark.nightly(alone="it installs a release; the blocks of the docs run in the wheel, too")
def test_replay_in_a_fresh_environment(wheel: Path, tmp_path: Path) -> None:
    """With ``[bags]`` alone, and without ROS 2, bags can be replayed and checked."""
    subprocess.run([sys.executable, "-m", "venv", tmp_path], check=True)
    python = tmp_path / "bin" / "python"
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("AMENT", "PYTHON"))}
    install = [python, "-m", "pip", "install", "-qq", f"linkage_vibration[bags] @ {wheel.as_uri()}"]
    subprocess.run(install, check=True, env=environment)
    code = """
from pathlib import Path
from linkage_vibration.support.resources import config_file
from linkage_vibration.testing.bag_checks import check_bag
from linkage_vibration.testing.limits import Limits

drive = config_file("drives/hitch_duty_cycle.mcap")
print(check_bag(drive, Limits(load_ratio=0.33, known_share=0.0)))
"""
    check = [python, "-c", code]
    run = subprocess.run(check, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert "predictions within their limits" in run.stdout, run.stderr


def test_wheel_holds_every_file(wheel: Path) -> None:
    """A wheel has all modules, configurations, launch files and messages, and no tests."""
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    stem = "-".join(wheel.name.split("-")[:2])
    data = {n.removeprefix(f"{stem}.data/") for n in names if n.startswith(f"{stem}.data/")}
    code = {n for n in names if not n.startswith((f"{stem}.data/", f"{stem}.dist-info/"))}
    assert code == files_below("linkage_vibration")
    assert data == {
        "data/share/ament_index/resource_index/packages/linkage_vibration",
        *(f"{SHARE}/{name}" for name in ("package.xml", "LICENSE")),
        *(f"{SHARE}/{name}" for name in files_below("config") | files_below("launch")),
        *(f"{SHARE}/{name}" for name in files_below("linkage_vibration_interfaces/msg")),
        *(f"{SHARE}/{name}" for name in files_below("linkage_vibration_interfaces/srv")),
        *(f"{SHARE}/{name}" for name in files_below("linkage_vibration_interfaces/action")),
    }


def make_program(path: Path, commands: str) -> None:
    """Write a program that stands for one of the machine."""
    path.write_text(f"#!/bin/sh\n{commands}\n")
    path.chmod(0o755)


def setup_on(
    tmp_path: Path, tools: set[str], *arguments: str, **environment: str
) -> subprocess.CompletedProcess:
    """Run the set-up where only some tools are on the path and nothing else is set."""
    for tool in tools:
        where = shutil.which(tool, path="/usr/local/bin:/usr/bin:/bin")
        assert where is not None
        (tmp_path / tool).symlink_to(where)
    python = Path(sys.base_prefix, "bin", "python3")
    return subprocess.run(
        ["/bin/sh", ROOT / "tools" / "setup.sh", *arguments],
        env={"PATH": str(tmp_path), "PYTHON": str(python), **environment},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({}, r"are missing: .*g\+\+; run: .*apt-get install -y .*g\+\+"),
        ({"PYTHON": "python3"}, r"python3 was not found; run: .*apt-get install -y g\+\+ python3"),
        (
            {"AMENT_PREFIX_PATH": "/nowhere"},
            r"cannot import its rclpy; run: make PYTHON=/usr/bin/python3",
        ),
        ({"ROS_DISTRO": "humble"}, r"ROS_DISTRO=humble cannot be used; run: make ROS_DISTRO=jazzy"),
        (
            {"ROS_DISTRO": "lyrical"},
            r"no wheels of ROS 2 Lyrical yet; source an installed Lyrical \(.*\), or run: make ROS",
        ),
        ({"VERSIONS": "ubuntu-22.04"}, r"cannot be used; run: make test VERSIONS=ubuntu-24\.04"),
    ],
)
def test_setup_names_what_the_machine_lacks(
    tmp_path: Path, environment: dict[str, str], words: str
) -> None:
    """Without a compiler, Python or a sourced rclpy, one line says what to run."""
    run = setup_on(tmp_path, {"dirname", "grep", "id"}, **environment)
    assert run.returncode == 1
    assert run.stdout == ""
    (line,) = run.stderr.splitlines()
    assert re.search(words, line), line


@pytest.mark.parametrize(
    ("distro", "minor", "machine", "words"),
    [
        ("jazzy", 13, "x86_64", r"packages are missing: g\+\+"),
        (
            "kilted",
            14,
            "x86_64",
            r"is Python 3\.14 on x86_64, but .* of ROS 2 kilted are for Python",
        ),
        (
            "jazzy",
            13,
            "aarch64",
            r"3\.13 on aarch64, but .* 3\.12 and 3\.13 on x86_64; source a ROS 2",
        ),
        ("lyrical", 14, "x86_64", r"PyPI has no wheels of ROS 2 Lyrical yet"),
    ],
)
def test_setup_names_the_python_of_the_wheels(
    tmp_path: Path, distro: str, minor: int, machine: str, words: str
) -> None:
    """The files in ``tools`` say for which Python and processor a distribution has wheels."""
    facts = f"minor={minor}\\nbase=/\\nmachine={machine}\\npip=1\\nheaders=1\\nrclpy=\\n"
    make_program(tmp_path / "python", f"printf '{facts}'")
    tools = {"dirname", "grep", "id", "sed"}
    run = setup_on(tmp_path, tools, PYTHON="python", ROS_DISTRO=distro)
    (line,) = run.stderr.splitlines()
    assert re.search(words, line), line


def test_a_sourced_lyrical_is_used(tmp_path: Path) -> None:
    """Wheels are needed only where no ROS 2 is sourced: the interfaces are built for that one."""
    (tmp_path / "ros" / "rclpy").mkdir(parents=True)
    (tmp_path / "ros" / "rclpy" / "__init__.py").touch()
    make_program(tmp_path / "c++", "exit 1")
    make_program(tmp_path / "cmake", "echo $CMAKE_PREFIX_PATH $*; exit 1")
    make_program(
        tmp_path / "python",
        f'[ "$2" = venv ] && exec mkdir -p "$4/bin"; exec {sys.base_prefix}/bin/python3 "$@"',
    )
    run = setup_on(
        tmp_path,
        {"cat", "cksum", "dirname", "find", "id", "mkdir", "rm", "sort", "xargs"},
        os.path.relpath(tmp_path / "environment", ROOT),
        PYTHON="python",
        ROS_DISTRO="lyrical",
        AMENT_PREFIX_PATH="/opt/ros/lyrical",
        PYTHONPATH=str(tmp_path / "ros"),
    )
    assert f"for the sourced ROS 2 ({tmp_path / 'ros'})" in run.stdout
    (line,) = run.stderr.splitlines()
    assert "the build of linkage_vibration_interfaces failed; see " in line
    log = (tmp_path / "environment" / "interfaces.log").read_text()
    assert log.startswith("/opt/ros/lyrical: -S linkage_vibration_interfaces ")
    # Environments that are made at once do not write metadata into the same folder.
    given = {**os.environ, "DIST_EXTRA_CONFIG": str(tmp_path / "environment" / "metadata.cfg")}
    subprocess.run([sys.executable, "setup.py", "-q", "egg_info"], cwd=ROOT, env=given, check=True)
    assert (tmp_path / "environment" / "linkage_vibration.egg-info").is_dir()
