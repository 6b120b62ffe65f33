# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Opens bags: ROS 1 ``.bag``, ROS 2 ``.db3``, ``.mcap`` and folders, and logs of a CAN bus.

Every failure is a `BagError`.
"""

import re
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from shlex import quote
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeAlias

import yaml
import zstandard

from linkage_vibration.bags.can_logs import (
    SUFFIXES,
    CanLog,
    CanLogError,
    can_log_suffix,
    read_can_log,
)
from linkage_vibration.bags.mcap_bag import McapBag, read_mcap
from linkage_vibration.bags.mcap_records import MAGIC
from linkage_vibration.bags.recovery import JoinedError, repair
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.atomic_files import read_text, refuse_pipe
from linkage_vibration.support.missing_library import needed
from linkage_vibration.support.progress import read_with_bar
from linkage_vibration.support.resources import command
from linkage_vibration.support.strict_yaml import refuse_unbounded
from linkage_vibration.support.version import check_versions

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    BagReader: TypeAlias = Reader1 | Reader2 | McapBag | CanLog

# By suffix: the first bytes of a bag, and of each file whose end another one may follow.
_MAGIC = {".bag": b"#ROSBAG V2.0", ".mcap": MAGIC, ".db3": b"SQLite format 3\0"}
_ENDS = {".bag": _MAGIC[".bag"], ".db3": _MAGIC[".db3"], ".blf": b"LOGG"}
_BAG_HEADER = 4096  # bytes of the first record of a bag of ROS 1, which is padded
_BESIDE = ("-wal", "-journal")  # ends of the names of files that SQLite has not merged yet


class BagError(LinkageVibrationError):
    """A bag cannot be read, or lacks the requested topic."""


@dataclass(frozen=True, slots=True)
class BagFile:
    """A file of a bag that is open."""

    path: Path  # as errors name it
    reader: "BagReader"


def open_files(path: Path, stack: ExitStack) -> Iterator[BagFile]:
    """Open the files of a bag, which the stack closes, or raise a `BagError`."""
    check_versions("rosbags")
    with needed("bags", "Reading bags needs rosbags", BagError):
        import rosbags.interfaces  # noqa: F401
    with bag_errors(path):
        files = _files(path)
    for each in files:
        with bag_errors(each):
            kind, file = _kind(each), _readable(each, stack)
            _check_start(each, file, kind)
            reader: Any = None
            if kind == ".mcap":
                reader = read_mcap(file, stack)
            elif kind in (".bag", ".db3"):
                # Their imports take a tenth of the time of a short replay.
                rosbag = import_module(f"rosbags.rosbag{1 if kind == '.bag' else 2}")
                reader = stack.enter_context(rosbag.Reader(file))
            _check_end(file, kind, reader)
            reader = reader or read_can_log(file)
        yield BagFile(each, reader)


def mcap_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag; none if it has another format."""
    return [file for file in _files(path) if file.suffix == ".mcap"]


def _files(path: Path) -> list[Path]:
    """Return the files of a bag: those in a list of metadata.yaml or, without it, of a folder."""
    if not path.is_dir():
        return [path]
    inside = sorted(path.iterdir(), key=lambda file: (len(file.name), file.name))
    files = [file for file in inside if _suffix(file) in _MAGIC]
    with suppress(Exception):  # a file that is damaged lists nothing
        text = read_text(path / "metadata.yaml")
        root: Any = yaml.compose(text, yaml.SafeLoader)
        refuse_unbounded(root)
        about = yaml.safe_load(text)["rosbag2_bagfile_information"]
        files = [path / Path(name).name for name in about["relative_file_paths"]] or files
    if not files:
        raise BagError(f"Folder {path} has no file of a bag; give another folder, or a file.")
    return files


