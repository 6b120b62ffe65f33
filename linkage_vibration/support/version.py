# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The version of the installed package, and the oldest versions of the libraries that it uses."""

import re
from importlib.metadata import PackageNotFoundError, version

from linkage_vibration.errors import LinkageVibrationError

# The tests passed with them, and setup.py requires them. Ubuntu 24.04 has all but mcap.
_REQUIRED = {
    "lz4": "4.0.2",
    "mcap": "1.6.0",
    "numpy": "1.26.4",
    "PyYAML": "6.0.1",
    "scipy": "1.11.4",
    "tqdm": "4.66.2",
    "zstandard": "0.22.0",
}
_OPTIONAL = {
    "cantools": "39.4.13",
    "matplotlib": "3.6.3",
    "python-can": "4.3.0",
    "rosbags": "0.11.0",
}
OLDEST = _REQUIRED | _OPTIONAL


class OldLibraryError(LinkageVibrationError):
    """A library is older than this package needs."""


def check_versions(*optional: str) -> None:
    """Raise OldLibraryError if a library is too old: an optional one, or else any required one."""
    for name in optional or _REQUIRED:
        try:
            installed = version(name)
        except PackageNotFoundError:
            continue  # the import says that it is missing
        oldest = OLDEST[name]
        if _numbers(installed) < _numbers(oldest):
            needs = f"linkage_vibration needs {name} {oldest} or later"
            fix = f"run `pip install '{name}>={oldest}'`"
            raise OldLibraryError(f"{needs}, but {installed} is installed; {fix}.")


def _numbers(text: str) -> list[int]:
    """Return the numbers of a version, without zeros at the end and without what follows them."""
    release = re.match(r"\d+(\.\d+)*", text)
    return [int(n) for n in re.sub(r"(\.0)+$", "", release[0]).split(".")] if release else []


VERSION = __version__ = version("linkage_vibration")
