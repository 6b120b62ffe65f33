# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's parameters: one list for declaring, checking, reading, keeping and the manual."""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar, cast

import yaml

import linkage_vibration
from linkage_vibration.bags.recorder import Limits
from linkage_vibration.bags.writing import COMPRESSIONS
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.excitation import Source
from linkage_vibration.prediction.inputs import INPUTS
from linkage_vibration.prediction.inputs.crank_input import CrankInput, InputError
from linkage_vibration.support.resources import (
    DEFAULT_EXCITATIONS,
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    config_file,
)

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


class ParameterError(LinkageVibrationError):
    """A parameter of the node has a value that it cannot have."""


def _parameter(
    default: Value,
    unit: str,
    valid: str,
    description: str,
    check: Callable[[Value], bool] = lambda value: True,
    *,
    between: tuple[float, float] | None = None,
    live: bool = False,
) -> Value:
    """Return a dataclass field that carries what a declaration and a manual say.

    ``between`` is a range that includes its ends; a ``live`` parameter can be set while the node
    works, all others are read when it is configured.
    """
    if between is not None:
        valid = f"{between[0]:g} to {between[1]:g}"
    metadata = {
        "unit": unit,
        "valid": valid,
        "description": description,
        "check": check,
        "between": between,
        "live": live,
    }
    found: Any = field(default=default, metadata=metadata)
    return found  # type: ignore[no-any-return]


def _speed(source: Source, topic: str) -> float:
    """Return the field of a speed that may be fixed."""
    return _parameter(
        -1.0,
        source.unit,
        "a finite number",
        f"Fixed {source.value} speed; below 0, it is heard on `{topic}` (std_msgs/Float64).",
        math.isfinite,
        live=True,
    )