def _readable(path: Path, stack: ExitStack) -> Path:
    """Return a file that can be read: a copy if it is compressed, or if a part is beside it."""
    beside = [path.with_name(path.name + end) for end in _BESIDE if path.suffix == ".db3"]
    beside = [each for each in beside if each.is_file() and each.stat().st_size]
    if not (beside or path.suffix == ".zstd"):
        return path
    copy = Path(stack.enter_context(TemporaryDirectory()), path.name.removesuffix(".zstd"))
    for each in (path, *beside):
        name = each.name.removesuffix(".zstd")
        with read_with_bar(each) as source, copy.with_name(name).open("wb") as target:
            if name == each.name:
                shutil.copyfileobj(source, target)
                continue
            frame = zstandard.ZstdDecompressor().decompressobj()
            for block in iter(partial(source.read, 2**20), b""):
                target.write(frame.decompress(block))
            if not frame.eof or frame.unused_data:
                raise ValueError("it is not one whole frame of zstd")
    if beside:
        with closing(sqlite3.connect(copy)) as database:
            database.execute("PRAGMA journal_mode=DELETE")
    return copy


def _suffix(path: Path) -> str:
    """Return the suffix that tells the format of a file."""
    name = path.name.removesuffix(".zstd").removesuffix(".active")
    return can_log_suffix(path) or Path(name).suffix


def _kind(path: Path) -> str:
    """Return the suffix of a bag file; check that it is one."""
    if not path.exists():
        raise BagError(f"There is no bag {path}; check the path.")
    suffix = _suffix(path)
    if suffix not in (*_MAGIC, *SUFFIXES):
        problem = f"{path} is not a bag"
        hint = f"give a .bag, .mcap or .db3 file, or a log of a CAN bus ({', '.join(SUFFIXES)})"
        raise BagError(f"{problem}; {hint}.")
    refuse_pipe(path)
    return suffix


def _check_start(path: Path, file: Path, kind: str) -> None:
    """Check that a file begins as its format does."""
    magic = _MAGIC.get(kind, b"")
    with file.open("rb") as opened:
        start = opened.read(len(magic) or 1)
    if not start:
        raise BagError(f"{path} is empty, as its recording ended before anything was written.")
    if not start.startswith(magic) and magic:
        raise BagError(f"{path} does not begin like a {kind} file; give a bag, or {_remedy(path)}.")


def _check_end(file: Path, kind: str, reader: Any) -> None:
    """Check that no other file follows where a bag of ROS 1, a database or a BLF log ends."""
    with file.open("rb") as opened:
        head, magic = opened.read(_BAG_HEADER), _ENDS.get(kind, b"")
        end = int.from_bytes(head[16:24], "little")  # of a BLF log
        if kind == ".db3":  # 65536 is stored as 1
            page = (int.from_bytes(head[16:18], "big") & ~1) or 2**16
            end = page * int.from_bytes(head[28:32], "big")
        elif kind == ".bag":
            [index] = re.findall(rb"index_pos=(.{8})", head, re.DOTALL)
            reader.bio.seek(int.from_bytes(index, "little"))
            for _ in reader.connections:
                reader.read_connection()
            for _ in reader.chunk_infos:
                reader.read_chunk_info()
            end = reader.bio.tell()
        if magic and 0 < end < file.stat().st_size:
            opened.seek(end)
            if opened.read(len(magic)) == magic:
                raise JoinedError(file, end)


@contextmanager
def bag_errors(path: Path) -> Iterator[None]:
    """Turn every failure of reading a bag into a `BagError`."""
    try:
        yield
    except CanLogError as error:
        raise BagError(f"{path} {error}") from None
    except JoinedError as error:
        raise BagError(f"{path}: {error}.") from None
    except (LinkageVibrationError, ImportError):
        raise
    except OSError as error:
        problem = f"{path} cannot be opened: {error.strerror or error}"
        raise BagError(f"{problem}; check it and its permissions.") from None
    # A damaged file makes rosbags raise errors of its own, of struct, SQLite, zstd and others.
    except Exception as error:
        text = " ".join(str(error).split()) or type(error).__name__
        raise BagError(f"{path} is damaged or incomplete ({text}); {_remedy(path)}.") from error


def _remedy(path: Path) -> str:
    """Return what saves the rest of an incomplete file, as a part of a sentence."""
    if _suffix(path) == ".mcap":
        return f"try `{command('recover')} {quote(str(path))}`"
    return repair(path) or "convert it again, or read it with the tool that wrote it"
