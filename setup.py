# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Set-up of linkage_vibration for pip and, as an ament_python package, for colcon."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "linkage_vibration"
ROOT = Path(__file__).parent
SHARE = Path("share", NAME)


def installed_files() -> list[tuple[str, list[str]]]:
    """Return what ament and the node look for below ``share``, as (folder, files) pairs."""
    files = [
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (str(SHARE), ["package.xml"]),
    ]
    for top in ("config", "launch"):
        for folder in sorted({p.parent for p in Path(top).rglob("*") if p.is_file()}):
            inside = sorted(str(p) for p in folder.iterdir() if p.is_file())
            files.append((str(SHARE / folder), inside))
    return files


setup(
    name=NAME,
    version=ElementTree.parse(ROOT / "package.xml").findtext("version"),
    description="Natural frequencies and response peak of a linkage, live from its joint angle",
    author="The linkage_vibration authors",
    license="Apache-2.0",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"], f"{NAME}.review": ["page/*"]},
    data_files=installed_files(),
    zip_safe=False,
    install_requires=["mcap>=1.6", "numpy>=1.21", "PyYAML", "scipy>=1.8", "tqdm"],
    extras_require={
        # ROS 2 from PyPI, where none is sourced; in step with linkage_vibration_interfaces.
        "ros": [
            "ros-diagnostic-msgs~=5.5.1",
            "ros-geometry-msgs~=5.5.1",
            "ros-lifecycle-msgs~=2.3.0",
            "ros-rclpy~=9.1.2",
            "ros-rmw-fastrtps-cpp~=9.3.3",
            "ros-sensor-msgs~=5.5.1",
            "ros-std-msgs~=5.5.1",
            "ros-std-srvs~=5.5.1",
            "ros-visualization-msgs~=5.5.1",
        ],
        "bags": ["rosbags>=0.11"],
        "fe": ["meshio", "scikit-fem"],
        "uff": ["pyuff"],
        "plots": ["matplotlib>=3.7"],
        "dask": ["dask", "distributed"],
        # colcon runs the tests with pytest because this extra names it.
        "test": [
            "dask",
            "distributed",
            "exudyn; platform_machine == 'x86_64'",
            "hypothesis",
            "matplotlib>=3.7",
            "mcap-ros2-support",
            "meshio",
            "mypy",
            "pytest",
            "pyuff",
            "rosbags>=0.11",
            "ruff",
            "scikit-fem",
            "types-PyYAML",
            "types-tqdm",
            "xarray",
        ],
        "docs": ["furo", "myst-parser", "numpydoc", "sphinx"],
        # Peers of the benchmarks; CalculiX comes with `apt-get install calculix-ccx`.
        "bench": [
            "dask",
            "distributed",
            "exudyn",
            "gmsh",
            "matplotlib>=3.7",
            "meshio",
            "pyFBS>=1.0.7",
            "scikit-fem",
            "sdynpy",
        ],
    },
    entry_points={
        "console_scripts": [
            "linkage-vibration = linkage_vibration.cli.main:main",
            "linkage_vibration_node = linkage_vibration.ros.node:main",
        ],
        "pytest11": ["linkage_vibration = linkage_vibration.testing.pytest_plugin"],
    },
)
