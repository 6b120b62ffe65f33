# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses the topics of bags that replace the topics to which the node subscribes."""

from collections.abc import Mapping, Sequence

from linkage_vibration.bags.message_types import FLOAT64
from linkage_vibration.bags.streams import Bags, BagTopic
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import SPEEDS
from linkage_vibration.prediction.inputs import INPUTS
from linkage_vibration.prediction.settings import Parameters


class ReplayError(LinkageVibrationError):
    """A replay cannot be done as requested."""


def remappings(words: Sequence[str]) -> dict[str, str]:
    """Return the topics that ``NAME:=TOPIC`` words give to names.

    Raises
    ------
    ReplayError
        If a word has another form.

    Examples
    --------
    >>> remappings(["joint_states:=/arm/joint_states"])
    {'joint_states': '/arm/joint_states'}
    """
    for word in words:
        if ":=" not in word.strip(":="):
            raise ReplayError(f"--remap {word}: write NAME:=TOPIC.")
    return dict(word.split(":=", 1) for word in words)


def choose_topics(
    bags: Bags, settings: Parameters, remaps: Mapping[str, str]
) -> dict[str, BagTopic]:
    """Return the topics to read by the node's names of them; the input comes first.

    Parameters
    ----------
    bags : Bags
    settings : Parameters
        They choose the input, and may fix speeds.
    remaps : mapping of str to str
        The bags' names of the node's topics.

    Raises
    ------
    ReplayError
        If a remapping is unknown, or a topic is missing or ambiguous.
    """
    names = [*dict.fromkeys(kind.topic for kind in INPUTS.values()), *SPEEDS]
    unknown = sorted(set(remaps) - set(names))
    if unknown:
        raise ReplayError(
            f"--remap: the node has no topic {unknown[0]}; use one of: {', '.join(names)}."
        )
    chosen = INPUTS[settings.input]
    name, topic = chosen.topic, remaps.get(chosen.topic)
    if topic is None and chosen.unique_type:
        found = sorted({topic.name for topic in bags.topics if topic.type == chosen.type})
        if len(found) > 1:
            raise ReplayError(
                f"{bag_paths(bags)} has {len(found)} topics of type {chosen.type}; choose one, as "
                f"in `--remap {name}:={found[0]}`: {', '.join(found)}."
            )
        topic = found[0] if found else None
    topics = {name: _bag_topic(bags, topic or f"/{name}", chosen.type, name)}
    for name, source in SPEEDS.items():
        if settings.fixed_speed(source) is not None:
            continue
        wanted = remaps.get(name)
        # A log lists all topics of the node, even those without messages.
        if wanted or any(topic.name == f"/{name}" and topic.count for topic in bags.topics):
            topics[name] = _bag_topic(bags, wanted or f"/{name}", FLOAT64, name)
    return topics


def _bag_topic(bags: Bags, name: str, kind: str, remap: str) -> BagTopic:
    """Return a topic of the bags, which must have this type and messages."""
    found = [topic for topic in bags.topics if topic.name == name]
    listing = ", ".join(f"{topic.name} ({topic.type})" for topic in bags.topics)
    remedy = f"name the right one with `--remap {remap}:=TOPIC`"
    if not found:
        raise ReplayError(
            f"{bag_paths(bags)} has no topic {name} of type {kind}; "
            + (f"its topics are: {listing}; {remedy}." if listing else "it has no topics at all.")
        )
    if [topic.type for topic in found] != [kind]:
        types = " and ".join(topic.type for topic in found)
        raise ReplayError(f"Topic {name} of {bag_paths(bags)} holds {types}, not {kind}; {remedy}.")
    if not found[0].count:
        raise ReplayError(f"Topic {name} of {bag_paths(bags)} has no messages; {remedy}.")
    return found[0]


def bag_paths(bags: Bags) -> str:
    """Return the paths of the bags, for messages."""
    return ", ".join(map(str, bags.paths))
