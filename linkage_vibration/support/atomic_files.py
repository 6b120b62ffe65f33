# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads texts, and writes files so that no reader finds half of one, and no input is lost."""

import errno
import os
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import yaml

from linkage_vibration.errors import LinkageVibrationError

ErrorType = type[LinkageVibrationError]


class OutputError(LinkageVibrationError):
    """A file cannot be written, or would replace an input or another output."""


def check_output(path: Path | None, suffix: str, inputs: Sequence[Path]) -> None:
    """Refuse an output, if one is given, as `check_outputs` and `check_suffix` do."""
    if path is not None:
        check_outputs([path], inputs)
        check_suffix(path, suffix)


def check_outputs(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Refuse outputs that cannot be written, before the work begins whose result goes there.

    By name or by link, an output must not be an input or another output; the files of a folder, and
    those that a YAML file names, are inputs, too.
    """
    read: dict[Path, None] = {}
    for path in inputs:
        _add_files(path, read)
    for i, path in enumerate(outputs):
        _check_place(path)
        for other in read:
            if _is_same(path, other):
                raise OutputError(f"{path} is an input ({other}); give another output.")
        for other in outputs[:i]:
            if _is_same(path, other):
                raise OutputError(f"{path} and {other} are one file; give each its own name.")


def check_paths(paths: Sequence[Path]) -> None:
    """Refuse pipes, for which a command would wait."""
    for path in paths:
        if os.path.exists(path) and Path(os.path.realpath(path)).is_fifo():
            raise OutputError(f"{path}: is no regular file; give the name of a file.")


def refuse_pipe(path: Path) -> None:
    """Raise an OSError for an input that is a pipe, as its reader might wait for ever."""
    if path.is_fifo():
        raise OSError(errno.EINVAL, f"{path.name} is a pipe, not a file")


def read_text(path: Path, encoding: str = "utf-8") -> str:
    """Return a text; an OSError or a UnicodeDecodeError refuses a pipe, and gigabytes of zeros."""
    refuse_pipe(path)
    with path.open("rb") as file:
        start = file.read(4096)
    if (at := start.find(b"\0")) >= 0:
        raise UnicodeDecodeError(encoding, start, at, at + 1, "a null character")
    return path.read_text(encoding)


def make_folder(folder: Path, error: ErrorType) -> None:
    """Create a folder if it is missing, and those above it; raise the error if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        text = f"{folder}: the folder cannot be created ({problem.strerror}); give another one."
        raise error(text) from None


def check_suffix(path: Path, suffix: str) -> None:
    """Refuse an output with another suffix than that of its format; it may have none."""
    if path.suffix.lower().replace(".yml", ".yaml") not in ("", suffix):
        name = path.with_suffix(suffix)
        raise OutputError(f"{path}: the output is a {suffix} file; use {name}.")


@contextmanager
def replacement(path: Path, error: ErrorType, *, new_only: bool = False) -> Iterator[Path]:
    """Give the path of a new file, whose content goes to another path when the context ends.

    A file is replaced at once and keeps its mode; links are followed; a device, a pipe and, if
    ``new_only``, any file is refused. A failure leaves nothing behind.
    """
    with _new_file(path, error, new_only) as (new, target):
        yield new
        _to_disk(new)
        _move(new, target, new_only)


def write_files(files: Mapping[Path, Iterable[bytes]], error: ErrorType) -> None:
    """Write the parts of files as `replacement` does, or none of the files if one has no room."""
    with ExitStack() as stack:
        moves = []
        for path, parts in files.items():
            new, target = stack.enter_context(_new_file(path, error))
            with new.open("wb") as file:
                file.writelines(parts)
            _to_disk(new)
            moves.append((path, new, target))
        for path, new, target in moves:
            with _errors(path, error):
                _move(new, target)


@contextmanager
def _errors(path: Path, error: ErrorType) -> Iterator[None]:
    """Turn a failure to write a file into this kind of error."""
    try:
        yield
    except FileExistsError:
        raise error(f"{path} exists already; choose another name.") from None
    except OSError as problem:
        text = f"{path}: cannot be written ({problem.strerror or problem}); choose another folder."
        raise error(text) from None


@contextmanager
def _new_file(path: Path, error: ErrorType, new_only: bool = False) -> Iterator[tuple[Path, Path]]:
    """Give the paths of a new file and of the one that it becomes; see `replacement`."""
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise error(f"{path}: is no regular file; give the name of a file.")
    prefix = os.fsdecode(b".%b." % os.fsencode(target.name)[:99])
    with _errors(path, error):
        if new_only and os.path.lexists(path):
            raise FileExistsError
        with tempfile.TemporaryDirectory(".tmp", prefix, target.parent) as inside:
            yield Path(inside) / path.name, target


def _to_disk(new: Path) -> None:
    """Wait until the disk has a file, so that a power failure after its move leaves no part."""
    with new.open("rb") as file:
        os.fsync(file.fileno())


def _move(new: Path, target: Path, new_only: bool = False) -> None:
    """Move a file that the disk has to its place."""
    if new_only:
        _move_to_free_name(new, target)
    else:
        with suppress(FileNotFoundError):
            new.chmod(stat.S_IMODE(target.stat().st_mode))
        new.replace(target)


def write_bytes(path: Path, data: bytes, error: ErrorType) -> None:
    """Write a file at once, as `replacement` does."""
    write_files({path: [data]}, error)


def write_text(path: Path, text: str, error: ErrorType) -> None:
    """Write a text file in UTF-8, as `write_bytes` does."""
    write_bytes(path, text.encode(), error)


def _move_to_free_name(new: Path, target: Path) -> None:
    """Move a file to a name that no file has, by operations that cannot replace one."""
    try:
        os.link(new, target)
    except FileExistsError:
        raise
    except OSError:  # This file system has no hard links.
        target.touch(exist_ok=False)
        try:
            new.replace(target)
        except OSError:
            target.unlink()
            raise


def _check_place(path: Path) -> None:
    if path.exists() and not path.is_file():
        what = "a folder" if path.is_dir() else "no regular file"
        raise OutputError(f"{path}: is {what}; give the name of a file.")
    target = Path(os.path.realpath(path))
    if not target.parent.is_dir():
        raise OutputError(f"{path}: cannot be written, as {target.parent} is no folder; create it.")
    # A new file replaces an old one, so its folder has to permit that, too.
    if not all(os.access(each, os.W_OK) for each in (target.parent, target) if each.exists()):
        raise OutputError(f"{path}: cannot be written (no permission); choose another folder.")


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
