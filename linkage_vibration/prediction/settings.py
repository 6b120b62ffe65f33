# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node and the replay, each declared once.

The ROS parameters, files of parameters (`parameter_files`), the help and the manual follow from it.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import yaml

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
    HitchCurve,
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

Value = TypeVar("Value", bool, int, float, str, tuple[float, ...])
Class = TypeVar("Class")

NODE_NAME = "linkage_vibration"
ROS_PARAMETERS = ("qos_overrides", "start_type_description_service", "use_sim_time")
"""The parameters that ROS 2 gives every node."""

_LABELS = {HITCH: "hitch", ENGINE: "engine", PTO: "PTO", GROUND: "ground"}
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
    declared: Any = field(default=default, metadata={**words, "check": check, "between": between})
    return declared  # type: ignore[no-any-return]


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

    def is_limit(value: Any) -> bool:
        return bool(0 <= value < math.inf)

    return _parameter(default, unit, valid, description, is_limit, live=False)


def _sign(description: str) -> int:
    return _parameter(1, "1", "1 or -1", description, lambda sign: sign in (1, -1))


def _scale(unit: str, description: str) -> float:
    valid = "a finite number greater than 0"
    return _parameter(1.0, unit, valid, description, lambda scale: 0.0 < scale < math.inf)


def _finite(default: float, unit: str, description: str) -> float:
    return _parameter(default, unit, "a finite number", description, math.isfinite)


def _preset(name: str, quantity: str) -> str:
    """Return the field of the preset of an input."""
    listing = "; ".join(
        f"`{key}` is the {preset.field.replace('{joint_name}', 'joint_name')} of {preset.type} on "
        f"`{preset.topic}`, in {preset.unit}"
        for key, preset in PRESETS[name].items()
    )
    return _parameter(
        next(iter(PRESETS[name])),
        "",
        " or ".join(PRESETS[name]),
        f"What publishes the {quantity}: {listing}. Other parameters of the input override it.",
        PRESETS[name].__contains__,
    )


def _place(name: str) -> dict[str, Any]:
    """Return the fields that override the preset of an input, by their names."""

    def override(what: str, valid: str, check: Callable[[str], Any]) -> str:
        words = f"{what} of the {_LABELS[name]} input. If it is empty, the preset decides."
        return _parameter(
            "", "", f"{valid}, or empty", words, lambda value: not value or bool(check(value))
        )

    kind = "a type such as nav_msgs/msg/Odometry"
    path = "a path such as twist.twist.linear.x, position[boom] or data[0], or a CAN signal"
    units = _UNITS[name]
    return {
        f"{name}_topic": override("Topic", "the name of a topic", _TOPIC_NAME.fullmatch),
        f"{name}_type": override("Type of the messages", kind, _TYPE_NAME.fullmatch),
        f"{name}_field": override("Path to the number in the messages", path, str.isprintable),
        f"{name}_unit": override("Unit of the number", " or ".join(units), units.__contains__),
    }


def _timing(name: str) -> dict[str, Any]:
    """Return the fields of the origin of an input's time and of its known delay."""
    label = _LABELS[name]
    usual = "receipt" if name != HITCH else "header, or receipt for messages without a header"
    origin = (
        f"Origin of the time of the {label} input: the stamp in the header of its messages, or "
        f"their receipt, which is the log time of a bag. If it is empty, {usual}."
    )
    delay = (
        f"Known time from the moment of a value of the {label} input to its receipt. It is "
        "subtracted from the time of receipt."
    )
    valid = f"{' or '.join(TIMES)}, or empty"
    return {
        f"{name}_time": _parameter("", "", valid, origin, lambda value: value in ("", *TIMES)),
        f"{name}_delay": _ranged(0.0, 0.0, 10.0, "s", delay),
    }


def _speed(source: Source) -> dict[str, Any]:
    """Return the fields of a speed, which may be fixed, by their names."""
    name = source.value
    speed = f"{_LABELS[name]} speed"
    fixed = f"Fixed {speed}. If negative, the speed is read as `{name}_input` says."
    gain = f"{name}_unit per unit of the number"
    return {
        f"{name}_speed": _finite(-1.0, source.unit, fixed),
        f"{name}_input": _preset(name, speed),
        **_place(name),
        f"{name}_sign": _sign(f"Sign of the {speed}: speed = sign * scale * number + offset."),
        f"{name}_scale": _scale(gain, f"Change of the {speed} per unit of the number."),
        f"{name}_offset": _finite(0.0, f"{name}_unit", f"The {speed} at the number 0."),
        **_timing(name),
    }


