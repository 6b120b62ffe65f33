# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Set-up of linkage_vibration for pip and, as an ament_python package, for colcon."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "linkage_vibration"
INTERFACES = f"{NAME}_interfaces"
ROOT = Path(__file__).resolve().parent  # colcon links this file into its build folder
SHARE = Path("share", NAME)
VERSION = ElementTree.parse(ROOT / "package.xml").findtext("version")

EXTRAS = {
    # ROS 2 from PyPI, where none is sourced; the files tools/*.txt name the releases.
    "ros": [
        f"{INTERFACES}=={VERSION}",
        "ros-builtin-interfaces",
        "ros-diagnostic-msgs",
        "ros-geometry-msgs",
        "ros-lifecycle-msgs",
        "ros-rcl-interfaces",
        "ros-rclpy",
        "ros-rmw-fastrtps-cpp",
        "ros-rosgraph-msgs",
        "ros-sensor-msgs",
        "ros-std-msgs",
        "ros-std-srvs",
    ],
    "bags": ["rosbags>=0.11.0"],
    # DBC files, and logs of a CAN bus.
    "can": ["cantools>=39.4.13", "python-can>=4.3.0"],
    # MF4 files of a CAN bus.
    "mf4": ["asammdf", "python-can>=4.3.0"],
    "uff": ["pyuff"],
    "plots": ["matplotlib>=3.6.3"],
    "xarray": ["pandas", "xarray"],
    "docs": ["furo", "myst-parser", "numpydoc", "sphinx"],
}
_USED = ("bags", "can", "mf4", "uff", "plots", "xarray")
OPTIONAL = [name for extra in _USED for name in EXTRAS[extra]]
# colcon runs the tests with pytest because the extra "test" names it.
TEST = [
    *OPTIONAL,
    "bloom",
    "coverage>=7.10",
    "distributed",
    "exudyn; platform_machine == 'x86_64'",
    "fmpy",
    "hypothesis>=6.98.15",
    "mcap-ros2-support",
    "mypy",
    "packaging",
    "pytest>=7.4.4",
    "pytest-timeout",
    "pytest-xdist",
    "ruff",
    "scikit-fem",
    "types-PyYAML",
    "types-tqdm",
]
# The benchmarks need "ros" too; CalculiX comes with `apt-get install calculix-ccx`.
BENCH = [
    *OPTIONAL,
    "distributed",
    "exudyn",
    "fmpy",
    "gmsh",
    "hypothesis",
    "mcap-ros2-support",
    "meshio",
    "pyFBS>=1.0.7",
    "pyOMA-2>=1.4",
    "pytest",
    "rerun-sdk>=0.41",
    "scikit-fem",
    "sdynpy",
]


def installed_files() -> list[tuple[str, list[str]]]:
    """Return what ament and the node look for below ``share``, as (folder, files) pairs."""
    files = [
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (str(SHARE), ["package.xml", "LICENSE"]),
    ]
    for top in ("config", "launch", *(f"{INTERFACES}/{kind}" for kind in ("msg", "srv", "action"))):
        for folder in sorted({p.parent for p in Path(top).rglob("*") if p.is_file()}):
            inside = sorted(str(p) for p in folder.iterdir() if p.is_file())
            files.append((str(SHARE / folder), inside))
    return files


setup(
    name=NAME,
    version=VERSION,
    description="Natural frequencies and response peak of a linkage, live from its joint angle",
    long_description=(ROOT / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    author="The linkage_vibration authors",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    # An editable install then puts this folder on the path, where type checkers find the package.
    package_dir={"": "."},
    package_data={
        NAME: ["py.typed"],
        f"{NAME}.export": ["templates/*"],
        f"{NAME}.review": ["page/*"],
    },
    data_files=installed_files(),
    zip_safe=False,
    # Start-up refuses older ones, too (support/version.py). tools/ubuntu-24.04.txt has the same.
    install_requires=[
        "lz4>=4.0.2",
        "mcap>=1.6.0",
        "numpy>=1.26.4",
        "PyYAML>=6.0.1",
        "scipy>=1.11.4",
        "tqdm>=4.66.2",
        "zstandard>=0.22.0",
    ],
    extras_require={**EXTRAS, "test": TEST, "bench": BENCH},
    entry_points={
        "console_scripts": [
            "linkage-vibration = linkage_vibration.cli.__main__:main",
            "linkage_vibration_node = linkage_vibration.ros.node:main",
        ],
        "pytest11": ["linkage_vibration = linkage_vibration.testing.pytest_plugin"],
    },
)
