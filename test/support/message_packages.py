# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Packages of messages of the same shape as those that tractors publish, built with pip.

They are built like our own interfaces, and kept between runs of the tests.
"""

import ctypes
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

OWN = "linkage_vibration_interfaces"
SOURCE = Path(__file__).parents[2] / OWN
PACKAGES = {
    "can_msgs": {
        "Frame": "std_msgs/Header header\nuint32 id\nbool is_rtr\nbool is_extended\nbool is_error\n"
        "uint8 dlc\nuint8[8] data\n"
    },
    "ros2_isobus": {
        "TecuRearHitchStatus": "float64 position_percent\nuint8 in_work\nfloat64 draft_n\n",
        "TecuRearPtoStatus": "float64 rpm\nfloat64 setpoint_rpm\nuint8 engagement\n",
        "TecuGroundSpeed": "float64 speed_ms\nfloat64 distance_m\nbool forward\n",
    },
}
"""The definitions of the messages of each package."""


def build_packages(cache: Path, folder: Path) -> Path:
    """Build the packages if they are not in the cache, and return the prefix that holds them.

    Parameters
    ----------
    cache, folder : Path
        A folder that is kept between runs, and a temporary one.
    """
    sources = [SOURCE / name for name in ("CMakeLists.txt", "package.xml", "pyproject.toml")]
    text = "".join(path.read_text() for path in sources)
    key = hashlib.sha256(f"{text}{PACKAGES}{sys.version}{sys.prefix}".encode()).hexdigest()[:16]
    prefix = cache / key
    if not prefix.is_dir():
        built = folder / "prefix"
        for package, messages in PACKAGES.items():
            here = folder / package
            (here / "msg").mkdir(parents=True)
            for path in sources:
                (here / path.name).write_text(path.read_text().replace(OWN, package))
            for name, definition in messages.items():
                (here / "msg" / f"{name}.msg").write_text(definition)
            command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps"]
            options = ["--no-build-isolation", "--prefix", str(built), str(here)]
            subprocess.run([*command, *options], check=True)
        shutil.move(built, prefix)
    return prefix


def variables(prefix: Path) -> dict[str, str]:
    """Return the variables with which a process finds the packages."""
    [site] = prefix.glob("lib/python*/site-packages")
    added = {"PYTHONPATH": site, "LD_LIBRARY_PATH": prefix / "lib", "AMENT_PREFIX_PATH": prefix}
    before = {**os.environ, "AMENT_PREFIX_PATH": os.environ.get("AMENT_PREFIX_PATH", sys.prefix)}
    return {
        name: os.pathsep.join(filter(None, [str(path), before.get(name, "")]))
        for name, path in added.items()
    }


def import_here(prefix: Path) -> None:
    """Let this process import the packages."""
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
