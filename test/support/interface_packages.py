# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Message packages of other projects, built with pip in the shape of ours, for tests over DDS.

They are kept in the folder ``build`` between runs of the tests.
"""

import ctypes
import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
INTERFACES = ROOT / "linkage_vibration_interfaces"


def built_package(name: str, messages: Mapping[str, str]) -> Path:
    """Return the prefix in which a package of messages, by their names, is installed.

    It is built once, while other workers wait.
    """
    pytest.importorskip("scikit_build_core", reason="pip builds message packages for ROS 2 wheels")
    key = hashlib.sha256(repr((name, sorted(messages.items()), sys.prefix)).encode()).hexdigest()
    prefix = ROOT / "build" / "message_packages" / f"{name}-{key[:12]}"
    prefix.parent.mkdir(parents=True, exist_ok=True)
    with (prefix.parent / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not prefix.is_dir():
            _build(name, messages, prefix)
    return prefix


def _build(name: str, messages: Mapping[str, str], prefix: Path) -> None:
    """Build a package of messages, and move it to its prefix when it is complete."""
    with tempfile.TemporaryDirectory(dir=prefix.parent) as folder:
        source, target = Path(folder) / "source", Path(folder) / "prefix"
        (source / "msg").mkdir(parents=True)
        listed = "".join(f'  "msg/{message}.msg"\n' for message in messages)
        for file in ("CMakeLists.txt", "package.xml", "pip.cmake", "pyproject.toml"):
            text = (INTERFACES / file).read_text().replace(INTERFACES.name, name)
            text = re.sub(r'(?:  "msg/.*\n)+', listed, text)
            text = re.sub(r'  "(?:srv|action)/.*\n', "", text)
            (source / file).write_text(text)
        for message, definition in messages.items():
            (source / "msg" / f"{message}.msg").write_text(definition)
        pip = [sys.executable, "-m", "pip", "install", "-qq", "--no-deps", "--no-build-isolation"]
        quick = {**os.environ, "CFLAGS": "-O0", "CXXFLAGS": "-O0"}  # to build, not to run
        subprocess.run([*pip, "--prefix", str(target), str(source)], check=True, env=quick)
        shutil.move(target, prefix)


def environment_with(environment: Mapping[str, str], prefix: Path) -> dict[str, str]:
    """Return the environment of a process that also finds the package in a prefix."""
    version = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    actual = dict(environment)
    for variable, folder in (
        ("AMENT_PREFIX_PATH", prefix),
        ("LD_LIBRARY_PATH", prefix / "lib"),
        ("PYTHONPATH", prefix / "lib" / version / "site-packages"),
    ):
        actual[variable] = os.pathsep.join(filter(None, [str(folder), actual.get(variable)]))
    return actual


def import_here(prefix: Path) -> None:
    """Let this process import the package that is installed in a prefix."""
    [site] = prefix.glob("lib/python*/site-packages")
    sys.path.append(str(site))
    left = sorted((prefix / "lib").glob("lib*.so"))
    while left:  # each needs others, in an order that is not known
        failed = []
        for path in left:
            try:
                ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
            except OSError:
                failed.append(path)
        assert len(failed) < len(left), failed
        left = failed
