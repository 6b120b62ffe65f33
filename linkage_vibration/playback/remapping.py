# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Which topics of bags stand for those that the node hears."""

from collections.abc import Mapping, Sequence

from linkage_vibration.bags.message_types import FLOAT64, JOINT_STATE
from linkage_vibration.bags.streams import Bags, BagTopic
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import HITCH_POSITION, JOINT_STATES, SPEEDS
from linkage_vibration.prediction.settings import PERCENT, Parameters


class ReplayError(LinkageVibrationError):
    """A replay cannot be done as asked."""


def remappings(words: Sequence[str]) -> dict[str, str]:
    """Return what ``NAME:=TOPIC`` words mean.

    Raises
    ------
    ReplayError
        If a word is none.

    Examples
    --------
    >>> remappings(["joint_states:=/arm/joint_states"])
    {'joint_states': '/arm/joint_states'}
    """
    for word in words:
        if ":=" not in word.strip(":="):
            raise ReplayError(f"--remap {word}: write NAME:=TOPIC.")
    return {name: topic for name, topic in (word.split(":=", 1) for word in words)}


def choose_topics(
    bags: Bags, settings: Parameters, remaps: Mapping[str, str]
) -> dict[str, BagTopic]:
    """Return the topics to read by the node's names of them, that of the hitch first."""
    unknown = set(remaps) - {JOINT_STATES, HITCH_POSITION, *SPEEDS}
    if unknown:
        raise ReplayError(
            f"--remap: {sorted(unknown)[0]} is none of {JOINT_STATES}, {HITCH_POSITION}, "
            f"{', '.join(SPEEDS)}."
        )
    percent = settings.input == PERCENT
    hitch, kind = (HITCH_POSITION, FLOAT64) if percent else (JOINT_STATES, JOINT_STATE)
    chosen = remaps.get(hitch)
    if chosen is None and kind == JOINT_STATE:
        named = sorted({topic.name for topic in bags.topics if topic.type == JOINT_STATE})
        if len(named) > 1:
            raise ReplayError(
                f"{told(bags)} has joint states on {len(named)} topics; choose one, as in "
                f"`--remap {JOINT_STATES}:={named[0]}`: {', '.join(named)}."
            )
        chosen = named[0] if named else None
    topics = {hitch: _bag_topic(bags, chosen or f"/{hitch}", kind, hitch)}
    for name, source in SPEEDS.items():
        if settings.fixed_speed(source) is not None:
            continue
        wanted = remaps.get(name)
        # A log has the node's topics, whether anything was sent on them or not.
        if wanted or any(topic.name == f"/{name}" and topic.count for topic in bags.topics):
            topics[name] = _bag_topic(bags, wanted or f"/{name}", FLOAT64, name)
    return topics


def _bag_topic(bags: Bags, name: str, kind: str, meant: str) -> BagTopic:
    """Return a topic of the bags, which has to be of a type."""
    found = [topic for topic in bags.topics if topic.name == name]
    listing = ", ".join(f"{topic.name} ({topic.type})" for topic in bags.topics)
    remedy = f"name the right one with `--remap {meant}:=TOPIC`"
    if not found:
        raise ReplayError(
            f"{told(bags)} has no topic {name} of {kind}; it has {listing or 'no topics at all'}"
            + (f"; {remedy}." if listing else ".")
        )
    if [topic.type for topic in found] != [kind]:
        types = " and ".join(topic.type for topic in found)
        raise ReplayError(f"Topic {name} of {told(bags)} holds {types}, not {kind}; {remedy}.")
    if not found[0].count:
        raise ReplayError(f"Topic {name} of {told(bags)} has no messages; {remedy}.")
    return found[0]


def told(bags: Bags) -> str:
    """Return the bags' paths in words."""
    return ", ".join(map(str, bags.paths))
