# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Keeps tables, and what follows from them and excitations, in the user's cache folder.

A file is named by a hash of all that its numbers follow from, also of the code and of how this
machine rounds. So a number that is kept is the one that would be computed, to the last bit.
"""

import hashlib
import os
import platform
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.description import Mechanism
from linkage_vibration.support.atomic_files import refuse_pipe, replacement
from linkage_vibration.support.version import VERSION
from linkage_vibration.table.table import Table, TableError, load_table, save_table

Arrays = dict[str, Any]  # Arrays by their names; each is contiguous
Keep = Callable[[str, Callable[[], Arrays]], Arrays]
"""Returns the arrays of a part, which has a name, that a function computes."""
Kept = Callable[[Callable[[], Arrays]], Arrays]  # The same for a part whose name is known

MOST_FILES = 40  # Eight tables, and four files of each with excitations, of up to 60 MB together

_ROOMS = "mechanics", "table", "prediction"  # whose code computes the numbers


def computed(part: str, compute: Callable[[], Arrays]) -> Arrays:
    """Return the arrays of a part without a file."""
    return compute()


@dataclass(frozen=True, slots=True)
class LevelCache:
    """A `Keep` with files of this key. A file that cannot be used or written changes no number."""

    key: str

    def __call__(self, part: str, compute: Callable[[], Arrays]) -> Arrays:
        """Return the arrays of a part from its file, or compute them and write it."""
        if (folder := cache_folder()) is None:
            return compute()
        path = folder / f"{part}-{self.key}.npz"
        arrays = _read(path)
        if arrays is None:
            arrays = compute()
            _write(path, lambda: _write_arrays(path, arrays))
        else:
            _note_use(path)
        return arrays


def level_cache(table: Table, mechanism: Mechanism, excitations: Sequence[object]) -> LevelCache:
    """Return the cache of the levels by excitations of a mechanism with this table."""
    return LevelCache(_key(mechanism, table.checksum, tuple(excitations)))


def kept_table(mechanism: Mechanism, build: Callable[[], Table], *more: object) -> Table:
    """Return the table of a mechanism and more from its file, or build it and write it."""
    folder = cache_folder()
    path = None if folder is None else folder / f"table-{_key(mechanism, *more)}.npz"
    if path is not None:
        with suppress(TableError):
            table = load_table(path, mechanism)
            _note_use(path)
            return table
    table = build()
    if path is not None:
        _write(path, lambda: save_table(table, path))
    return table


def _key(mechanism: Mechanism, *more: object) -> str:
    """Return a hash of a mechanism and more, of the code and of how this machine rounds."""
    # The hash of the model has the arrays of bodies, but only twelve digits of each number.
    exact = [getattr(mechanism, each.name) for each in fields(mechanism) if each.repr]
    versions = VERSION, np.__version__, scipy.__version__, sys.version, platform.platform()
    digest = hashlib.sha256(repr((more, mechanism.model_hash, exact, versions)).encode())
    digest.update(_rounding())
    for room in _ROOMS:
        for path in sorted((Path(__file__).parents[1] / room).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:32]


def cache_folder() -> Path | None:
    """Return the folder of the files; None if the user has no home and names no folder."""
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    with suppress(RuntimeError):
        # A relative path is to be ignored (XDG Base Directory Specification).
        return (named if named.is_absolute() else Path.home() / ".cache") / "linkage_vibration"
    return None


def _rounding() -> bytes:
    """Return results whose last bits differ between processors, BLAS kernels and threads."""
    values = np.linspace(0.1, 3.0, 64 * 64).reshape(64, 64)
    wide = np.tile(values, (2, 16)).astype(np.float32)
    square = np.sin(values * values.T)
    parts = [
        square @ square.T,
        wide @ wide.T,
        np.linalg.eigvals(square[:24, :24]),
        np.linalg.solve(square + np.eye(64), values),
        *(function(each) for function in (np.exp, np.log, np.cos) for each in (values, wide)),
    ]
    return b"".join(np.ascontiguousarray(part).tobytes() for part in parts)


def _read(path: Path) -> Arrays | None:
    """Return the arrays of a file; None if it is missing, damaged, or that of another key."""
    # A damaged archive raises errors of zipfile, zlib, struct, tokenize and NumPy.
    with suppress(Exception):
        refuse_pipe(path)
        with np.load(path, allow_pickle=False) as archive:
            if str(archive["name"]) == path.name:
                return {name: archive[name] for name in archive.files if name != "name"}
    return None


def _note_use(path: Path) -> None:
    """Let a file that was read be among the last to be removed, if the folder permits it."""
    with suppress(OSError):
        os.utime(path)


def _write(path: Path, write: Callable[[], object]) -> None:
    """Let a file be written if the folder permits it, and remove those unused for longest."""
    with suppress(OSError, LinkageVibrationError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write()
        kept = sorted(path.parent.glob("*.npz"), key=lambda each: each.stat().st_mtime)
        for oldest in kept[:-MOST_FILES]:
            oldest.unlink()


def _write_arrays(path: Path, arrays: Arrays) -> None:
    """Write the file of a part."""
    with replacement(path, LinkageVibrationError) as new:
        np.savez(new, name=np.array(path.name), **arrays)
