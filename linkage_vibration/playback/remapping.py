# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses the topics of bags that replace the topics to which the node subscribes."""

from collections.abc import Mapping, Sequence

from linkage_vibration.bags.schemas import Schema, schema_of_text
from linkage_vibration.bags.streams import Bags, BagTopic
from linkage_vibration.bags.writing import Topic, offered_qos_profiles
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.definitions import DefinitionError, message_definition
from linkage_vibration.messages.topics import log_topic
from linkage_vibration.prediction.inputs.presets import HITCH, INPUT_TOPICS, PLAIN_TYPES
from linkage_vibration.prediction.inputs.sources import SourceSettings
from linkage_vibration.prediction.settings import NODE_NAME, Parameters


class ReplayError(LinkageVibrationError):
    """A replay cannot be done as requested."""


def remappings(words: Sequence[str]) -> dict[str, str]:
    """Return the topics of ``NAME:=TOPIC`` words by names, or raise a ReplayError.

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
    """Return the topics to read by the inputs, of which the hitch comes first."""
    speeds = settings.speed_sources()
    sources = {HITCH: settings.source(HITCH)}
    sources |= {s.value: source for s, source in speeds.items() if settings.fixed_speed(s) is None}
    names = dict.fromkeys([each.topic for each in (*sources.values(), *speeds.values())])
    names |= dict.fromkeys(each.name for each in INPUT_TOPICS)
    unknown = sorted(set(remaps) - set(names))
    if unknown:
        problem = f"--remap: the node has no topic {unknown[0]}; use one of: {', '.join(names)}."
        raise ReplayError(problem)
    topics: dict[str, BagTopic] = {}
    for name, source in sources.items():
        topic = remaps.get(source.topic) or _only_topic(bags, source)
        full = full_name(source.topic)
        # A log lists all topics of the node, even those without messages.
        there = any(each.name == full and each.count for each in bags.topics)
        if name == HITCH or topic or there or source.chosen:
            topics[name] = _bag_topic(bags, topic or full, source.type, source.topic)
    return topics


def full_name(topic: str) -> str:
    """Return the name of a topic of a node that has its default name."""
    if topic.startswith("~/"):
        return f"/{NODE_NAME}/{topic[2:]}"
    return topic if topic.startswith("/") else f"/{topic}"


def _only_topic(bags: Bags, source: SourceSettings) -> str | None:
    """Return the only topic that has the type of a source, unless a parameter names the topic."""
    if source.chosen or source.type in PLAIN_TYPES:
        return None
    alike = sorted({each.name for each in bags.topics if each.type == source.type})
    if len(alike) > 1:
        problem = f"{bag_paths(bags)} has {len(alike)} topics of type {source.type}"
        hint = f"choose one, as in `--remap {source.topic}:={alike[0]}`: {', '.join(alike)}"
        raise ReplayError(f"{problem}; {hint}.")
    return alike[0] if alike else None


def topic_schema(bags: Bags, topic: BagTopic) -> Schema:
    """Return the fields of a topic's messages, as the bags or an installed package define them."""
    defined = bags.defined(topic.name)
    if defined is not None:
        return defined[2]
    try:
        return schema_of_text(message_definition(topic.type), topic.type)
    except DefinitionError as error:
        problem = f"{bag_paths(bags)} does not define the type of topic {topic.name}. {error}"
        raise ReplayError(problem) from None


def logged_topic(bags: Bags, topic: BagTopic) -> Topic:
    """Return what a log stores about a topic of bags."""
    defined = bags.defined(topic.name)
    try:
        standard = log_topic(topic.name, topic.type)
    except DefinitionError:
        if defined is None:
            raise
    else:
        if defined is None or standard.type_hash == defined[1]:
            return standard
    text, type_hash, _ = defined
    return Topic(topic.name, topic.type, text, type_hash, offered_qos_profiles())


def _bag_topic(bags: Bags, name: str, kind: str, remap: str) -> BagTopic:
    """Return a topic of the bags, which must have this type and messages."""
    named = [topic for topic in bags.topics if topic.name == name]
    listing = ", ".join(f"{topic.name} ({topic.type})" for topic in bags.topics)
    remedy = f"name the right one with `--remap {remap}:=TOPIC`"
    if not named:
        topics = f"its topics are: {listing}; {remedy}" if listing else "it has no topics at all"
        raise ReplayError(f"{bag_paths(bags)} has no topic {name} of type {kind}; {topics}.")
    if [topic.type for topic in named] != [kind]:
        types = " and ".join(topic.type for topic in named)
        raise ReplayError(f"Topic {name} of {bag_paths(bags)} holds {types}, not {kind}; {remedy}.")
    if not named[0].count:
        raise ReplayError(f"Topic {name} of {bag_paths(bags)} has no messages; {remedy}.")
    return named[0]


def bag_paths(bags: Bags) -> str:
    """Return the paths of the bags, for messages."""
    return ", ".join(map(str, bags.paths))
