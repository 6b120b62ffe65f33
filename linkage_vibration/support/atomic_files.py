# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Writing files so that nobody ever finds half of one."""

import os
from pathlib import Path

from linkage_vibration.errors import LinkageVibrationError


def write_bytes(path: Path, data: bytes, error: type[LinkageVibrationError]) -> None:
    """Write a file beside its place and rename it.

    Parameters
    ----------
    path : Path
        Where it is to be; replaced when it exists.
    data : bytes
        Its content.
    error : type
        What to raise if it cannot be written.
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
    """Write text in UTF-8 beside its place and rename it; as `write_bytes`."""
    write_bytes(path, text.encode(), error)
