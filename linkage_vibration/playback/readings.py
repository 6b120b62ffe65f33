# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the numbers of the hitch sensor in bags, before they become crank angles."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.scalar_reader import Integers, SkippedMessages
from linkage_vibration.bags.streams import open_bags
from linkage_vibration.playback.remapping import ReplayError, choose_topics, topic_schema
from linkage_vibration.prediction.inputs.presets import HITCH
from linkage_vibration.prediction.settings import Parameters


def read_numbers(
    bags: Sequence[Path], settings: Parameters, remaps: Mapping[str, str] = MappingProxyType({})
) -> tuple[Integers, NDArray[np.float64]]:
    """Return the log times, (n,), ns, ascending, and the numbers of the hitch input, (n,).

    A number is NaN where it is not available. A `ReplayError` with the names that exist is raised
    if the bags have no such number.
    """
    left_out, columns = SkippedMessages(), []
    with open_bags(list(bags)) as opened:
        topic = choose_topics(opened, settings, remaps)[HITCH]
        read = settings.crank_input(topic_schema(opened, topic))
        for block in opened.blocks([topic.name]):
            for numbers in read.numbers(block, np.arange(len(block)), left_out):
                columns.append((block.log_times[numbers.rows], numbers.value))
    if not columns:
        missing = read.reader.explain_missing(topic.name, sorted(left_out.names))
        fault = missing or left_out.fault or "it has no message"
        raise ReplayError(f"{', '.join(map(str, bags))}: {topic.name}: {fault}")
    times, values = map(np.concatenate, zip(*columns, strict=True))
    order = np.argsort(times, kind="stable")
    return times[order], values[order]
