# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Opens bags: ROS 1 ``.bag``, ROS 2 ``.db3``, ``.mcap`` and folders, and logs of a CAN bus.

Every failure is a `BagError`.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import yaml

from linkage_vibration.bags.can_logs import (
    SUFFIXES,
    CanLog,
    CanLogError,
    can_log_suffix,
    read_can_log,
)
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.support.atomic_files import refuse_pipe
from linkage_vibration.support.commands import command
from linkage_vibration.support.version import check_versions
from linkage_vibration.support.yaml_size import refuse_unbounded

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    BagReader: TypeAlias = Reader1 | Reader2 | CanLog

# By suffix (a folder has none): the first bytes of a file, and what repairs an incomplete one.
_MAGIC = {".bag": b"#ROSBAG V2.0", ".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0"}
_MAGIC |= dict.fromkeys(SUFFIXES, b"")
_REPAIR = {
    ".bag": "`rosbag reindex`",
    ".mcap": "`{recover}`",
    ".db3": "`ros2 bag reindex` on its folder",
    "": "`ros2 bag reindex`",
}


class BagError(LinkageVibrationError):
    """A bag cannot be read, or lacks the requested topic."""


def bag_reader(path: Path) -> "BagReader":
    """Return a reader of a bag, to be opened inside of `bag_errors`."""
    check_versions("rosbags")
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    except ImportError:
        raise BagError(
            "Reading bags needs rosbags; run `pip install linkage_vibration[bags]`."
        ) from None
    kind = _kind(path)
    if kind in SUFFIXES:
        return read_can_log(path)
    return Reader1(path) if kind == ".bag" else Reader2(path)


def mcap_files(path: Path) -> list[Path]:
    """Return the MCAP files of a bag; none if it has another format or is compressed by rosbag2."""
    if path.is_file():
        return [path] if path.suffix == ".mcap" else []
    text = (path / "metadata.yaml").read_text(encoding="utf-8")
    about = yaml.safe_load(text)["rosbag2_bagfile_information"]
    plain = about.get("compression_mode", "").lower() in ("", "none")
    if about["storage_identifier"] != "mcap" or not plain:
        return []
    return [path / Path(name).name for name in about["relative_file_paths"]]


@contextmanager
def bag_errors(path: Path) -> Iterator[None]:
    """Turn every failure of reading a bag into a `BagError`."""
    try:
        yield
    except CanLogError as error:
        raise BagError(f"{path} {error}") from None
    except (LinkageVibrationError, ImportError):
        raise
    except OSError as error:
        raise BagError(
            f"{path} cannot be opened: {error.strerror or error}; check it and its permissions."
        ) from None
    # A damaged file makes rosbags raise errors of its own, of struct, SQLite, zstd and others.
    except Exception as error:
        if foreign := _foreign(path):
            raise BagError(f"{path} {foreign}") from error
        text = " ".join(str(error).split()) or type(error).__name__
        if can_log_suffix(path):
            remedy = "convert it again, or read what is left of it with the tool that wrote it"
            raise BagError(f"{path} is damaged or incomplete ({text}); {remedy}.") from error
        repair = _REPAIR["" if path.is_dir() else path.suffix].format(recover=command("recover"))
        raise BagError(f"{path} is damaged or incomplete ({text}); try {repair}.") from error


def _foreign(path: Path) -> str:
    """Return why an MCAP file with a summary cannot be read; empty for any other file."""
    from mcap.reader import make_reader

    summary = None
    # A damaged file, or another one, makes mcap raise errors of its own, of struct and others.
    with suppress(Exception), path.open("rb") as file:
        summary = make_reader(file).get_summary() if path.suffix == ".mcap" else None
    if summary is None:
        return ""
    others = {chunk.compression for chunk in summary.chunk_indexes} - {"", "lz4", "zstd"}
    if others:
        return (
            f"is compressed with {', '.join(sorted(others))}, which no reader here knows; compress "
            "it with zstd or lz4, such as with `mcap compress`."
        )
    if summary.chunk_indexes and not summary.channels:
        return (
            "is a valid MCAP file whose summary does not repeat its channels; add them with "
            f"`{command('recover')}`."
        )
    for channel in summary.channels.values():
        schema = summary.schemas.get(channel.schema_id)
        for encoding in (channel.message_encoding, schema.encoding if schema else ""):
            if encoding not in ("cdr", "ros2msg", "ros2idl"):
                return (
                    f"holds messages that are not of ROS 2: {channel.topic} has the encoding "
                    f"{encoding or 'none'}; write a file with the messages of ROS 2 only, such as "
                    "with `mcap filter`."
                )
    return ""


def _kind(path: Path) -> str:
    """Return the suffix of a bag file, or an empty one for a folder; check that it is a bag."""
    if not path.exists():
        raise BagError(f"There is no bag {path}; check the path.")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            raise BagError(
                f"Folder {path} has no metadata.yaml; give a file of the bag, or create "
                "metadata.yaml with `ros2 bag reindex`."
            )
        for each in path.iterdir():
            refuse_pipe(each)
        try:
            root = yaml.compose((path / "metadata.yaml").read_text("utf-8"), yaml.SafeLoader)
            if root is not None:
                refuse_unbounded(root)
        except (ValueError, RecursionError, yaml.YAMLError) as error:
            text = " ".join(str(error).split())
            raise BagError(
                f"{path}/metadata.yaml is damaged ({text}); try {_REPAIR['']}."
            ) from None
        return ""
    suffix = can_log_suffix(path) or path.suffix
    if suffix not in _MAGIC:
        raise BagError(
            f"{path} is not a bag; give a .bag, .mcap or .db3 file, or a log of a CAN bus "
            f"({', '.join(SUFFIXES)})."
        )
    refuse_pipe(path)
    magic = _MAGIC[suffix]
    with path.open("rb") as file:
        start = file.read(len(magic) or 1)
    if not start:
        raise BagError(f"{path} is empty, as its recording ended before anything was written.")
    if magic and not magic.startswith(start):
        raise BagError(
            f"{path} does not begin like a {suffix} file; give a bag, or try "
            f"{_REPAIR[suffix].format(recover=command('recover'))}."
        )
    return suffix
