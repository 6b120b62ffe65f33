# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the inputs of bags, and judges them as the node does."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from linkage_vibration.bags.blocks import Block
from linkage_vibration.bags.scalar_reader import Integers, SkippedMessages
from linkage_vibration.bags.streams import Bags, BagTopic, open_bags
from linkage_vibration.messages.columns import MessageColumns
from linkage_vibration.playback.remapping import ReplayError, choose_topics, topic_schema
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs.presets import HITCH
from linkage_vibration.prediction.inputs.units import ANGLES
from linkage_vibration.prediction.judge import InputFault, InputJudge
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.table.interpolation import angles_in_table

SpeedRow: TypeAlias = tuple[int, Source, float, int]  # row, speed, value, time (ns)


class JudgedInputs:
    """The crank angle and the speeds of bags, which are judged by a range of angles, rad."""

    def __init__(
        self,
        bags: Bags,
        settings: Parameters,
        topics: Mapping[str, BagTopic],
        names: Sequence[str],
        alpha3_range: tuple[float, float],
    ) -> None:
        self.crank = settings.crank_input(topic_schema(bags, topics[HITCH]))
        self.speeds = {
            source: settings.speed_input(source, topic_schema(bags, topics[source.value]))
            for source in Source
            if source.value in topics
        }
        self._names = {name: topic.name for name, topic in topics.items()}
        self._places = {name: names.index(topic) for name, topic in self._names.items()}
        self._range, scale = alpha3_range, self.crank.scale
        self.judge = InputJudge(
            self.crank.describe(self._names[HITCH]),
            alpha3_range,
            offset=scale.offset * ANGLES.get(scale.unit, math.nan),
            stale_after=settings.stale_after,
        )

    def read(
        self, block: Block, left_out: SkippedMessages
    ) -> tuple[MessageColumns, list[SpeedRow]]:
        """Return the readings of a block, and its speeds by rows."""
        rows = np.flatnonzero(block.topics == self._places[HITCH])
        readings = self.crank.read_block(block, rows, left_out)
        others, names = left_out.others, left_out.names.copy()
        heard = list[tuple[SpeedRow, int, str]]()  # with the time of receipt, ns, and the sender
        for source, each in self.speeds.items():
            rows = np.flatnonzero(block.topics == self._places[source.value])
            for of_topic, values, times, senders in each.read_block(block, rows, left_out):
                numbers = of_topic, values, times, block.log_times[of_topic]
                columns = *(column.tolist() for column in numbers), senders
                for row, value, time, received, sender in zip(*columns, strict=True):
                    heard.append(((row, source, value, time), received, sender))
        left_out.others, left_out.names = others, names  # those beside the crank angle
        angles = readings.crank_angle
        known = np.isnan(angles_in_table(angles, self._range)) == np.isnan(angles)
        moments = block.log_times[readings.in_block], readings.stamp
        of_each = *moments, angles, readings.velocity, known, readings.sender
        lists = [column.tolist() for column in of_each]
        # In the order of arrival, so that a speed that stops is found when it does.
        heard.sort(key=lambda each: each[0][0])
        speeds, first = [speed for speed, *_ in heard], 0
        before = np.searchsorted(readings.in_block, [speed[0] for speed in speeds]).tolist()
        for last, ((_, source, value, time), received, sender) in zip(before, heard, strict=True):
            if first < last:
                self.judge.readings(*(column[first:last] for column in lists))
            first, about = last, (self._names[source.value], sender, 1e-9 * (received - time))
            self.judge.speed(source, received, value, *about)
        self.judge.readings(*(column[first:] for column in lists))
        return readings, speeds


def recorded_faults(
    log: Path, settings: Parameters, alpha3_range: tuple[float, float]
) -> list[InputFault]:
    """Return the faults of the inputs in a log of the node, as a replay of it finds them."""
    with open_bags([log]) as bags:
        inputs = [settings.source(HITCH), *settings.speed_sources().values()]
        remaps = dict[str, str]()  # The node may have a namespace.
        for topic in {each.topic for each in inputs}:
            ends = f"/{topic.lstrip('~/')}"
            named = [each.name for each in bags.topics if each.count and each.name.endswith(ends)]
            remaps |= {topic: named[0]} if len(named) == 1 else {}
        topics = choose_topics(bags, settings, remaps)
        names = list(dict.fromkeys(topic.name for topic in topics.values()))
        read = JudgedInputs(bags, settings, topics, names, alpha3_range)
        blocks = bags.blocks(names, bags.is_own_log)
        if not sum(len(read.read(block, SkippedMessages())[0]) for block in blocks):
            raise ReplayError(f"{log} has no reading of {read.crank.describe(names[0])}.")
        return read.judge.faults()


def read_numbers(
    bags: Sequence[Path], settings: Parameters, remaps: Mapping[str, str] = MappingProxyType({})
) -> tuple[Integers, NDArray[np.float64]]:
    """Return log times, (n,), ns, ascending, and numbers of the hitch, (n,), NaN for none."""
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