def _with_inputs(cls: type[Class]) -> type[Class]:
    """Add the parameters that all inputs have to a class, each group after a parameter of it."""
    speeds = {name: speed for source in Source for name, speed in _speed(source).items()}
    groups = {"joint_name": _place(HITCH), "calibration": _timing(HITCH), "implement": speeds}
    kinds: dict[str, type] = {}
    for name, kind in cls.__annotations__.items():
        kinds[name] = kind
        for added, declared in groups.get(name, {}).items():
            kinds[added] = type(declared.default)
            setattr(cls, added, declared)
    cls.__annotations__ = kinds
    return cls


@dataclass(frozen=True, slots=True)
@_with_inputs
class Parameters:
    """The parameters of the node, in the order of the manual.

    The metadata of each field describe the parameter.
    """

    autostart: bool = _switch(
        True, "Configure and activate the node at start, without a lifecycle manager."
    )
    input: str = _preset(HITCH, "crank angle")
    joint_name: str = _parameter(
        "hitch_rockshaft_joint",
        "",
        "the name of a joint",
        "Name of the joint that turns the input crank, for the preset `joint_states`.",
        lambda name: name != "",
    )
    sign: int = _sign(
        "Direction of the hitch input: position = sign * scale * number + offset. A position in "
        "rad or deg is the crank angle; another one is looked up in `calibration`."
    )
    scale: float = _scale("hitch_unit per unit of the number", "Change of the position per number.")
    offset: float = _finite(0.0, "hitch_unit", "Position at the number 0.")
    calibration: tuple[float, ...] = _parameter(
        (0.0, 3.14159, 100.0, 1.5708),
        "hitch_unit, rad",
        "a position and an angle in turn, all ascending or all descending angles",
        "Pairs of a hitch position and the crank angle there (rad), one pair after the other, for "
        "positions in percent (from 0 to 100), in m (such as the stroke of a cylinder), or in any "
        "other unit. A monotone curve connects them.",
        lambda pairs: HitchCurve(pairs) is not None,
    )
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
    resonance_rate: float = _ranged(
        50.0,
        0.0,
        1e4,
        "Hz",
        "Rate at which predictions are assessed for `~/resonance`, at most: the first in each "
        "period of their stamps. With 0, each is assessed.",
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

    if TYPE_CHECKING:  # type checkers do not see the parameters that the decorator adds

        def __init__(self, **values: Any) -> None: ...
        def __getattr__(self, name: str) -> Any: ...  # noqa: D105

    def source(self, name: str) -> SourceSettings:
        """Return where an input comes from: "hitch", "engine", "pto" or "ground"."""
        preset = PRESETS[name][self._input(name, "input")]
        kind, replaced = self._chosen(name, "type"), bool(self._input(name, "field"))
        joint = f'"{self.joint_name}"' if self.joint_name.isdecimal() else self.joint_name
        package, _, last = kind.rpartition("/")
        return SourceSettings(
            name,
            self._chosen(name, "topic"),
            f"{package.removesuffix('/msg')}/msg/{last}",
            self._chosen(name, "field").replace("{joint_name}", joint),
            self._input(name, "time"),
            self._input(name, "delay"),
            -math.inf if replaced else preset.low,
            math.inf if replaced else preset.high,
            bool(self._input(name, "topic")),
            str(_path(self.can_database) or ""),
            self._chosen(name, "unit") if self._input(name, "scale") == 1.0 else "",
        )

    def speed_sources(self) -> dict[Source, SourceSettings]:
        """Return where the speeds come from, unless they are fixed."""
        return {source: self.source(source.value) for source in Source}

    def crank_input(self, schema: Schema) -> CrankInput:
        """Return the input of the crank angle from messages with these fields."""
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
        gain = factor * self._input(name, "sign") * self._input(name, "scale")
        offset = factor * self._input(name, "offset")
        return SpeedInput(self.source(name), schema, gain, offset)

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
            if self._input(name, "time") == "header" and self._input(name, "delay"):
                raise ParameterError(
                    f"Parameter {name}_delay is subtracted from the time of receipt, but "
                    f"{name}_time is header; write `{name}_time: receipt`, or remove the delay."
                )

    def _input(self, name: str, what: str) -> Any:
        """Return a parameter of an input; some of the hitch have no prefix."""
        bare = name == HITCH and what in ("input", "sign", "scale", "offset")
        return getattr(self, what if bare else f"{name}_{what}")

    def _chosen(self, name: str, what: str) -> str:
        """Return the text in a parameter of an input, or in its preset if that is empty."""
        preset = PRESETS[name][self._input(name, "input")]
        return str(self._input(name, what) or getattr(preset, what))

    def _hitch_scale(self) -> HitchScale:
        unit, calibration = self._chosen(HITCH, "unit"), HitchCurve(self.calibration)
        return HitchScale(unit, self.sign, self.scale, self.offset, calibration, self.angle_stddev)

    def fixed_speed(self, source: Source) -> float | None:
        """Return a fixed speed (rpm or m/s), or None if the speed is read from its topic."""
        value: float = self._input(source.value, "speed")
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
        """Return the folder of the logs."""
        return _path(self.log_directory) or Path.cwd()


def check_value(name: str, value: object) -> Any:
    """Return a value in the type of its parameter, or raise a `ParameterError` that names a fix."""
    declared = {parameter.name: parameter for parameter in fields(Parameters)}
    if name not in declared:
        similar = get_close_matches(name, [*declared, *ROS_PARAMETERS], 1)
        listing = "`linkage_vibration_node --help` lists what is valid."
        hint = f"did you mean {similar[0]}?" if similar else listing
        raise ParameterError(f"Parameter {name} is unknown; {hint}")
    parameter = declared[name]
    value = converted(name, value)
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
        example = f"write for example `{name}: {yaml_text(parameter.default)}`"
        fix = "leave it empty if you do not need it" if parameter.default == "" else example
        raise ParameterError(f"Parameter {name} must be {words['valid']}, not {value!r}; {fix}.")
    return value


def with_values(parameters: Parameters, values: Mapping[str, object]) -> Parameters:
    """Return parameters with other values for some of them, given by their names.

    A `ParameterError` says which value is invalid, or which parameters do not fit each other.
    """
    changed = replace(parameters, **{name: check_value(name, v) for name, v in values.items()})
    changed.check_inputs()
    return changed


def is_ros_parameter(name: str) -> bool:
    """Return whether a name is that of a parameter which ROS 2 gives every node."""
    return name.partition(".")[0] in ROS_PARAMETERS


def converted(name: str, value: Any) -> Any:
    """Return a value of YAML or ROS 2 in the type of a parameter if it means the same.

    The integer 1 stands for 1.0, and as a mode for "1". An unknown parameter keeps its value.
    """
    kinds = {parameter.name: type(parameter.default) for parameter in fields(Parameters)}
    kind = kinds.get(name)
    if name == "marker_mode" and type(value) is int:
        return str(value)
    if kind is float and type(value) is int:
        return float(value)
    if kind is tuple and isinstance(value, Iterable) and not isinstance(value, str | bytes):
        items = [float(item) if type(item) is int else item for item in value]
        return tuple(items) if all(type(item) is float for item in items) else items
    return value


def without_markers(settings: Parameters) -> Parameters:
    """Return the parameters with default markers, on which no message of a log depends."""
    defaults = {f.name: f.default for f in fields(Parameters) if f.name.startswith("marker_")}
    return with_values(settings, defaults)


def yaml_text(value: object) -> str:
    """Return a value of a parameter as YAML writes it."""
    plain = list(value) if isinstance(value, tuple) else value
    return str(yaml.safe_dump(plain, default_flow_style=True).splitlines()[0])


def _path(text: str) -> Path | None:
    """Return the path in a parameter, with ``~`` expanded; None if the parameter is empty."""
    return Path(text).expanduser().absolute() if text else None