@dataclass(frozen=True, slots=True)
class Parameters:
    """What the node was asked to do.

    The fields' metadata are the descriptors; their order is the manual's.
    """

    autostart: bool = _parameter(
        True, "", "true or false", "Configure and activate at start, without a lifecycle manager."
    )
    input: str = _parameter(
        "joint_state",
        "",
        " or ".join(INPUTS),
        "Where the crank angle comes from: a joint on `joint_states`, or the hitch position in "
        "percent on `hitch_position` (std_msgs/Float64, 0 down to 100 up).",
        lambda value: value in INPUTS,
        live=True,
    )
    joint_name: str = _parameter(
        "hitch_rockshaft_joint",
        "",
        "the name of a joint",
        "Joint whose position turns the input crank.",
        lambda name: name != "",
        live=True,
    )
    sign: int = _parameter(
        1,
        "1",
        "1 or -1",
        "Sense of the joint: crank angle = sign * scale * position + offset.",
        lambda sign: sign in (1, -1),
        live=True,
    )
    scale: float = _parameter(
        1.0,
        "rad per unit of position",
        "a finite number greater than 0",
        "Change of the crank angle per unit of joint position.",
        lambda scale: 0.0 < scale < math.inf,
        live=True,
    )
    offset: float = _parameter(
        0.0,
        "rad",
        "a finite number",
        "Crank angle at joint position 0.",
        math.isfinite,
        live=True,
    )
    percent_points: tuple[float, ...] = _parameter(
        (0.0, 100.0),
        "%",
        "ascending numbers from 0 to 100",
        "Hitch positions of the calibration from percent to crank angle.",
        live=True,
    )
    percent_angles: tuple[float, ...] = _parameter(
        (3.14159, 1.5708),
        "rad",
        "as many numbers, all ascending or all descending",
        "Crank angles at those hitch positions; a monotone curve leads from one to the next.",
        live=True,
    )
    angle_stddev: float = _parameter(
        0.0,
        "rad",
        "",
        "Standard deviation of the crank angle, carried to the frequencies; that of the percent's "
        "steps of 0.4 is added.",
        between=(0.0, 1.0),
        live=True,
    )
    mechanism_file: str = _parameter(
        "",
        "",
        "the path of a YAML file, or empty",
        "Mechanism; empty for the three-point linkage that ships with the package.",
    )
    table_file: str = _parameter(
        "",
        "",
        "the path of an .npz file, or empty",
        "Table of that mechanism, made by `linkage-vibration build`; empty for the one that ships "
        "with the package, or, where mechanism_file is given, for one computed at start.",
    )
    excitation_file: str = _parameter(
        "",
        "",
        "the path of a YAML file, or empty",
        "What excites the linkage; empty for the orders that ship with the package.",
    )
    engine_speed: float = _speed(Source.ENGINE, "engine_speed")
    pto_speed: float = _speed(Source.PTO, "pto_speed")
    ground_speed: float = _speed(Source.GROUND, "ground_speed")
    warning_margin: float = _parameter(
        0.1,
        "1",
        "",
        "Relative margin of an excitation to a natural frequency below which it warns.",
        between=(0.0, 1.0),
        live=True,
    )
    hysteresis: float = _parameter(
        0.02,
        "1",
        "",
        "By how much the margin has to exceed that until the warning ends.",
        between=(0.0, 1.0),
        live=True,
    )
    stale_after: float = _parameter(
        1.0,
        "s",
        "",
        "Age from which a speed, or the crank angle, is stale.",
        between=(0.01, 3600.0),
        live=True,
    )
    record: bool = _parameter(
        False,
        "",
        "true or false",
        "Whether to begin a log, in MCAP, when the node is activated; `~/start_recording` and "
        "`~/stop_recording` do so at any time.",
    )
    log_directory: str = _parameter(
        "",
        "",
        "the path of a folder that exists, or empty",
        "Where logs go; empty for the current directory.",
    )
    compression: str = _parameter(
        "zstd",
        "",
        ", ".join(COMPRESSIONS),
        "Of logs.",
        lambda value: value in COMPRESSIONS,
    )
    split_size: int = _parameter(
        0,
        "byte",
        "a whole number, 0 for no limit",
        "Size from which a log goes on in another file.",
        lambda size: size >= 0,
    )
    split_duration: float = _parameter(
        0.0,
        "s",
        "a finite number, 0 for no limit",
        "Time after which a log goes on in another file.",
        lambda duration: 0.0 <= duration < math.inf,
    )
    disk_limit: int = _parameter(
        0,
        "byte",
        "a whole number, 0 for no limit",
        "What all logs in the folder may take; recording ends there.",
        lambda size: size >= 0,
    )
    delete_oldest: bool = _parameter(
        False, "", "true or false", "Whether to delete the oldest logs instead."
    )
    extra_topics: str = _parameter(
        "",
        "",
        "names of topics, separated by spaces, or empty",
        "Topics to log as they come, beside those that the node uses.",
    )
    marker_mode: int = _parameter(
        1,
        "1",
        "",
        "Mode that `~/markers` show, an index into the natural frequencies; -1 for none.",
        between=(-1, 1000),
        live=True,
    )
    marker_rate: float = _parameter(
        10.0, "Hz", "", "Pictures a second on `~/markers`.", between=(0.1, 100.0), live=True
    )
    marker_frame: str = _parameter(
        "base_link",
        "",
        "the name of a frame",
        "Frame of `~/markers`: the mechanism's origin, x forward, z up.",
        lambda name: name != "",
        live=True,
    )

    def crank_input(self) -> CrankInput:
        """Return the chosen input with its parameters.

        Raises
        ------
        ParameterError
            If the parameters of the input cannot be used together.
        """
        kind: Any = INPUTS[self.input]
        try:
            return cast(CrankInput, kind(**{f.name: getattr(self, f.name) for f in fields(kind)}))
        except InputError as error:
            raise ParameterError(f"Parameters of the input {self.input}: {error}") from None

    def fixed_speed(self, source: Source) -> float | None:
        """Return a speed that is fixed (rpm, m/s), or None where it is heard."""
        value = {
            Source.ENGINE: self.engine_speed,
            Source.PTO: self.pto_speed,
            Source.GROUND: self.ground_speed,
        }[source]
        return value if value >= 0.0 else None

    def mechanism_path(self) -> Path:
        """Return the mechanism's file."""
        return _path(self.mechanism_file) or config_file(DEFAULT_MECHANISM)

    def table_path(self) -> Path | None:
        """Return the table's file, or None where it is to be built."""
        if self.mechanism_file and not self.table_file:
            return None
        return _path(self.table_file) or config_file(DEFAULT_TABLE)

    def excitation_path(self) -> Path:
        """Return the file that tells what excites the linkage."""
        return _path(self.excitation_file) or config_file(DEFAULT_EXCITATIONS)

    def log_path(self) -> Path:
        """Return the folder of the logs."""
        return _path(self.log_directory) or Path.cwd()

    def limits(self) -> Limits:
        """Return how large logs become."""
        return Limits(self.split_size, self.split_duration, self.disk_limit, self.delete_oldest)


