# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What several subcommands have in common: arguments, and the model or the parameters they name."""

import argparse
import math
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from linkage_vibration.errors import LinkageVibrationError

if TYPE_CHECKING:
    from linkage_vibration.mechanics.model import LinkageModel
    from linkage_vibration.prediction.answers import LoadedModel
    from linkage_vibration.prediction.excitation import Excitation
    from linkage_vibration.prediction.levels import LevelTable
    from linkage_vibration.prediction.settings import Parameters

_MECHANISM = "YAML file of the mechanism, or its table (default: the shipped tractor with a hitch)"
_MOST_ANGLES = 100_000


def add_remap(parser: "argparse.ArgumentParser | argparse._ArgumentGroup") -> None:
    """Declare the option that says which topics of bags take the place of those of the node."""
    text = "topic in the bags for a topic of the node, such as joint_states, hitch_position, "
    text += "engine_speed, pto_speed or ground_speed"
    parser.add_argument("--remap", nargs="+", default=[], metavar="NAME:=TOPIC", help=text)


def add_inputs(parser: "argparse.ArgumentParser | argparse._ArgumentGroup") -> None:
    """Declare the options that say how bags are read, and of which mechanism they are."""
    parser.add_argument("--params-file", type=Path, help="YAML file of the node's parameters")
    text = "joint that turns the crank (default: the parameter joint_name)"
    parser.add_argument("--joint", help=text)
    parser.add_argument("--mechanism", type=Path, metavar="FILE", help=_MECHANISM)
    add_remap(parser)


def add_mechanism(parser: argparse.ArgumentParser, name: str = "--mechanism") -> None:
    """Declare the argument of a mechanism, as an option where other files come first."""
    more: dict[str, Any] = (
        {"metavar": "FILE"} if name.startswith("-") else {"metavar": "MECHANISM", "nargs": "?"}
    )
    parser.add_argument(name, type=Path, help=_MECHANISM, **more)


def add_mechanism_and_angles(parser: argparse.ArgumentParser, without: str) -> None:
    """Declare a mechanism and crank angles, deg, as words in a row; both may be left out."""

    class Split(argparse.Action):
        def __call__(self, parser: Any, options: Any, values: Any, option: Any = None) -> None:
            files = [each for each in values if isinstance(each, Path)]
            if files != values[: len(files)] or len(files) > 1:
                parser.error(f"{files[-1]} is no angle; give one mechanism, and then angles.")
            options.mechanism = files[0] if files else None
            options.angles_deg = [angle for angles in values[len(files) :] for angle in angles]

    text = f"{_MECHANISM}, and then crank angles alpha3 in degrees, each as one number or as "
    text += f"FIRST:LAST:STEP (default: {without})"
    add: Any = parser.add_argument
    add("words", nargs="*", type=_word, action=Split, metavar="MECHANISM|ANGLE", help=text)


def add_implement_mass(parser: argparse.ArgumentParser) -> None:
    """Declare the mass of the implement, or a range of it."""
    text = "predict as if the implement had this mass; of a range, as FIRST:LAST (five masses) or "
    text += "FIRST:LAST:STEP, the worst is shown (default: the mass of the mechanism)"
    parser.add_argument("--implement-mass", type=_masses, default=[], metavar="KG", help=text)


def _masses(text: str) -> list[float]:
    """Return the masses of a range, kg, also its last one, or one mass."""
    first, *others = text.split(":")
    if len(others) == 1:
        with suppress(ValueError):
            text += f":{(float(others[0]) - float(first)) / 4.0!r}"
    masses, last = _numbers(text, "mass"), float(others[0] if others else first)
    return masses if math.isclose(masses[-1], last) else [*masses, last]


def _word(text: str) -> Path | list[float]:
    """Return the angles of FIRST:LAST:STEP, or one angle; a word like none of both is a path."""
    if not re.match(r"-?\.?\d", text) or text.endswith((".yaml", ".yml", ".npz")):
        return Path(text)
    return _numbers(text, "angle")


def _numbers(text: str, what: str) -> list[float]:
    """Return the numbers of FIRST:LAST:STEP, or one number; an error says what they are."""
    try:
        first, *more = (float(part) for part in text.split(":"))
    except ValueError:
        first, more = math.nan, [math.nan]
    if not more:
        return [first]
    if len(more) != 2 or not more[1] * (more[0] - first) >= 0.0 < abs(more[1]):
        raise argparse.ArgumentTypeError(f"{text!r} is no {what} and no FIRST:LAST:STEP.")
    count = (more[0] - first) / more[1] * (1.0 + 1e-9)
    if not count < _MOST_ANGLES:
        problem = f"{text!r} has over {_MOST_ANGLES} numbers; widen the step."
        raise argparse.ArgumentTypeError(problem)
    return [first + i * more[1] for i in range(int(count) + 1)]


