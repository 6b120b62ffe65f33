# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Messages that wait for the node: when they were received, and which newer ones replace."""

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from linkage_vibration.bags.scalar_reader import CdrError, ReadingError
from linkage_vibration.prediction.inputs.sources import InputReader
from linkage_vibration.ros.endpoints import MessageInfo
from linkage_vibration.ros.live_inputs import LiveTopic

LONGEST_WAIT = 0.05  # s until its answer, after which a message is left out for newer ones
_DAY = 86_400 * 10**9  # ns; an earlier time of receipt is by another clock, or before it was set


class Arrival(NamedTuple):
    """A message of an input that has arrived."""

    topic: LiveTopic
    data: bytes
    info: MessageInfo
    received: int  # by the wall clock, ns
    wait: float  # s, since then


def arrival(topic: LiveTopic, data: bytes, info: MessageInfo) -> Arrival:
    """Return a message with its time of receipt: now, if the middleware's is not plausible."""
    now, received = time.time_ns(), info["received_timestamp"]
    if not now - _DAY < received <= now:
        received = now
    return Arrival(topic, data, info, received, 1e-9 * (now - received))


def waiting(topic: LiveTopic, subscription: Any) -> Iterator[Arrival]:
    """Take all messages from the queue of a subscription; its executor then finds nothing there."""
    while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
        yield arrival(topic, *taken)


def in_time(
    messages: Sequence[Arrival], answering: float, left_out: Counter[str]
) -> Iterator[Arrival]:
    """Yield messages; count late ones by topic, which are left out if newer ones replace them."""
    if len(messages) < 2:
        yield from messages
        return
    began, found, replaced = time.monotonic(), set[InputReader](), list[bool]()
    for message in reversed(messages):
        inputs = message.topic.numbers
        # Once newer messages have all numbers, the older ones are not even read.
        held = inputs if inputs <= found else {i for i in inputs if _holds(message, i)}
        replaced.append(bool(held) and held <= found)
        found |= held
    for message, newer in zip(messages, reversed(replaced), strict=True):
        if newer and message.wait + time.monotonic() - began + answering > LONGEST_WAIT:
            left_out[message.topic.name] += 1
        else:
            yield message


def _holds(message: Arrival, source: InputReader) -> bool:
    with suppress(CdrError, ReadingError):
        return source.reader.read_one(message.data) is not None
    return False
