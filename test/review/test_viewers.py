# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The times of logs and tables are where viewers look for them."""

import csv
import io
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from linkage_vibration.review.log import csv_text, read_log
from test.review.conftest import START


def test_times_that_viewers_need(write_log: Any, tmp_path: Path) -> None:
    """Foxglove and PlotJuggler need log times in ns since 1970 and stamps of a known type.

    mcap reads them; PlotJuggler takes the integers of a CSV column for such times from 1.4e18 on.
    """
    path = write_log(tmp_path / "log.mcap", [0.0, 0.5, 1.0], [2.0, 2.1, 2.2])
    stamps = []
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            if channel.topic.endswith("_speed"):  # Float64 has no header.
                continue
            time = schema.data.decode().split("MSG: builtin_interfaces/Time\n")[1]
            lines = [line.partition("#")[0].split() for line in time.split("=====")[0].split("\n")]
            assert [line for line in lines if line] == [["int32", "sec"], ["uint32", "nanosec"]]
            stamp = decoded.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == message.log_time
            if channel.topic.endswith("/prediction"):
                stamps.append(message.log_time)
    assert stamps == [START + step for step in (0, 5 * 10**8, 10**9)]
    rows = list(csv.DictReader(io.StringIO(csv_text(read_log(path)))))
    assert [row["stamp_ns"] for row in rows] == [str(stamp) for stamp in stamps]
    assert all(1.4e18 < stamp < 2e18 for stamp in stamps)