def read_settings(options: argparse.Namespace, **more: Any) -> "Parameters":
    """Return the parameters that the options of `add_inputs` or a mechanism and others name."""
    from linkage_vibration.prediction.parameter_files import read_parameters
    from linkage_vibration.prediction.settings import Parameters, with_values

    file = getattr(options, "params_file", None)
    settings = read_parameters(file) if file else Parameters()
    source, table = options.mechanism, more.get("table_file")
    if source is not None and source.suffix == ".npz":
        source, table = None, source
    if source is None and table is not None:
        source = mechanism_of_table(table)
    elif source is not None and table is None:
        table = _table_of(source)
    given = {"mechanism_file": source, **more, "table_file": table}
    values = {k: str(v) if isinstance(v, Path) else v for k, v in given.items() if v is not None}
    settings = with_values(settings, values)
    if not settings.mechanism_file:
        warn(f"No mechanism is given; this is the shipped {settings.mechanism_path()}.")
    return settings


def mechanism_file(options: argparse.Namespace) -> Path:
    """Return the path of the mechanism that the options name, or of the shipped one."""
    source: Path | None = options.mechanism
    if source is None:
        return read_settings(options).mechanism_path()
    return mechanism_of_table(source) if source.suffix == ".npz" else source


def mechanism_of_table(path: Path) -> Path:
    """Return the file of the mechanism of a table: beside it, or one that is shipped."""
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.support.resources import DEFAULT_MECHANISM, config_file
    from linkage_vibration.table.table import TableError, load_table

    table, beside = load_table(path), path.with_suffix(".yaml")
    for file in (beside, *sorted(config_file(DEFAULT_MECHANISM).parent.glob("*.yaml"))):
        with suppress(LinkageVibrationError):
            if read_mechanism(file).model_hash == table.model_hash:
                return file
    problem = f"its mechanism, {table.mechanism_name}, is neither {beside} nor a shipped one"
    raise TableError(f"{path}: {problem}; give the YAML file of the mechanism.")


def _table_of(source: Path) -> Path | None:
    """Return the file of a table that was built from a mechanism, if there is one."""
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.table.table import load_table

    for folder in (source.parent, Path(), source.parent / "tables"):
        path = folder / f"{source.stem}.npz"
        with suppress(LinkageVibrationError):
            if path.is_file() and load_table(path).model_hash == read_mechanism(source).model_hash:
                warn(f"The table {path} is used.")
                return path
    return None


def warn(text: str) -> None:
    """Print a sentence to the standard error."""
    print(text, file=sys.stderr)


def read_table(settings: "Parameters") -> "LoadedModel":
    """Return the mechanism and its table; one that is built is kept for later."""
    from linkage_vibration.prediction.level_cache import kept_table
    from linkage_vibration.readers.loaded_model import load_model

    return load_model(settings, warn, keep=kept_table)


def read_variants(settings: "Parameters", masses: Sequence[float]) -> "list[LoadedModel]":
    """Return the mechanism and its table with each mass of the implement, kg, or as described."""
    from linkage_vibration.prediction.level_cache import kept_table
    from linkage_vibration.readers.loaded_model import load_variants

    return load_variants(settings, masses, warn, kept_table) if masses else [read_table(settings)]


def read_levels(
    settings: "Parameters", masses: Sequence[float] = ()
) -> "tuple[list[LoadedModel], Sequence[Excitation], list[LevelTable]]":
    """Return what `read_variants` does, with the excitations of parameters and their levels."""
    from linkage_vibration.prediction.doubts import excitation_doubts
    from linkage_vibration.prediction.levels import LevelTable, kept_levels
    from linkage_vibration.readers.loaded_model import read_loads

    served = read_variants(settings, masses)
    excitations = read_loads(settings, served[0], warn)
    make = LevelTable if len(served) > 1 else kept_levels  # The cache has no room for many.
    levels = [make(each.predictor, each.mechanism, excitations) for each in served]
    for i, each in enumerate(levels):
        which = f" with {masses[i]:.5g} kg" if len(masses) > 1 else ""
        for doubt in excitation_doubts(excitations, each):
            warn(f"{settings.excitation_path()}{which}: {doubt}")
    return served, excitations, levels


def read_model(source: Path) -> "LinkageModel":
    """Return the model of a mechanism, after what is doubtful about it."""
    from linkage_vibration.mechanics.model import LinkageModel
    from linkage_vibration.prediction.doubts import linkage_doubts
    from linkage_vibration.readers.mechanism import read_mechanism

    model = LinkageModel(read_mechanism(source))
    for doubt in linkage_doubts(model):
        print(f"{source}: {doubt}\n")
    return model
