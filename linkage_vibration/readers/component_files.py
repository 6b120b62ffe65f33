# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the readers of components share: errors, names of DoFs, and arrays of bounded size."""

import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.dofs import DIRECTIONS, Dofs, InterfaceDof
from linkage_vibration.mechanics.reduction import ReductionError

INNER = "-"
"""In a list of DoFs, marks a row that is not an interface DoF."""
MAX_BYTES = 2**30
"""The largest file that is read, also after unpacking."""


class ComponentFileError(LinkageVibrationError):
    """A file of a component cannot be read, or its content is not plausible."""


class FileError(LinkageVibrationError):
    """What is wrong with a file, and how to fix it; `file_errors` adds the path."""


@contextmanager
def file_errors(path: Path, *damage: type[Exception]) -> Iterator[None]:
    """Turn errors of reading a file, and those that `damage` raises, into `ComponentFileError`s."""
    try:
        yield
    except ComponentFileError:
        raise
    except (FileError, ReductionError) as error:
        raise ComponentFileError(f"{path}: {error}") from None
    except damage as error:
        text = " ".join(str(error).split()) or type(error).__name__
        problem = f"{path}: is damaged or has another format than its name says ({text})"
        raise ComponentFileError(f"{problem}; write it again.") from None
    except OSError as error:
        raise ComponentFileError(f"{path}: cannot be opened: {error.strerror}.") from None


def check_file(path: Path) -> None:
    """Raise a FileError unless there is such a file, and it fits into memory."""
    if not path.is_file():
        raise FileError("does not exist; check the path.")
    check_size(path.stat().st_size)


def check_size(size: int) -> None:
    """Raise a FileError for a file that has more bytes than `MAX_BYTES` after unpacking."""
    if size > MAX_BYTES:
        problem = f"holds {size / 2**20:.0f} MiB, more than {MAX_BYTES / 2**20:.0f} MiB"
        raise FileError(f"{problem}; reduce the component before you write the file.")


def load_npz(
    path: Path, required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, NDArray[Any]]:
    """Read the arrays of an ``.npz`` file without unpickling; other names are refused."""
    names = *required, *optional
    check_file(path)
    with file_errors(path, Exception):  # of zipfile, zlib, struct, tokenize and NumPy
        with zipfile.ZipFile(path) as archive:
            check_size(sum(member.file_size for member in archive.infolist()))
        try:
            with np.load(path, allow_pickle=False) as arrays:
                for name in arrays.files:
                    if name not in names:
                        problem = f"holds {name!r}, which is unknown; use only {', '.join(names)}."
                        raise FileError(problem)
                contents = {name: np.asarray(arrays[name]) for name in arrays.files}
        except ValueError as error:
            if "allow_pickle" not in str(error):
                raise
            problem = "holds pickled objects, which can run code; save plain numbers and text."
            raise FileError(problem) from None
        if not all(map(_is_text, contents.values())):
            raise FileError("holds text that is not Unicode; write it again.")
        for name in required:
            if name not in contents:
                raise FileError(f"has no {name}; add it.")
        return contents


def _is_text(array: NDArray[Any]) -> bool:
    """Return whether all characters exist; some others, which NumPy accepts, crash Python."""
    if array.dtype.kind != "U" or array.dtype.itemsize == 0:
        return True
    codes = np.ascontiguousarray(array).view(array.dtype.byteorder + "u4")
    return bool(((codes < 0xD800) | ((codes > 0xDFFF) & (codes <= 0x10FFFF))).all())


def parse_dofs(names: Sequence[object]) -> list[InterfaceDof | None]:
    """Turn the text of each row, such as ``P1 x``, into a DoF, and ``-`` into None."""
    dofs: list[InterfaceDof | None] = []
    for i, name in enumerate(names):
        if not isinstance(name, str):
            raise FileError(f"entry {i + 1} of dofs is not text; write it as 'P1 x'.")
        if name.strip() == INNER:
            dofs.append(None)
            continue
        parts = name.rsplit(None, 1)
        if len(parts) != 2 or parts[1] not in DIRECTIONS:
            hint = f"write a point and one of {', '.join(DIRECTIONS)}, such as 'P1 x', or {INNER}"
            problem = f"entry {i + 1} of dofs is {name!r}"
            raise FileError(f"{problem}; {hint} for an inner coordinate.")
        dof = InterfaceDof(parts[0].strip(), parts[1])
        if dof in dofs:
            problem = f"entries {dofs.index(dof) + 1} and {i + 1} of dofs are both {dof}"
            raise FileError(f"{problem}; remove one.")
        dofs.append(dof)
    return dofs


def choose_rows(labels: Sequence[InterfaceDof | None]) -> tuple[Dofs, list[int]]:
    """Return the interface DoFs and the row of each; a FileError is raised if there is none."""
    named = {dof: row for row, dof in enumerate(labels) if dof is not None}
    if not named:
        raise FileError("has no interface DoF in dofs; write them as 'P1 x'.")
    return tuple(named), list(named.values())
