# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP records that are read and written as arrays, which mcap does not offer."""

import struct
from collections.abc import Iterator

import numpy as np

MAGIC = b"\x89MCAP0\r\n"  # at the beginning and at the end of a file
RECORD = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; then the data
MESSAGE_HEAD = struct.Struct("<BQHIQQ")  # both of them
# First and last log time, size, CRC, length of the name of the compression.
CHUNK = struct.Struct("<QQQII")
FOOTER = struct.Struct("<QQI")  # begins of the summary and of its offsets, CRC
MESSAGE_INDEX = struct.Struct("<HI")  # channel, bytes of entries
LONGEST_RECORD = 2**28  # a greater length counts as damaged, so that memory is bounded
MESSAGE_RECORD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""`MESSAGE_HEAD` for arrays."""


def split_records(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, begin and end of the content of each record, up to an incomplete one."""
    offset, size, head, unpack = 0, len(content), RECORD.size, RECORD.unpack_from
    while offset + head <= size:
        opcode, length = unpack(content, offset)
        start = offset + head
        offset = start + length
        if offset > size:
            return
        yield opcode, start, offset
