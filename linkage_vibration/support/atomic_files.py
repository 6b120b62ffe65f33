# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes files so that no reader ever finds half of one."""

import os
from pathlib import Path

from linkage_vibration.errors import LinkageVibrationError


def check_output(path: Path, error: type[LinkageVibrationError]) -> None:
    """Refuse a path that cannot be written, before the work begins whose result goes there.

    Parameters
    ----------
    path, error : Path, type
        The file to write, and the exception to raise if it cannot be written.
    """
    if path.is_dir():
        raise error(f"{path}: is a folder; give the name of a file.")
    if not path.parent.is_dir():
        raise error(f"{path}: cannot be written, as {path.parent} is no folder; create it.")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise error(f"{path}: cannot be written (no permission); choose another folder.")


def write_bytes(path: Path, data: bytes, error: type[LinkageVibrationError]) -> None:
    """Write a temporary file in the same folder and rename it.

    Parameters
    ----------
    path, data : Path, bytes
        The file to write, which is replaced if it exists, and its content.
    error : type
        The exception to raise if it cannot be written.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        beside.write_bytes(data)
        beside.replace(path)
    except OSError as problem:
        beside.unlink(missing_ok=True)
        raise error(
            f"{path}: cannot be written ({problem.strerror}); choose another folder."
        ) from None


def write_text(path: Path, text: str, error: type[LinkageVibrationError]) -> None:
    """Write a text file in UTF-8, as `write_bytes` does.

    Parameters
    ----------
    path, text, error : Path, str, type
        The file, its content, and the exception to raise if it cannot be written.
    """
    write_bytes(path, text.encode(), error)
