# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What the readers of components share: refusals, names of DoFs, and arrays of bounded size."""

import zipfile
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.mechanics.dofs import DIRECTIONS, InterfaceDof

INNER = "-"
"""Stands in a list of DoFs for a row that is no interface DoF."""
MAX_BYTES = 2**30
"""A file, or what it unpacks to, may be this large."""


class ComponentFileError(LinkageVibrationError):
    """A file of a component cannot be read, or cannot be what it is meant to be.

    Parameters
    ----------
    path : Path
        The file.
    problem : str
        What is wrong with it, and what would mend it.
    """

    def __init__(self, path: Path, problem: str) -> None:
        super().__init__(f"{path}: {problem}")
        self.path = path
        self.problem = problem


def check_file(path: Path) -> None:
    """Refuse what is no file, or a file too large to be taken into memory.

    Raises
    ------
    ComponentFileError
        Telling which of the two.
    """
    try:
        if not path.is_file():
            raise ComponentFileError(path, "there is no such file; check the path.")
        check_size(path, path.stat().st_size)
    except OSError as error:
        raise ComponentFileError(path, f"cannot be read ({error.strerror}).") from None


def check_size(path: Path, size: int) -> None:
    """Refuse more bytes than `MAX_BYTES`.

    Raises
    ------
    ComponentFileError
        With both sizes.
    """
    if size > MAX_BYTES:
        raise ComponentFileError(
            path,
            f"holds {size / 2**20:.0f} MiB where {MAX_BYTES / 2**20:.0f} MiB are allowed; reduce "
            "the component before it is written.",
        )


def damaged(path: Path, error: Exception) -> ComponentFileError:
    """Return the refusal of a file that a library could not read."""
    text = " ".join(str(error).split()) or type(error).__name__
    return ComponentFileError(
        path, f"is damaged or not what its name says ({text}); write it anew."
    )


def load_npz(path: Path, known: Collection[str]) -> dict[str, NDArray[Any]]:
    """Read the arrays of an ``.npz``, without pickles.

    Parameters
    ----------
    path : Path
        The archive.
    known : collection of str
        Names that it may hold; any other is refused, since it may be one of them misspelt.

    Raises
    ------
    ComponentFileError
        If it is missing, damaged, too large when unpacked, or holds a pickle or an unknown name.
    """
    check_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            check_size(path, sum(member.file_size for member in archive.infolist()))
        with np.load(path, allow_pickle=False) as arrays:
            check_known(path, arrays.files, known)
            found = {name: np.asarray(arrays[name]) for name in arrays.files}
            if not all(map(_is_text, found.values())):
                raise ComponentFileError(path, "holds text that is not Unicode; write it anew.")
            return found
    except ComponentFileError:
        raise
    # A damaged archive raises errors of zipfile, zlib, struct, tokenize and NumPy.
    except Exception as error:
        if "allow_pickle" in str(error):
            raise ComponentFileError(
                path, "holds pickled objects, which can run code; save plain numbers and text."
            ) from None
        raise damaged(path, error) from None


def _is_text(array: NDArray[Any]) -> bool:
    """Tell text that Python can hold, without making any; other arrays pass.

    NumPy takes any four bytes for a character, and Python does not survive some of them.
    """
    if array.dtype.kind != "U" or array.dtype.itemsize == 0:
        return True
    codes = np.ascontiguousarray(array).view(array.dtype.byteorder + "u4")
    return bool(((codes < 0xD800) | ((codes > 0xDFFF) & (codes <= 0x10FFFF))).all())


def compressed_columns(
    data: NDArray[Any], indices: NDArray[Any], starts: NDArray[Any], rows: int
) -> sparse.csc_array:
    """Return a sparse matrix from its compressed columns, all of whose indices are checked.

    SciPy checks some of them, and follows the others to wherever in memory they point.

    Raises
    ------
    ValueError
        If they do not belong together.
    """
    if any(
        part.ndim != 1 or part.dtype.kind not in kinds
        for part, kinds in ((data, "fiu"), (indices, "iu"), (starts, "iu"))
    ):
        raise ValueError("three lists are needed, of numbers and of twice whole numbers")
    indices, starts = indices.astype(np.int64), starts.astype(np.int64)
    if (
        starts.size == 0
        or starts[0] != 0
        or (np.diff(starts) < 0).any()
        or not starts[-1] == indices.size == data.size
        or (indices.size and not 0 <= indices.min() <= indices.max() < rows)
    ):
        raise ValueError("an index points outside of the matrix")
    return sparse.csc_array(
        (data.astype(np.float64), indices, starts), shape=(rows, starts.size - 1)
    )


def check_known(path: Path, names: Iterable[str], known: Collection[str]) -> None:
    """Refuse names that nobody will ask for.

    Raises
    ------
    ComponentFileError
        Naming the first, and those that are known.
    """
    for name in names:
        if name not in known:
            raise ComponentFileError(
                path, f"holds {name!r}, which is not known here; it may hold {', '.join(known)}."
            )


def parse_dofs(path: Path, names: Sequence[object]) -> list[InterfaceDof | None]:
    """Turn texts such as ``P1 x`` into DoFs, and ``-`` into None.

    Raises
    ------
    ComponentFileError
        If one is no point and direction, or stands twice.
    """
    dofs: list[InterfaceDof | None] = []
    for i, name in enumerate(names):
        if not isinstance(name, str):
            raise ComponentFileError(path, f"entry {i + 1} of dofs is not text; write 'P1 x'.")
        if name.strip() == INNER:
            dofs.append(None)
            continue
        parts = name.rsplit(None, 1)
        if len(parts) != 2 or parts[1] not in DIRECTIONS:
            raise ComponentFileError(
                path,
                f"entry {i + 1} of dofs is {name!r}; write a point and one of "
                f"{', '.join(DIRECTIONS)}, such as 'P1 x', or {INNER} for an inner coordinate.",
            )
        dof = InterfaceDof(parts[0].strip(), parts[1])
        if dof in dofs:
            raise ComponentFileError(
                path,
                f"dofs names {dof} twice (entries {dofs.index(dof) + 1} and {i + 1}); "
                "name each once.",
            )
        dofs.append(dof)
    return dofs


def choose_rows(
    path: Path, found: Sequence[InterfaceDof | None], wanted: Sequence[InterfaceDof] | None
) -> tuple[tuple[InterfaceDof, ...], list[int]]:
    """Return the interface DoFs and the row of each; all that are named if none are asked for.

    Raises
    ------
    ComponentFileError
        If a DoF that is asked for is not there.
    """
    named = [dof for dof in found if dof is not None]
    dofs = tuple(named if wanted is None else wanted)
    for dof in dofs:
        if dof not in named:
            raise ComponentFileError(
                path,
                f"the DoF {dof} is missing; its dofs name "
                f"{', '.join(map(str, named)) or 'none'}; add it.",
            )
    if not dofs:
        raise ComponentFileError(path, "its dofs name no interface DoF; name them, as 'P1 x'.")
    return dofs, [found.index(dof) for dof in dofs]
