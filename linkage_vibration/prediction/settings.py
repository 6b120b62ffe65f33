# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node: one list for the node, the replay, YAML files and the manual."""

import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import yaml

from linkage_vibration.bags.recorder import Limits
from linkage_vibration.bags.schemas import Schema
from linkage_vibration.bags.writing import COMPRESSIONS
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs.presets import ENGINE, GROUND, HITCH, PRESETS, PTO
from linkage_vibration.prediction.inputs.sources import (
    TIMES,
    CrankInput,
    SourceSettings,
    SpeedInput,
)
from linkage_vibration.prediction.inputs.units import (
    ANGLES,
    CALIBRATED,
    ROTATIONS,
    SPEEDS,
    Calibration,
    HitchScale,
    InputError,
)
from linkage_vibration.prediction.resonance import WarningLimits
from linkage_vibration.support.resources import (
    DEFAULT_EXCITATIONS,
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    config_file,
)
from linkage_vibration.support.version import VERSION

Value = TypeVar("Value", bool, int, float, str, tuple[float, ...])

# ROS 2's names of the types, as `ros2 param describe` prints them.
TYPE_NAMES = {
    bool: "boolean",
    int: "integer",
    float: "double",
    str: "string",
    tuple: "double array",
}
NODE_NAME = "linkage_vibration"

DEPRECATED = {"percent_points": (0.0, 100.0), "percent_angles": (3.14159, 1.5708)}
"""The lists that release 1.0.0 had instead of the pairs of `calibration`, and their defaults."""

ROS_PARAMETERS = ("qos_overrides", "start_type_description_service", "use_sim_time")
"""The parameters that ROS 2 gives every node."""

