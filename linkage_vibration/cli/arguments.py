# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What several subcommands have in common: arguments, and the model or the parameters they name."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from linkage_vibration.mechanics.model import LinkageModel
    from linkage_vibration.prediction.answers import Served
    from linkage_vibration.prediction.excitation import Excitation
    from linkage_vibration.prediction.levels import LevelTable
    from linkage_vibration.prediction.settings import Parameters

SHIPPED = "YAML file (default: the shipped linkage)"


def add_remap(parser: argparse.ArgumentParser) -> None:
    """Declare the option that says which topics of bags take the place of those of the node."""
    text = "topic in the bags for a topic of the node, such as joint_states, hitch_position, "
    text += "engine_speed, pto_speed or ground_speed"
    parser.add_argument("--remap", nargs="+", default=[], metavar="NAME:=TOPIC", help=text)


def add_inputs(parser: argparse.ArgumentParser) -> None:
    """Declare the options that say how bags are read, and of which mechanism they are."""
    parser.add_argument("--params-file", type=Path, help="YAML file of the node's parameters")
    text = "joint that turns the crank (default: the parameter joint_name)"
    parser.add_argument("--joint", help=text)
    parser.add_argument("--mechanism", type=Path, help=SHIPPED)
    add_remap(parser)


def read_settings(options: argparse.Namespace, **more: Any) -> "Parameters":
    """Return the parameters that the options of `add_inputs` or `add_table` and others name."""
    from linkage_vibration.prediction.parameter_files import read_parameters
    from linkage_vibration.prediction.settings import Parameters, with_values

    file = getattr(options, "params_file", None)
    settings = read_parameters(file) if file else Parameters()
    given = {"mechanism_file": options.mechanism, **more}
    values = {name: value for name, value in given.items() if value is not None}
    return with_values(
        settings, {name: str(v) if isinstance(v, Path) else v for name, v in values.items()}
    )


def mechanism_file(options: argparse.Namespace) -> Path:
    """Return the path of the mechanism that the options name, or of the shipped one."""
    from linkage_vibration.prediction.settings import Parameters

    return Parameters(mechanism_file=str(options.mechanism or "")).mechanism_path()


def add_table(parser: argparse.ArgumentParser) -> None:
    """Declare the options that name a mechanism and its table."""
    parser.add_argument("--mechanism", type=Path, help=SHIPPED)
    parser.add_argument("--table", type=Path, help="table to use (default: the shipped one)")


def warn(text: str) -> None:
    """Print a sentence to the standard error."""
    print(text, file=sys.stderr)


def read_table(settings: "Parameters") -> "Served":
    """Return the mechanism and the table that parameters name, with a bar while one is built."""
    from linkage_vibration.readers.served import read_served
    from linkage_vibration.support.progress import table_bar

    with table_bar("table") as building:
        return read_served(settings, warn, building)


def read_levels(settings: "Parameters") -> "tuple[Served, Sequence[Excitation], LevelTable]":
    """Return what `read_table` does, with the excitations that parameters name and their levels."""
    from linkage_vibration.prediction.doubts import excitation_doubts
    from linkage_vibration.prediction.levels import kept_levels
    from linkage_vibration.readers.served import read_loads

    served = read_table(settings)
    excitations = read_loads(settings, served, warn)
    levels = kept_levels(served.predictor, served.mechanism, excitations)
    for doubt in excitation_doubts(excitations, levels):
        warn(f"{settings.excitation_path()}: {doubt}")
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