def check_value(name: str, value: object) -> Any:
    """Return the value of a parameter, in its own type.

    Parameters
    ----------
    name : str
        A field of `Parameters`.
    value : object
        What a person gave for it.

    Raises
    ------
    ParameterError
        If it has another type, or is not valid.
    """
    parameter = next(f for f in fields(Parameters) if f.name == name)
    value = own_type(type(parameter.default), value)
    words = parameter.metadata
    between = words["between"]
    if (
        type(value) is not type(parameter.default)
        or (between is not None and not between[0] <= value <= between[1])
        or not words["check"](value)
    ):
        raise ParameterError(
            f"Parameter {name} must be {words['valid']}, not {value!r}; "
            f"write for example `{name}: {_yaml(parameter.default)}`."
        )
    return value


def with_values(parameters: Parameters, values: Mapping[str, object]) -> Parameters:
    """Return parameters of which some have other values.

    Raises
    ------
    ParameterError
        If one has another type than it must, or is not valid.
    """
    return replace(parameters, **{name: check_value(name, v) for name, v in values.items()})


def own_type(kind: type, value: Any) -> Any:
    """Return a value as a parameter's type, where it means the same: YAML's 1 is as good as 1.0."""
    if kind is float and type(value) is int:
        return float(value)
    if kind is tuple and not isinstance(value, str | bytes) and isinstance(value, Iterable):
        items = [own_type(float, item) for item in value]
        return tuple(items) if all(type(item) is float for item in items) else items
    return value


def without_markers(settings: Parameters) -> Parameters:
    """Return the parameters with the defaults of those that messages do not depend on."""
    shown = [parameter for parameter in fields(Parameters) if parameter.name.startswith("marker_")]
    defaults: Any = {parameter.name: parameter.default for parameter in shown}
    return replace(settings, **defaults)


def parameters_yaml(parameters: Parameters, node_name: str) -> str:
    """Return a file for ``--params-file`` that gives a node these parameters."""
    values = {f.name: _plain(getattr(parameters, f.name)) for f in fields(parameters)}
    sections = {node_name: {"ros__parameters": values}}
    return f"# linkage_vibration {linkage_vibration.__version__}\n" + yaml.safe_dump(
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
    """Read a file of parameters as the node does that ``--params-file`` gives it to.

    Of sections that mean the node, the later wins; what is no parameter of it is passed over.

    Raises
    ------
    ParameterError
        If it cannot be read, has no section for the node, or has a value that is not valid.
    """
    path = Path(path)
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        told = " ".join(str(error).split())
        raise ParameterError(f"{path} cannot be read as YAML: {told}.") from None
    sections = content if isinstance(content, dict) else {}
    found = [section for name, section in sections.items() if _means_node(str(name))]
    if not found:
        raise ParameterError(
            f"{path} has no parameters for the node; give them below "
            f"`{NODE_NAME}:` or `/**:` and there `ros__parameters:`."
        )
    known = {parameter.name for parameter in fields(Parameters)}
    values: dict[str, object] = {}
    for section in found:
        given = section.get("ros__parameters") if isinstance(section, dict) else None
        if isinstance(given, dict):
            values.update({name: value for name, value in given.items() if name in known})
    try:
        return with_values(Parameters(), values)
    except (ParameterError, OverflowError) as error:
        raise ParameterError(f"{path}: {error}") from None


def _means_node(section: str) -> bool:
    """Whether a section's name, which may have the wildcards of ROS 2, is that of the node."""
    pattern = re.escape("/" + section.lstrip("/"))
    pattern = pattern.replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
    return re.fullmatch(pattern, f"/{NODE_NAME}") is not None


def parameter_table() -> str:
    """Return the parameters as a Markdown table, for the manual."""
    rows = [
        "| parameter | type | default | unit | valid | live | meaning |",
        "|---|---|---|---|---|---|---|",
    ]
    for parameter in fields(Parameters):
        words = parameter.metadata
        rows.append(
            f"| `{parameter.name}` | {TYPE_NAMES[type(parameter.default)]} "
            f"| `{_yaml(parameter.default)}` | {words['unit']} | {words['valid']} "
            f"| {'yes' if words['live'] else ''} | {words['description']} |"
        )
    return "\n".join(rows) + "\n"


def _path(text: str) -> Path | None:
    """Return the path that a parameter means, if any; no shell has expanded its ``~``."""
    return Path(text).expanduser().absolute() if text else None


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def _yaml(value: object) -> str:
    """Return a scalar or a list as YAML writes it."""
    return yaml.safe_dump(_plain(value), default_flow_style=True).splitlines()[0]