_UNITS = {HITCH: (*ANGLES, *CALIBRATED), ENGINE: ROTATIONS, PTO: ROTATIONS, GROUND: SPEEDS}
_TYPE_NAME = re.compile(r"[a-z][a-z0-9_]*/(msg/)?[A-Z][A-Za-z0-9]*")
_TOPIC_NAME = re.compile(r"(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


class ParameterError(LinkageVibrationError):
    """A parameter of the node has an invalid value."""


def _parameter(
    default: Value,
    unit: str,
    valid: str,
    description: str,
    check: Callable[[Value], bool] = lambda value: True,
    *,
    between: tuple[float, float] | None = None,
    live: bool = True,
) -> Value:
    """Return a dataclass field with its unit, its valid values and its description.

    ``between`` is a range that includes its ends. A ``live`` parameter can be set while the node
    is active; the node reads all others when it is configured.
    """
    words = {"unit": unit, "valid": valid, "description": description, "live": live}
    found: Any = field(default=default, metadata={**words, "check": check, "between": between})
    return found  # type: ignore[no-any-return]


def _ranged(default: Value, least: float, largest: float, unit: str, description: str) -> Value:
    """Return the field of a number in a range that includes its ends."""
    valid = f"{least:g} to {largest:g}"
    return _parameter(default, unit, valid, description, between=(least, largest))


def _switch(default: bool, description: str) -> bool:
    """Return the field of a truth value, which is not live."""
    return _parameter(default, "", "true or false", description, live=False)


def _text(valid: str, description: str) -> str:
    """Return the field of a text that may be empty, which is not live."""
    return _parameter("", "", f"{valid}, or empty", description, live=False)


def _limit(default: Value, unit: str, description: str) -> Value:
    """Return the field of a limit of the logs, where 0 means no limit; it is not live."""
    valid = f"a {'whole' if isinstance(default, int) else 'finite'} number, 0 for no limit"
    return _parameter(default, unit, valid, description, _is_limit, live=False)


def _is_limit(value: Any) -> bool:
    return bool(0 <= value < math.inf)


def _speed(source: Source) -> float:
    """Return the field of a speed that may be fixed."""
    name = source.value
    description = (
        f"Fixed {_NAMES[name]} speed. If negative, the speed is read as `{name}_input` says."
    )
    return _parameter(-1.0, source.unit, "a finite number", description, math.isfinite)


_NAMES = {HITCH: "hitch", ENGINE: "engine", PTO: "PTO", GROUND: "ground"}


def _preset(name: str) -> str:
    """Return the field of the preset of an input."""
    presets = PRESETS[name]
    listing = "; ".join(
        f"`{key}` is the {one.field.replace('{joint_name}', 'joint_name')} of {one.type} on "
        f"`{one.topic}`, in {one.unit}"
        for key, one in presets.items()
    )
    what = "crank angle" if name == HITCH else f"{_NAMES[name]} speed"
    return _parameter(
        next(iter(presets)),
        "",
        " or ".join(presets),
        f"What publishes the {what}: {listing}. Other parameters of the input override it.",
        presets.__contains__,
    )


def _override(name: str, what: str, valid: str, check: Callable[[str], Any]) -> str:
    """Return the field of a text that overrides what the preset of an input says."""
    return _parameter(
        "",
        "",
        f"{valid}, or empty",
        f"{what} of the {_NAMES[name]} input. If it is empty, the preset decides.",
        lambda value: not value or bool(check(value)),
    )


def _topic(name: str) -> str:
    return _override(name, "Topic", "the name of a topic", _TOPIC_NAME.fullmatch)


def _type(name: str) -> str:
    what = "Type of the messages"
    return _override(name, what, "a type such as nav_msgs/msg/Odometry", _TYPE_NAME.fullmatch)


def _field(name: str) -> str:
    valid = "a path such as twist.twist.linear.x, position[boom] or data[0], or a CAN signal"
    return _override(name, "Path to the number in the messages", valid, str.isprintable)


def _unit(name: str) -> str:
    units = _UNITS[name]
    return _override(name, "Unit of the number", " or ".join(units), units.__contains__)


def _time(name: str) -> str:
    """Return the field of the origin of an input's time."""
    usual = "receipt" if name != HITCH else "header, or receipt for messages without a header"
    return _parameter(
        "",
        "",
        f"{' or '.join(TIMES)}, or empty",
        f"Origin of the time of the {_NAMES[name]} input: the stamp in the header of its messages, "
        f"or their receipt, which is the log time of a bag. If it is empty, {usual}.",
        lambda value: value in ("", *TIMES),
    )


def _delay(name: str) -> float:
    """Return the field of an input's known delay."""
    description = (
        f"Known time from the moment of a value of the {_NAMES[name]} input to its receipt."
    )
    return _ranged(0.0, 0.0, 10.0, "s", f"{description} It is subtracted from the time of receipt.")


def _sign(description: str) -> int:
    return _parameter(1, "1", "1 or -1", description, lambda sign: sign in (1, -1))


def _scale(unit: str, description: str) -> float:
    valid = "a finite number greater than 0"
    return _parameter(1.0, unit, valid, description, lambda scale: 0.0 < scale < math.inf)


def _offset(unit: str, description: str) -> float:
    return _parameter(0.0, unit, "a finite number", description, math.isfinite)


def _speed_sign(name: str) -> int:
    return _sign(f"Sign of the {_NAMES[name]} speed: speed = sign * scale * number + offset.")


def _speed_scale(name: str) -> float:
    unit = f"{name}_unit per unit of the number"
    return _scale(unit, f"Change of the {_NAMES[name]} speed per unit of the number.")


def _speed_offset(name: str) -> float:
    return _offset(f"{name}_unit", f"The {_NAMES[name]} speed at the number 0.")


@dataclass(frozen=True, slots=True)
class Parameters:
    """The parameters of the node, in the order of the manual.

    The metadata of each field describe the parameter.
    """

    autostart: bool = _switch(
        True, "Configure and activate the node at start, without a lifecycle manager."
    )
    input: str = _preset(HITCH)
    joint_name: str = _parameter(
        "hitch_rockshaft_joint",
        "",
        "the name of a joint",
        "Name of the joint that turns the input crank, for the preset `joint_states`.",
        lambda name: name != "",
    )
    hitch_topic: str = _topic(HITCH)
    hitch_type: str = _type(HITCH)
    hitch_field: str = _field(HITCH)
    hitch_unit: str = _unit(HITCH)
    sign: int = _sign(
        "Direction of the hitch input: position = sign * scale * number + offset. A position in "
        "rad or deg is the crank angle; another one is looked up in `calibration`."
    )
    scale: float = _scale("hitch_unit per unit of the number", "Change of the position per number.")
    offset: float = _offset("hitch_unit", "Position at the number 0.")
    calibration: tuple[float, ...] = _parameter(
        (0.0, 3.14159, 100.0, 1.5708),
        "hitch_unit, rad",
        "a position and an angle in turn, all ascending or all descending angles",
        "Pairs of a hitch position and the crank angle there (rad), one pair after the other, for "
        "positions in percent (from 0 to 100), in m (such as the stroke of a cylinder), or in any "
        "other unit. A monotone curve connects them.",
        lambda pairs: Calibration(pairs) is not None,
    )
    hitch_time: str = _time(HITCH)
    hitch_delay: float = _delay(HITCH)
    angle_stddev: float = _ranged(
        0.0,
        0.0,
        1.0,
        "rad",
        "Standard deviation of the crank angle, from which that of the frequencies follows. With "
        "positions in percent, the uncertainty of their steps of 0.4 % is added.",
    )
    can_database: str = _text(
        "the path of a DBC file",
        "Describes CAN signals that are not built in. The field of an input then names the message "
        "and the signal, as in `RearHitch.Position`.",
    )
    mechanism_file: str = _text(
        "the path of a YAML file",
        "The mechanism. If it is empty, the three-point linkage on a tractor of the "
        "package is used.",
    )
    table_file: str = _text(
        "the path of an .npz file",
        "The table of this mechanism, as `linkage-vibration build` saves it. If it is empty, the "
        "table of the package is used, or, if mechanism_file is given, a table is built at start.",
    )
    excitation_file: str = _text(
        "the path of a YAML file",
        "The excitations. If it is empty, the excitations of the package are used.",
    )
    implement_file: str = _text(
        "the path of a YAML file",
        "Implements that can be chosen by name: by the parameter implement, the service "
        "`~/set_implement` or the topic `hitched_implement`. The node remembers the choice.",
    )
    implement: str = _text(
        "the name of an implement in implement_file",
        "The implement at start. If it is empty, that of the mechanism is used.",
    )
    engine_speed: float = _speed(Source.ENGINE)
    engine_input: str = _preset(ENGINE)
    engine_topic: str = _topic(ENGINE)
    engine_type: str = _type(ENGINE)
    engine_field: str = _field(ENGINE)
    engine_unit: str = _unit(ENGINE)
    engine_sign: int = _speed_sign(ENGINE)
    engine_scale: float = _speed_scale(ENGINE)
    engine_offset: float = _speed_offset(ENGINE)
    engine_time: str = _time(ENGINE)
    engine_delay: float = _delay(ENGINE)
    pto_speed: float = _speed(Source.PTO)
    pto_input: str = _preset(PTO)
    pto_topic: str = _topic(PTO)
    pto_type: str = _type(PTO)
    pto_field: str = _field(PTO)
    pto_unit: str = _unit(PTO)
    pto_sign: int = _speed_sign(PTO)
    pto_scale: float = _speed_scale(PTO)
    pto_offset: float = _speed_offset(PTO)
    pto_time: str = _time(PTO)
    pto_delay: float = _delay(PTO)
    ground_speed: float = _speed(Source.GROUND)
    ground_input: str = _preset(GROUND)
    ground_topic: str = _topic(GROUND)
    ground_type: str = _type(GROUND)
    ground_field: str = _field(GROUND)
    ground_unit: str = _unit(GROUND)
    ground_sign: int = _speed_sign(GROUND)
    ground_scale: float = _speed_scale(GROUND)
    ground_offset: float = _speed_offset(GROUND)
    ground_time: str = _time(GROUND)
    ground_delay: float = _delay(GROUND)
    warning_level: float = _ranged(
        5.0,
        1e-6,
        1e6,
        "mm/s",
        "Warn when an excitation whose amplitude is known shakes the response point with this "
        "velocity (root mean square).",
    )
    warning_probability: float = _ranged(
        0.1,
        1e-6,
        1.0,
        "1",
        "Warn when another excitation lies within the half-power band of a mode with this "
        "probability, if the mechanism states its uncertainty.",
    )
    warning_margin: float = _ranged(
        0.1,
        0.0,
        1.0,
        "1",
        "If neither is known, warn when an excitation frequency is within this fraction of a "
        "natural frequency.",
    )
    hysteresis: float = _ranged(
        0.02,
        0.0,
        1.0,
        "1",
        "A warning ends when the margin exceeds warning_margin by this much; one by level or "
        "probability ends at the same share of its limit, warning_margin / (warning_margin + "
        "hysteresis).",
    )
    warning_dwell: float = _ranged(
        0.0,
        0.0,
        3600.0,
        "s",
        "A warning begins when its limit has been exceeded for this long; until then it is a note.",
    )
    stale_after: float = _ranged(
        1.0, 0.01, 3600.0, "s", "A speed or a crank angle that is older than this is not used."
    )
    record: bool = _switch(
        False,
        "Start an MCAP log when the node is activated. `~/start_recording` and `~/stop_recording` "
        "start and stop a log at any time.",
    )
    log_directory: str = _text(
        "the path of a folder that exists",
        "The folder of the logs. If it is empty, the current directory is used.",
    )
    compression: str = _parameter(
        "zstd",
        "",
        ", ".join(COMPRESSIONS),
        "Compression of the logs.",
        lambda value: value in COMPRESSIONS,
        live=False,
    )
    split_size: int = _limit(0, "byte", "A log continues in a new file when it reaches this size.")
    split_duration: float = _limit(0.0, "s", "A log continues in a new file after this time.")
    disk_limit: int = _limit(
        0, "byte", "Recording stops when all logs in the folder together reach this size."
    )
    delete_oldest: bool = _switch(
        False, "Delete the oldest logs instead of stopping at disk_limit."
    )
    extra_topics: str = _parameter(
        "",
        "",
        "names of topics (letters, digits, _ and /), separated by spaces, or empty",
        "Topics to log in addition to those that the node uses.",
        lambda names: all(map(_TOPIC_NAME.fullmatch, names.split())),
        live=False,
    )
    service_events: str = _parameter(
        "off",
        "",
        "off, metadata or contents",
        "Publish an event for each request and response of the services, on the topic "
        "`SERVICE/_service_event`: without or with its contents. `extra_topics` can log them.",
        lambda value: value in ("off", "metadata", "contents"),
    )
    marker_mode: str = _parameter(
        "",
        "",
        "the number of a mode, its name, or empty",
        "Mode that `~/markers` shows: its number, counted from 1, or its name; 0 for no mode. If "
        "it is empty, the first mode that is not the tractor's is shown.",
        lambda mode: not mode.startswith("-"),
    )
    marker_rate: float = _ranged(10.0, 0.1, 100.0, "Hz", "Rate at which `~/markers` is published.")
    marker_frame: str = _parameter(
        "base_link",
        "",
        "the name of a frame",
        "Frame of `~/markers`: the origin of the mechanism, with x forward and z up.",
        lambda name: name != "",
    )

    def speed_sources(self) -> dict[Source, SourceSettings]:
        """Return where the speeds come from, unless they are fixed."""
        return {source: self.source(source.value) for source in Source}

    def crank_input(self, schema: Schema) -> CrankInput:
        """Return the input of the crank angle.

        Parameters
        ----------
        schema : Schema
            The fields of the type of its messages.
        """
        return CrankInput(self.source(HITCH), schema, self._hitch_scale())

    def speed_input(self, source: Source, schema: Schema) -> SpeedInput:
        """Return the input of a speed.

        Parameters
        ----------
        source, schema : Source, Schema
            The speed, and the fields of the type of its messages.
        """
        name = source.value
        factor = {**ROTATIONS, **SPEEDS}[self._chosen(name, "unit")]
        sign, scale, offset = (
            getattr(self, f"{name}_{each}") for each in ("sign", "scale", "offset")
        )
        return SpeedInput(self.source(name), schema, factor, sign, scale, offset)

    def check_inputs(self) -> None:
        """Refuse parameters of inputs that do not fit each other.

        Raises
        ------
        ParameterError
            If the calibration does not belong to the unit, or a delay to the origin of the time.
        """
        try:
            self._hitch_scale()
        except InputError as error:
            raise ParameterError(f"Parameter {error}") from None
        for name in PRESETS:
            if getattr(self, f"{name}_time") == "header" and getattr(self, f"{name}_delay"):
                raise ParameterError(
                    f"Parameter {name}_delay is subtracted from the time of receipt, but "
                    f"{name}_time is header; write `{name}_time: receipt`, or remove the delay."
                )

    def source(self, name: str) -> SourceSettings:
        """Return where an input comes from: "hitch", "engine", "pto" or "ground"."""
        preset = PRESETS[name][self._preset_of(name)]
        kind, own = self._chosen(name, "type"), not self._own(name, "field")
        joint = f'"{self.joint_name}"' if self.joint_name.isdecimal() else self.joint_name
        field = self._chosen(name, "field").replace("{joint_name}", joint)
        package, _, last = kind.rpartition("/")
        return SourceSettings(
            name,
            self._chosen(name, "topic"),
            f"{package.removesuffix('/msg')}/msg/{last}",
            field,
            self._own(name, "time"),
            getattr(self, f"{name}_delay"),
            preset.low if own else -math.inf,
            preset.high if own else math.inf,
            bool(self._own(name, "topic")),
            str(_path(self.can_database) or ""),
            self._chosen(name, "unit") if self._scale_of(name) == 1.0 else "",
        )

    def _scale_of(self, name: str) -> float:
        return self.scale if name == HITCH else float(getattr(self, f"{name}_scale"))

    def _hitch_scale(self) -> HitchScale:
        unit, calibration = self._chosen(HITCH, "unit"), Calibration(self.calibration)
        return HitchScale(unit, self.sign, self.scale, self.offset, calibration, self.angle_stddev)

    def _preset_of(self, name: str) -> str:
        return self.input if name == HITCH else str(getattr(self, f"{name}_input"))

    def _own(self, name: str, what: str) -> str:
        """Return what a parameter of an input says; empty if it says nothing."""
        return str(getattr(self, f"{name}_{what}"))

    def _chosen(self, name: str, what: str) -> str:
        """Return what a parameter of an input says, or else its preset."""
        preset = PRESETS[name][self._preset_of(name)]
        return self._own(name, what) or str(getattr(preset, what))

    def fixed_speed(self, source: Source) -> float | None:
        """Return a fixed speed (rpm or m/s), or None if the speed is read from its topic."""
        value: float = getattr(self, f"{source.value}_speed")
        return value if value >= 0.0 else None

    def warning_limits(self) -> WarningLimits:
        """Return when an excitation warns."""
        return WarningLimits(
            1e-3 * self.warning_level,
            self.warning_probability,
            self.warning_margin,
            self.hysteresis,
            self.warning_dwell,
        )

    def mechanism_path(self) -> Path:
        """Return the file of the mechanism."""
        return _path(self.mechanism_file) or config_file(DEFAULT_MECHANISM)

    def table_path(self) -> Path | None:
        """Return the file of the table, or None if the table must be built."""
        if self.mechanism_file and not self.table_file:
            return None
        return _path(self.table_file) or config_file(DEFAULT_TABLE)

    def implement_path(self) -> Path | None:
        """Return the file of the implements, or None if there is none."""
        return _path(self.implement_file)

    def excitation_path(self) -> Path:
        """Return the file of the excitations."""
        return _path(self.excitation_file) or config_file(DEFAULT_EXCITATIONS)

    def log_path(self) -> Path:
        """Return the folder of the logs.

        Raises
        ------
        ParameterError
            If log_directory is not a folder to which this process may write.
        """
        folder = _path(self.log_directory)
        if folder is not None and not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
            raise ParameterError(
                f"Parameter log_directory must be a folder to which the node may write, not "
                f"{folder}; create it, or name another one."
            )
        return folder or Path.cwd()

    def limits(self) -> Limits:
        """Return the limits of the size of the logs."""
        return Limits(self.split_size, self.split_duration, self.disk_limit, self.delete_oldest)


def check_value(name: str, value: object) -> Any:
    """Return a value in the type of its parameter, the field of `Parameters` with this name.

    Parameters
    ----------
    name, value : str and object

    Raises
    ------
    ParameterError
        If there is no such parameter, or if the value has another type or is invalid.
    """
    known = {f.name: f for f in fields(Parameters)}
    if name not in known:
        valid_names = [*known, *ROS_PARAMETERS]
        raise ParameterError(f"Parameter {name} is unknown; {ask_for(name, valid_names)}")
    parameter = known[name]
    value = own_value(name, value)
    words = parameter.metadata
    between = words["between"]
    try:
        valid = (
            type(value) is type(parameter.default)
            and (between is None or between[0] <= value <= between[1])
            and words["check"](value)
        )
    except InputError as error:
        raise ParameterError(f"Parameter {name}: {error}") from None
    if not valid:
        example = f"write for example `{name}: {_yaml(parameter.default)}`"
        fix = "leave it empty if you do not need it" if parameter.default == "" else example
        raise ParameterError(f"Parameter {name} must be {words['valid']}, not {value!r}; {fix}.")
    return value


def with_values(parameters: Parameters, values: Mapping[str, object]) -> Parameters:
    """Return parameters with other values for some of them.

    Parameters
    ----------
    parameters : Parameters
    values : mapping of str to object
        The new values by the names of their parameters.

    Raises
    ------
    ParameterError
        If a parameter does not exist, if a value has another type or is invalid, or if parameters
        of an input do not fit each other.
    """
    changed = replace(parameters, **{name: check_value(name, v) for name, v in values.items()})
    changed.check_inputs()
    return changed


def is_own(name: str) -> bool:
    """Return whether a name is not that of a parameter which ROS 2 gives every node."""
    return name.partition(".")[0] not in ROS_PARAMETERS


def with_pairs(given: Mapping[str, object]) -> dict[str, object]:
    """Return values in which the calibration has its present name and form.

    Release 1.0.0 had two lists instead of pairs.

    Raises
    ------
    ParameterError
        If the lists are not lists of the same length.
    """
    values = dict(given)
    if "percent_calibration" in values:
        values.setdefault("calibration", values.pop("percent_calibration"))
    old = {name: values.pop(name) for name in DEPRECATED if name in values}
    if not old:
        return values
    lists: list[Any] = [old.get(name, default) for name, default in DEPRECATED.items()]
    try:
        pairs = [value for pair in zip(*lists, strict=True) for value in pair]
    except (TypeError, ValueError):
        raise ParameterError(
            f"Parameters {' and '.join(DEPRECATED)} must be lists of the same length; give pairs "
            "in calibration instead."
        ) from None
    return {"calibration": pairs, **values}


def ask_for(name: str, known: Iterable[str]) -> str:
    """Return the question whether a similar name was meant, or where the valid names are listed.

    Parameters
    ----------
    name, known : str, iterable of str
        A name that is unknown, and those that exist.
    """
    similar = get_close_matches(name, list(known), 1)
    if similar:
        return f"did you mean {similar[0]}?"
    return "`linkage_vibration_node --help` lists what is valid."


def own_type(kind: type, value: Any) -> Any:
    """Return a value in another type if it means the same, such as 1 for 1.0.

    Parameters
    ----------
    kind : type
    value : object
        A value as YAML or ROS 2 gives it.
    """
    if kind is float and type(value) is int:
        return float(value)
    if kind is tuple and not isinstance(value, str | bytes) and isinstance(value, Iterable):
        items = [own_type(float, item) for item in value]
        return tuple(items) if all(type(item) is float for item in items) else items
    return value


def own_value(name: str, value: Any) -> Any:
    """Return a value in the type of a parameter if it means the same, such as "1" for a mode.

    Parameters
    ----------
    name, value : str and object
        A parameter, or a name that is none, and the value as YAML or ROS 2 gives it.
    """
    if name == "marker_mode" and type(value) is int:
        return str(value)
    if name == "input" and value == "joint_state":
        return "joint_states"  # its name in earlier files and logs
    kinds = {parameter.name: type(parameter.default) for parameter in fields(Parameters)}
    return own_type(kinds.get(name, object), value)


def without_markers(settings: Parameters) -> Parameters:
    """Return the parameters with default markers, on which no message of a log depends."""
    shown = [f for f in fields(Parameters) if f.name.startswith("marker_")]
    defaults: Any = {f.name: f.default for f in shown}
    return replace(settings, **defaults)


def parameters_yaml(parameters: Parameters, node_name: str) -> str:
    """Return a YAML file for ``--params-file`` that gives a node these parameters.

    Parameters
    ----------
    parameters : Parameters
    node_name : str
        Name of the node with its namespace.
    """
    values = {f.name: _plain(getattr(parameters, f.name)) for f in fields(parameters)}
    sections = {node_name: {"ros__parameters": values}}
    return f"# linkage_vibration {VERSION}\n" + yaml.safe_dump(
        sections, sort_keys=False, default_flow_style=None
    )


class _Loader(yaml.SafeLoader):
    """YAML as ROS 2 reads it, where 1e-3 is a number."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def read_parameters(path: str | Path) -> Parameters:
    """Read a file of parameters, as a node reads it from ``--params-file``.

    If several sections match the node, later ones override earlier ones.

    Raises
    ------
    ParameterError
        If the file cannot be read, has no section for the node, or has an unknown parameter or an
        invalid value.
    """
    path = Path(path)
    found = [given for name, given in _sections(path) if _matches(name, f"/{NODE_NAME}")]
    if not found:
        raise ParameterError(no_parameters(path, NODE_NAME))
    values: dict[str, object] = {}
    for given in found:
        if isinstance(given, dict):
            values.update({n: value for name, value in given.items() if is_own(n := str(name))})
    try:
        return with_values(Parameters(), with_pairs(values))
    except (ParameterError, OverflowError) as error:
        raise ParameterError(f"{path}: {error}") from None


def has_parameters(path: Path, node_name: str) -> bool:
    """Return whether a file of parameters has a section for a node.

    Parameters
    ----------
    path, node_name : Path, str
        The file, and the name of the node with its namespace.

    Raises
    ------
    ParameterError
        If the file cannot be read.
    """
    return any(_matches(name, node_name) for name, _ in _sections(path))


def no_parameters(path: Path, node_name: str) -> str:
    """Return the sentence that a file of parameters has no section for a node.

    Parameters
    ----------
    path, node_name : Path, str
        The file, and the name of the node, with its namespace if it has one.
    """
    return (
        f"{path} has no parameters for the node; give them below `{node_name}:` or `/**:` and "
        "there `ros__parameters:`."
    )


def _sections(path: Path) -> list[tuple[str, object]]:
    """Return the names of the nodes in a file, which may have wildcards, and their parameters."""
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        problem = " ".join(str(error).split())
        raise ParameterError(f"{path} cannot be read as YAML: {problem}.") from None
    return list(_named(content, ""))


def _named(content: object, namespace: str) -> Iterator[tuple[str, object]]:
    """Yield the names and the parameters of the nodes in a namespace, also in nested ones."""
    for key, section in content.items() if isinstance(content, dict) else ():
        name = f"{namespace}/{str(key).strip('/')}"
        if isinstance(section, dict) and "ros__parameters" in section:
            yield name, section["ros__parameters"]
        else:
            yield from _named(section, name)


def _matches(section: str, node_name: str) -> bool:
    """Return whether the name of a section, which may have wildcards, is that of a node."""
    pattern = re.escape(section).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
    return re.fullmatch(pattern, node_name) is not None


def parameter_table() -> str:
    """Return the parameters as a Markdown table, for the manual."""
    rows = ["| parameter | type | default | unit | valid | live | meaning |"]
    rows += ["|---|---|---|---|---|---|---|"]
    for parameter in fields(Parameters):
        words = parameter.metadata
        rows.append(
            f"| `{parameter.name}` | {TYPE_NAMES[type(parameter.default)]} "
            f"| `{_yaml(parameter.default)}` | {words['unit']} | {words['valid']} "
            f"| {'yes' if words['live'] else ''} | {words['description']} |"
        )
    return "\n".join(rows) + "\n"


def _path(text: str) -> Path | None:
    """Return the path in a parameter, with ``~`` expanded; None if the parameter is empty."""
    return Path(text).expanduser().absolute() if text else None


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def _yaml(value: object) -> str:
    """Return a scalar or a list as YAML writes it."""
    return yaml.safe_dump(_plain(value), default_flow_style=True).splitlines()[0]
