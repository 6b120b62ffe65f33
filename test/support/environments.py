# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Virtual environments that hold exactly what a page tells the reader to install.

Nothing is downloaded: the files of every required distribution are linked from the environment that
runs the tests. Only the package itself is installed by pip, from its wheel.
"""

import importlib.metadata
import os
import subprocess
import sys
import venv
from collections.abc import Iterable
from importlib.util import cache_from_source
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def make_environment(folder: Path, wheel: Path, requirements: Iterable[str]) -> dict[str, str]:
    """Make a virtual environment and return the variables that activate it.

    Parameters
    ----------
    folder : Path
        Where the environment is made.
    wheel : Path
        The wheel of this package.
    requirements : iterable of str
        What is installed, such as ``linkage_vibration[bags]``.

    Raises
    ------
    LookupError
        If a required distribution is not installed where the tests run.
    """
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("AMENT", "PYTHON", "VIRTUAL"))}
    command: list[str | Path] = [sys.executable, "-m", "pip", "--python", python, "install"]
    subprocess.run(
        [*command, "-qq", "--no-deps", "--no-index", "--no-compile", "--ignore-installed", wheel],
        check=True,
        env=kept,
    )
    (site,) = folder.glob("lib/python*/site-packages")
    (ours,) = importlib.metadata.distributions(path=[str(site)])
    for distribution in required({ours.name: ours}, requirements):
        link(distribution, folder, site)
    path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
    return {**kept, "PATH": path, "VIRTUAL_ENV": str(folder)}


def required(
    known: dict[str, importlib.metadata.Distribution], requirements: Iterable[str]
) -> list[importlib.metadata.Distribution]:
    """Return the distributions that requirements need, directly or through others.

    Parameters
    ----------
    known : dict of str to Distribution
        Distributions that are installed already; their requirements count, they are not returned.
    requirements : iterable of str
        Where the search begins.

    Raises
    ------
    LookupError
        If a distribution is not installed where the tests run.
    """
    waiting = [(Requirement(text), "") for text in requirements]
    actual = {canonicalize_name(name): distribution for name, distribution in known.items()}
    given, seen = set(actual), set()
    while waiting:
        requirement, extra = waiting.pop()
        name = canonicalize_name(requirement.name)
        if requirement.marker and not requirement.marker.evaluate({"extra": extra}):
            continue
        if name not in actual:
            # ament adds an egg-info, which lists few files, to the interfaces' own metadata.
            installed = importlib.metadata.distributions(name=name)
            most = max(installed, key=lambda first: len(first.files or []), default=None)
            if most is None:
                raise LookupError(f"{name} is not installed from a wheel")
            actual[name] = most
        for wanted in {"", *requirement.extras} - {e for n, e in seen if n == name}:
            seen.add((name, wanted))
            waiting += [(Requirement(text), wanted) for text in actual[name].requires or []]
    return [distribution for name, distribution in actual.items() if name not in given]


def link(distribution: importlib.metadata.Distribution, folder: Path, site: Path) -> None:
    """Link the files of a distribution into an environment, at the same places.

    Parameters
    ----------
    distribution : Distribution
        Installed in the environment that runs the tests.
    folder, site : Path
        The environment, and its folder of packages.
    """
    pairs = []
    for file in distribution.files or []:
        source = Path(str(distribution.locate_file(file))).resolve()
        target = Path(os.path.normpath(site / file))
        pairs.append((source, target))
        if source.suffix == ".py":  # what is compiled already, which pip may not list
            pairs.append((Path(cache_from_source(source)), Path(cache_from_source(target))))
    for source, target in pairs:
        if target.is_relative_to(folder) and source.is_file() and not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            target.symlink_to(source)
