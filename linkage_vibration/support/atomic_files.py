# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes files so that no reader ever finds half of one, and no input is lost."""

import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TextIO

import yaml

from linkage_vibration.errors import LinkageVibrationError

# Options that write files with these suffixes; bags of other kinds are only read.
_WRITERS = {
    ".mcap": "replay BAG -o",
    ".html": "review LOG -o",
    ".csv": "review LOG --csv",
    ".png": "review LOG --png",
    ".npz": "build MECHANISM -o",
    ".nc": "sweep DESIGNS -o",
    ".yaml": "plan MECHANISM -o",
    ".fmu": "export TABLE --fmu",
    ".bag": "",
    ".db3": "",
}


class OutputError(LinkageVibrationError):
    """A file cannot be written, or would replace an input or another output."""


def check_outputs(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Refuse outputs that cannot be written, before the work begins whose result goes there.

    An output must be a file in a folder, with permission to write it. By its name or by a link it
    must not be an input or another output. The files of a folder are inputs, too, and so are the
    files that a YAML file names.
    """
    read: dict[Path, None] = {}
    for path in inputs:
        _add_files(path, read)
    for i, path in enumerate(outputs):
        _check_place(path)
        if not _is_special(path):
            for other in read:
                if _is_same(path, other):
                    raise OutputError(f"{path} is an input ({other}); give another output.")
            for other in outputs[:i]:
                if _is_same(path, other):
                    raise OutputError(f"{path} and {other} are one file; give each its own name.")


def make_folder(folder: Path, error: type[LinkageVibrationError]) -> None:
    """Create a folder if it is missing, and those above it; raise the error if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise error(
            f"{folder}: the folder cannot be created ({problem.strerror}); give another one."
        ) from None


def check_suffix(path: Path, suffix: str) -> None:
    """Refuse an output whose suffix is that of another format than its own.

    The error names the option that writes the other format.
    """
    other = path.suffix.lower()
    if other != suffix and other in _WRITERS:
        writer, name = _WRITERS[other], path.with_suffix(suffix)
        instead = f"; `linkage-vibration {writer} FILE` writes {other} files" if writer else ""
        raise OutputError(f"{path}: the output is a {suffix} file; use {name}{instead}.")


def messages_beside(outputs: Sequence[Path]) -> TextIO:
    """Return where messages go: to the standard error if an output is the standard output."""
    with suppress(OSError):
        if any(os.path.samestat(path.stat(), os.fstat(1)) for path in outputs if path.exists()):
            return sys.stderr
    return sys.stdout


@contextmanager
def replacement(path: Path, error: type[LinkageVibrationError]) -> Iterator[Path]:
    """Give the path of a new file, whose content goes to another path when the context ends.

    A regular file is replaced at once, and links are followed. A device, a pipe or the standard
    output is written through. If the context fails, nothing is left behind; a failure to write
    raises this kind of error.
    """
    target = Path(os.path.realpath(path))
    special = _is_special(path)
    folder = None if special else target.parent
    try:
        with tempfile.TemporaryDirectory(".tmp", f".{target.name[:99]}.", folder) as inside:
            new = Path(inside) / path.name
            yield new
            if special:
                with new.open("rb") as source, _opened(path) as sink:
                    shutil.copyfileobj(source, sink)
            else:
                new.replace(target)
    except OSError as problem:
        raise error(
            f"{path}: cannot be written ({problem.strerror or problem}); choose another folder."
        ) from None


def write_bytes(path: Path, data: bytes, error: type[LinkageVibrationError]) -> None:
    """Write a file at once, as `replacement` does."""
    with replacement(path, error) as new:
        new.write_bytes(data)


def write_parts(path: Path, parts: Iterable[str], error: type[LinkageVibrationError]) -> None:
    """Write the parts of a text file as `write_text` does, without holding all of them."""
    with replacement(path, error) as new, new.open("w", encoding="utf-8", newline="") as file:
        file.writelines(parts)


def write_text(path: Path, text: str, error: type[LinkageVibrationError]) -> None:
    """Write a text file in UTF-8, as `write_bytes` does."""
    write_bytes(path, text.encode(), error)


def _check_place(path: Path) -> None:
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give the name of a file.")
    target = Path(os.path.realpath(path))
    if not _is_special(path) and not target.parent.is_dir():
        raise OutputError(f"{path}: cannot be written, as {target.parent} is no folder; create it.")
    if not os.access(path if path.exists() else target.parent, os.W_OK):
        raise OutputError(f"{path}: cannot be written (no permission); choose another folder.")


def _is_special(path: Path) -> bool:
    """Return whether a path is a device, a pipe, or a standard stream of this process."""
    try:
        status = path.stat()
    except OSError:
        return False
    return not stat.S_ISREG(status.st_mode) or _stream(status) is not None


def _stream(status: os.stat_result) -> int | None:
    """Return the descriptor of the standard output or error if it is this file, or None."""
    for descriptor in (1, 2):
        with suppress(OSError):
            if os.path.samestat(status, os.fstat(descriptor)):
                return descriptor
    return None


def _opened(path: Path) -> BinaryIO:
    """Open a device or a pipe; a standard stream keeps its position."""
    descriptor = _stream(path.stat())
    if descriptor is None:
        return path.open("wb")
    (sys.stdout if descriptor == 1 else sys.stderr).flush()
    return os.fdopen(os.dup(descriptor), "wb")


def _is_same(path: Path, other: Path) -> bool:
    with suppress(OSError):
        return path.samefile(other)
    return os.path.realpath(path) == os.path.realpath(other)


def _add_files(path: Path, files: dict[Path, None]) -> None:
    """Add a path, the files of a folder, and the files that YAML names, to those found."""
    if path in files:
        return
    files[path] = None
    if path.is_dir():
        files.update(dict.fromkeys(path.iterdir()))
    elif path.suffix in (".yaml", ".yml") and path.is_file():
        with suppress(yaml.YAMLError, OSError, UnicodeDecodeError), path.open("rb") as file:
            for token in yaml.scan(file, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
                name = Path(getattr(token, "value", "") if hasattr(token, "plain") else "")
                if name.suffix[1:2].isalpha() and (path.parent / name).is_file():
                    _add_files(path.parent / name, files)
