# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's command line: its help, and errors that name the closest valid argument."""

import ast
import re
from collections.abc import Sequence
from dataclasses import fields
from difflib import get_close_matches
from textwrap import fill

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.topics import INPUT_TOPICS
from linkage_vibration.prediction.settings import Parameters

USAGE = """\
usage: linkage_vibration_node [--help] [--ros-args [-p PARAMETER:=VALUE] [--params-file FILE]
                              [-r OLD:=NEW] [--log-level LEVEL] [-e ENCLAVE]]
"""
_PARAMETERS = [parameter.name for parameter in fields(Parameters)]
_VALID = {
    "help": "--help",
    "ros-args": "--ros-args",
    "param": "--ros-args -p PARAMETER:=VALUE",
    "params-file": "--ros-args --params-file FILE",
    "remap": "--ros-args -r OLD:=NEW",
    "log-level": "--ros-args --log-level LEVEL",
    "enclave": "--ros-args -e ENCLAVE",
    "__node": "--ros-args -r __node:=NAME",
    "__ns": "--ros-args -r __ns:=NAMESPACE",
    **{topic.name: f"--ros-args -r {topic.name}:=TOPIC" for topic in INPUT_TOPICS},
    **{name: f"--ros-args -p {name}:=VALUE" for name in _PARAMETERS},
}


class StartError(LinkageVibrationError):
    """The node cannot be started with these arguments, or in this environment."""


def help_text() -> str:
    """Return what ``--help`` prints: the usage, and every parameter with its default."""
    parts = [USAGE, "Predicts how a linkage vibrates from each reading of its crank angle.\n"]
    parts.append("ROS 2 reads the arguments after --ros-args. The parameters are:\n")
    for parameter in fields(Parameters):
        text = f"{parameter.metadata['description']} Default: {parameter.default!r}."
        indent = "      "
        parts.append(
            f"  {parameter.name}\n"
            + fill(text, 96, initial_indent=indent, subsequent_indent=indent)
        )
    return "\n".join(parts) + "\n"


def check_arguments(arguments: Sequence[str]) -> None:
    """Refuse the first argument that is not behind ``--ros-args``.

    rcl would take some of them for remappings, in the syntax of ROS 1.

    Raises
    ------
    StartError
        If there is such an argument.
    """
    of_ros = False
    for argument in arguments:
        if argument == "--ros-args":
            of_ros = True
        elif argument == "--" and of_ros:
            of_ros = False
        elif not of_ros:
            raise _unknown(argument)


def _unknown(argument: str) -> StartError:
    """Return the error about an argument, which names the closest valid one."""
    name = re.split(r":?=", argument.lstrip("-"))[0]
    similar = get_close_matches(name, _VALID, 1)
    hint = f"did you mean `{_VALID[similar[0]]}`?" if similar else "`--help` lists what is valid."
    return StartError(f"Argument {argument} is unknown; {hint}")


def refusal(error: RuntimeError) -> StartError:
    """Return an error of rcl as one sentence without its places in the source code."""
    text = re.sub(r",? at /\S+:\d+", "", str(error)).strip().rstrip(".")
    if text.startswith("["):  # arguments behind --ros-args that rcl does not know
        return _unknown(ast.literal_eval(text)[0])
    sentence = re.sub(r"\s*\n\s*", "; ", text)
    return StartError(f"ROS 2 cannot start the node: {sentence}.")
