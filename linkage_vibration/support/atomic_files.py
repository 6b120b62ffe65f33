# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writes files so that no reader ever finds half of one."""

import os
from pathlib import Path

from linkage_vibration.errors import LinkageVibrationError


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
