# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The inputs of a running node, by topics, with the types of the installed packages."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from linkage_vibration.bags.schemas import Schema, SchemaField, schema_by
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import OUTPUT_TOPICS
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs.presets import HITCH
from linkage_vibration.prediction.inputs.sources import (
    CrankInput,
    InputReader,
    SourceSettings,
    SpeedInput,
)
from linkage_vibration.prediction.settings import ParameterError, Parameters
from linkage_vibration.readers.sensors import Sensor, SensorReader
from linkage_vibration.ros.endpoints import message_class

# As rosidl describes a field: `double`, `sequence<std_msgs/Header, 3>`, `string<10>[2]`.
_TYPE = re.compile(r"(sequence<)?([\w/]+)(?:<\d+>)?(?:, \d+)?>?(?:\[(\d+)\])?")
_PLAIN = {"double": "float64", "float": "float32", "boolean": "bool"}


@dataclass(slots=True, eq=False)
class LiveTopic:
    """A topic by its absolute name, and the inputs that read it."""

    name: str
    type: str
    crank: CrankInput | None = None
    speeds: list[tuple[Source, SpeedInput]] = field(default_factory=list)
    sensors: list[tuple[int, SensorReader]] = field(default_factory=list)  # by place

    @property
    def numbers(self) -> set[InputReader]:
        """The inputs of which the newest number is enough; none beside sensors, which need all."""
        inputs = self.crank, *(speed for _, speed in self.speeds)
        return {each for each in inputs if each is not None and not self.sensors}


def live_topics(
    settings: Parameters, resolve: Callable[[str], str], sensors: Sequence[Sensor] = ()
) -> dict[str, LiveTopic]:
    """Return the topics of the inputs by absolute names, which ``resolve`` returns; hitch first."""
    topics: dict[str, LiveTopic] = {}

    def topic_of(source: SourceSettings | Sensor) -> LiveTopic:
        name = resolve(source.topic)
        topic = topics.setdefault(name, LiveTopic(name, source.type))
        if topic.type != source.type:
            raise ParameterError(
                f"{_type_words(source)}: topic {name} is read as {source.type} and as "
                f"{topic.type}; give one type, or another topic."
            )
        return topic

    source = settings.source(HITCH)
    topic = topic_of(source)
    topic.crank = settings.crank_input(_schema(source))
    for speed, source in settings.speed_sources().items():
        topic = topic_of(source)
        topic.speeds.append((speed, settings.speed_input(speed, _schema(source))))
    for i, sensor in enumerate(sensors):
        reader = SensorReader(sensor, sensor.type, _schema(sensor))
        topic_of(sensor).sensors.append((i, reader))
    return topics


def check_output_topics(inputs: Iterable[str], resolve: Callable[[str], str]) -> None:
    """Refuse an output on the topic of an input, by its absolute name, or of another output."""
    used = dict.fromkeys(inputs, "an input")
    for output in OUTPUT_TOPICS:
        name = resolve(output.name)
        if name in used:
            raise ParameterError(
                f"Topic {name} is that of both {used[name]} and the output {output.name}; choose "
                "another topic for one of them."
            )
        used[name] = output.name


def _type_words(source: SourceSettings | Sensor) -> str:
    """Return the name of the parameter or the key that gives the type of a source."""
    if isinstance(source, Sensor):
        return f"Key type of the sensor {source.name}"
    return f"Parameter {source.name}_type"


def _schema(source: SourceSettings | Sensor) -> Schema:
    """Return the fields of the type of a source, which must be installed."""
    try:
        return installed_schema(source.type)
    except (ImportError, AttributeError, ValueError):  # the last one: of a name without slashes
        package = source.type.split("/")[0]
        raise ParameterError(
            f"{_type_words(source)}: the type {source.type} is not installed; install or "
            f"source the package {package}, or choose another input."
        ) from None


def installed_schema(type_name: str) -> Schema:
    """Return the fields of a type; `message_class` says which errors it raises."""

    def fields_of(name: str) -> list[SchemaField]:
        described: dict[str, Any] = message_class(name).get_fields_and_field_types()
        return [_field(each, text) for each, text in described.items()]

    return schema_by(type_name, fields_of)


def _field(name: str, text: str) -> SchemaField:
    """Return a field as rosidl describes it."""
    match = _TYPE.fullmatch(text)
    if match is None:
        raise LinkageVibrationError(f"Field {name} has the unknown type {text}; report this.")
    sequence, element, length = match.groups()
    element = _PLAIN.get(element, element.replace("/", "/msg/"))
    return SchemaField(name, element, 0 if sequence else None if length is None else int(length))
