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
    """Make an environment with a wheel of this package, and return the variables that activate it.

    It has what requirements such as ``linkage_vibration[bags]`` need. A LookupError says that a
    distribution is not installed where the tests run.
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

    Those that are known are installed already: their requirements count, and they are not returned.
    A LookupError says that a distribution is not installed where the tests run.
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
    """Link the files of a distribution into an environment and its packages, at the same places."""
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
