# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Layouts of the MCAP records that are read and written as arrays, which mcap does not offer."""

import struct

import numpy as np

MAGIC = b"\x89MCAP0\r\n"  # at the beginning and at the end of a file
RECORD = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time; then the data
MESSAGE_HEAD = struct.Struct("<BQHIQQ")  # both of them
# First and last log time, size, CRC, length of the name of the compression.
CHUNK = struct.Struct("<QQQII")
MESSAGE_INDEX = struct.Struct("<HI")  # channel, bytes of entries
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
