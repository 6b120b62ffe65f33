# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node and the replay, each declared once.

The ROS parameters, files of parameters (`parameter_files`), the help and the manual follow from it.
"""

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

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
from linkage_vibration.prediction.severity import WarningLimits
from linkage_vibration.support.resources import (
    DEFAULT_EXCITATIONS,
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    command,
    config_file,
)

Value = TypeVar("Value", bool, int, float, str, tuple[float, ...])
Class = TypeVar("Class")

NODE_NAME = "linkage_vibration"
ROS_PARAMETERS = ("qos_overrides", "start_type_description_service", "use_sim_time")
"""The parameters that ROS 2 gives every node."""

_LABELS = {HITCH: "hitch"} | {source.value: source.label for source in Source}
_UNITS = {HITCH: (*ANGLES, *CALIBRATED), ENGINE: ROTATIONS, PTO: ROTATIONS, GROUND: SPEEDS}
_TYPE_NAME = re.compile(r"[a-z][a-z0-9_]*/(msg/)?[A-Z][A-Za-z0-9]*")
_TOPIC_NAME = re.compile(r"(~/|/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


class ParameterError(LinkageVibrationError):
    """A parameter of the node has an invalid value."""


@dataclass(frozen=True)
class _Kind(Generic[Value]):
    """The default of a parameter, its unit, and what is valid."""

    default: Value
    unit: str
    valid: str
    check: Callable[[Any], object] = lambda _: True
    between: tuple[float, float] | None = None  # a range that includes its ends
    live: bool = True  # can be set while the node is active; others are read when it is configured

    def means(self, description: str) -> Value:
        """Return a dataclass field for such a parameter."""
        declared: Any = field(
            default=self.default, metadata={**vars(self), "description": description}
        )
        return declared  # type: ignore[no-any-return]


def _ranged(default: Value, least: float, largest: float, unit: str) -> _Kind[Value]:
    """Return the kind of a number in a range that includes its ends."""

    def is_inside(value: Any) -> bool:
        return bool(least <= value <= largest)

    return _Kind(default, unit, f"{least:g} to {largest:g}", is_inside, (least, largest))


def _rate(default: float, least: float) -> _Kind[float]:
    """Return the kind of a rate that is limited to at least so much, Hz, or not at all."""
    valid = f"0, or {least:g} to 10000"
    return _Kind(default, "Hz", valid, lambda rate: rate == 0.0 or least <= rate <= 1e4)


def _choice(default: Value, choices: Collection[Value], *, live: bool = True) -> _Kind[Value]:
    """Return the kind of a parameter with a few valid values."""
    valid = " or ".join(map(str, choices))
    return _Kind(default, "", valid, choices.__contains__, live=live)


def _switch(default: bool) -> _Kind[bool]:
    return _Kind(default, "", "true or false", live=False)


def _text(
    valid: str, check: Callable[[str], object] = lambda _: True, *, live: bool = False
) -> _Kind[str]:
    """Return the kind of a text that may be empty."""
    return _Kind("", "", f"{valid}, or empty", lambda text: not text or check(text), live=live)


def _limit(default: Value, unit: str) -> _Kind[Value]:
    """Return the kind of a limit of the logs, where 0 means no limit."""
    valid = f"a {'whole' if isinstance(default, int) else 'finite'} number, 0 for no limit"
    return _Kind(default, unit, valid, lambda value: 0 <= value < math.inf, live=False)


def _finite(default: float, unit: str) -> _Kind[float]:
    return _Kind(default, unit, "a finite number", math.isfinite)


def _preset(name: str, quantity: str) -> str:
    """Return the field of the preset of an input."""
    listing = "; ".join(
        f"`{key}` is the {preset.field.replace('{joint_name}', 'joint_name')} of {preset.type} on "
        f"`{preset.topic}`, in {preset.unit}"
        for key, preset in PRESETS[name].items()
    )
    return _choice(next(iter(PRESETS[name])), PRESETS[name]).means(
        f"What publishes the {quantity}: {listing}. Other parameters of the input override it."
    )


def _input(name: str, quantity: str) -> dict[str, Any]:
    """Return the fields that every input has, by their names."""
    ending = f"of the {_LABELS[name]} input. If it is empty, the preset decides."
    kind = "a type such as nav_msgs/msg/Odometry"
    path = "a path such as twist.twist.linear.x, position[boom] or data[0], or a CAN signal"
    units = _UNITS[name]
    checks: dict[str, tuple[str, str, Callable[[str], object]]] = {
        "topic": ("Topic", "the name of a topic", _TOPIC_NAME.fullmatch),
        "type": ("Type of the messages", kind, _TYPE_NAME.fullmatch),
        "field": ("Path to the number in the messages", path, str.isprintable),
        "unit": ("Unit of the number", " or ".join(units), units.__contains__),
    }
    place = {
        f"{name}_{key}": _text(valid, check, live=True).means(f"{words} {ending}")
        for key, (words, valid, check) in checks.items()
    }
    label, unit = _LABELS[name], f"{name}_unit"
    origin = (
        f"Time of the {label} input: the stamp in the header, or the receipt, which is the log "
        "time of a bag. If it is empty, positions have the time of their header, and speeds that "
        "of their receipt."
    )
    delay = (
        f"Time from the moment of a value of the {label} input to its receipt, which is subtracted."
    )
    time = _text(" or ".join(TIMES), TIMES.__contains__, live=True)
    valid = "a finite number greater than 0"
    scale = _Kind(1.0, f"{unit} per unit of the number", valid, lambda x: 0.0 < x < math.inf)
    return {
        f"{name}_input": _preset(name, quantity),
        **place,
        f"{name}_sign": _Kind(1, "1", "1 or -1", (1, -1).__contains__).means(
            "Sign of the input: its value is sign * scale * number + offset."
        ),
        f"{name}_scale": scale.means("Change of the value of the input per unit of the number."),
        f"{name}_offset": _finite(0.0, unit).means("Value of the input at the number 0."),
        f"{name}_time": time.means(origin),
        f"{name}_delay": _ranged(0.0, 0.0, 10.0, "s").means(delay),
    }


def _speed(source: Source) -> dict[str, Any]:
    """Return the fields of a speed, which may be fixed, by their names."""
    name = source.value
    speed = f"{_LABELS[name]} speed"
    fixed = (
        f"Fixed {speed}. If negative, it is read as `{name}_input` says. 0 declares that nothing "
        "on the tractor follows this speed."
    )
    return {f"{name}_speed": _finite(-1.0, source.unit).means(fixed), **_input(name, speed)}


def _with_inputs(cls: type[Class]) -> type[Class]:
    """Add the parameters that all inputs have to a class, each group after a parameter of it."""
    speeds = {name: speed for source in Source for name, speed in _speed(source).items()}
    groups = {"autostart": _input(HITCH, "crank angle"), "implement": speeds}
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
    """The parameters of the node, in the order of the manual; metadata describe each field."""

    autostart: bool = _switch(True).means(
        "Configure and activate the node at start, without a lifecycle manager."
    )
    joint_name: str = _Kind("hitch_rockshaft_joint", "", "the name of a joint", bool).means(
        "Name of the joint that turns the input crank, for the preset `joint_states`."
    )
    calibration: tuple[float, ...] = _Kind(
        (0.0, 3.14159, 100.0, 1.5708),
        "hitch_unit, rad",
        "a position and an angle in turn, all ascending or all descending angles",
        HitchCurve,
    ).means(
        "Hitch positions in percent, m or any other unit, each followed by the crank angle there "
        "(rad). A monotone curve connects them."
    )
    hitch_position: float = _finite(-1.0, "hitch_unit").means(
        "Fixed hitch position, for tractors that report none. If negative, it is read as "
        "`hitch_input` says. Otherwise each message of the first speed that is not fixed gives a "
        "prediction, or each message of the hitch input if `hitch_field` is set."
    )
    angle_stddev: float = _ranged(0.0, 0.0, 1.0, "rad").means(
        "Standard deviation of the crank angle. With positions in percent, that of their steps of "
        "0.4 % is added."
    )
    can_database: str = _text("the path of a DBC file").means(
        "Describes CAN signals that are not built in. The field of an input then names the message "
        "and the signal, as in `RearHitch.Position`."
    )
    mechanism_file: str = _text("the path of a YAML file").means(
        "The mechanism. If it is empty, the shipped three-point linkage on a tractor is used."
    )
    table_file: str = _text("the path of an .npz file").means(
        "The table of this mechanism, as `linkage-vibration build` saves it. If it is empty, the "
        "shipped table is used, or one is built at start for the given mechanism_file "
        "and kept in the user's cache."
    )
    excitation_file: str = _text("the path of a YAML file").means(
        "The excitations. If it is empty, the shipped ones are used."
    )
    sensor_file: str = _text("the path of a YAML file").means(
        "Sensors whose signals are compared with the predictions, on `~/measured`. If it is empty, "
        "none is read."
    )
    implement_file: str = _text("the path of a YAML file").means(
        "Implements that can be chosen by name: by the parameter implement or the action "
        "`~/set_implement`."
    )
    implement: str = _text("the name of an implement in implement_file").means(
        "The implement at start. If it is empty, that of the mechanism is used."
    )
    warning_load_ratio: float = _ranged(0.33, 1e-6, 1e6, "1").means(
        "Warn when the force in a pin or cylinder (root mean square) exceeds this multiple of the "
        "static force there."
    )
    note_load_ratio: float = _ranged(0.1, 1e-6, 1e6, "1").means(
        "Above this load ratio, the state is a note instead of clear."
    )
    near_margin: float = _ranged(0.1, 0.0, 1.0, "1").means(
        "Where no load ratio is known, the state is a note when an excitation frequency is within "
        "this fraction of a natural frequency."
    )
    warning_dwell: float = _ranged(1.0, 0.0, 3600.0, "s").means(
        "A warning begins when its limit has been exceeded for this long, and ends after as long "
        "below it."
    )
    stale_after: float = _ranged(1.0, 0.01, 3600.0, "s").means(
        "A crank angle that arrived longer ago than this is not used, nor a speed that is older."
    )
    prediction_rate: float = _rate(0.0, 0.001).means(
        "Highest rate of `~/prediction`: for the first reading in each period of the stamps. With "
        "0, each reading has a prediction."
    )
    resonance_rate: float = _rate(10.0, 1.0).means(
        "Rate of `~/resonance`, `~/levels` and `~/load_state`, by the stamps: the most severe of "
        "five readings in each period. With 0, each reading."
    )
    record: bool = _switch(False).means(
        "Start an MCAP log when the node is activated. `~/start_recording` and `~/stop_recording` "
        "start and stop a log at any time."
    )
    log_directory: str = _text("the path of a folder that exists").means(
        "The folder of the logs. If it is empty, the current directory is used."
    )
    compression: str = _choice("zstd", COMPRESSIONS, live=False).means("Compression of the logs.")
    split_size: int = _limit(0, "byte").means(
        "A log continues in a new file when it reaches this size."
    )
    split_duration: float = _limit(0.0, "s").means("A log continues in a new file after this time.")
    disk_limit: int = _limit(0, "byte").means(
        "Recording stops when all logs in the folder together reach this size."
    )
    delete_oldest: bool = _switch(False).means(
        "Delete the oldest logs instead of stopping at disk_limit."
    )

    if TYPE_CHECKING:  # type checkers do not see the parameters that the decorator adds

        def __init__(self, **values: Any) -> None: ...
        def __getattr__(self, name: str) -> Any: ...  # noqa: D105

    def source(self, name: str) -> SourceSettings:
        """Return where an input comes from: "hitch", "engine", "pto" or "ground"."""
        fixed = name == HITCH and self.hitch_position >= 0.0
        if fixed and not self.hitch_field:
            for speed in Source:
                if self.fixed_speed(speed) is None:
                    return replace(self.source(speed.value), name=HITCH)
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
            "" if fixed or self._input(name, "scale") != 1.0 else self._chosen(name, "unit"),
            replaced,
        )

    def speed_sources(self) -> dict[Source, SourceSettings]:
        """Return where the speeds come from, also those that are fixed."""
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
        """Return a parameter of an input."""
        return getattr(self, f"{name}_{what}")

    def _chosen(self, name: str, what: str) -> str:
        """Return the text in a parameter of an input, or in its preset if that is empty."""
        preset = PRESETS[name][self._input(name, "input")]
        return str(self._input(name, what) or getattr(preset, what))

    def _hitch_scale(self) -> HitchScale:
        unit, calibration = self._chosen(HITCH, "unit"), HitchCurve(self.calibration)
        linear, fixed = (self.hitch_sign, self.hitch_scale, self.hitch_offset), math.nan
        if self.hitch_position >= 0.0:
            linear, fixed = (1, 1.0, 0.0), self.hitch_position
        return HitchScale(unit, *linear, calibration, self.angle_stddev, fixed)

    def fixed_speed(self, source: Source) -> float | None:
        """Return a fixed speed (rpm or m/s), or None if the speed is read from its topic."""
        value: float = self._input(source.value, "speed")
        return value if value >= 0.0 else None

    def warning_limits(self) -> WarningLimits:
        """Return when an excitation warns."""
        return WarningLimits(
            self.warning_load_ratio, self.note_load_ratio, self.warning_dwell, self.near_margin
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

    def sensor_path(self) -> Path | None:
        """Return the file of the sensors, or None if there is none."""
        return _path(self.sensor_file)

    def log_path(self) -> Path:
        """Return the folder of the logs."""
        return _path(self.log_directory) or Path.cwd()


DECLARED: dict[str, Any] = Parameters.__dataclass_fields__
"""The fields of the parameters by their names."""


def check_value(name: str, value: object) -> Any:
    """Return a value in the type of its parameter, or raise a `ParameterError` that names a fix."""
    parameter = DECLARED.get(name)
    if parameter is None:
        similar = get_close_matches(name, [*DECLARED, *ROS_PARAMETERS], 1)
        similar = [f"hitch_{name}"] if f"hitch_{name}" in DECLARED else similar
        listing = f"`{command('--help', 'linkage_vibration_node')}` lists what is valid."
        hint = f"did you mean {similar[0]}?" if similar else listing
        raise ParameterError(f"Parameter {name} is unknown; {hint}")
    value, words = converted(name, value), parameter.metadata
    try:
        valid = type(value) is type(parameter.default) and words["check"](value)
    except InputError as error:
        raise ParameterError(f"Parameter {name}: {error}") from None
    if not valid:
        example = f"write for example `{name}: {yaml_text(parameter.default)}`"
        fix = "leave it empty if you do not need it" if parameter.default == "" else example
        raise ParameterError(f"Parameter {name} must be {words['valid']}, not {value!r}; {fix}.")
    return value


def with_values(parameters: Parameters, values: Mapping[str, object]) -> Parameters:
    """Return parameters with other values by their names, or raise a `ParameterError`."""
    changed = replace(parameters, **{name: check_value(name, v) for name, v in values.items()})
    changed.check_inputs()
    return changed


def is_ros_parameter(name: str) -> bool:
    """Return whether a name is that of a parameter which ROS 2 gives every node."""
    return name.partition(".")[0] in ROS_PARAMETERS


def converted(name: str, value: Any) -> Any:
    """Return a value in the type of its parameter if it means the same, such as 1 for 1.0."""
    kind = type(DECLARED[name].default) if name in DECLARED else None
    if kind is str and type(value) is int:
        return str(value)
    if kind is float and type(value) in (int, str):  # `ros2 param load` has the text "1e-05"
        with suppress(ValueError):
            return float(value)
    if kind is tuple and isinstance(value, Iterable) and not isinstance(value, str | bytes):
        items = [float(item) if type(item) is int else item for item in value]
        return tuple(items) if all(type(item) is float for item in items) else items
    return value


def yaml_text(value: object) -> str:
    """Return a value of a parameter as YAML writes it."""
    plain = list(value) if isinstance(value, tuple) else value
    return str(yaml.safe_dump(plain, default_flow_style=True).splitlines()[0])


def _path(text: str) -> Path | None:
    """Return the path in a parameter, with ``~`` expanded; None if the parameter is empty."""
    return Path(text).expanduser().absolute() if text else None
