# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's command line: its help, and errors about invalid arguments."""

import ast
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from textwrap import fill

from rclpy.exceptions import NameValidationException

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.parameter_files import has_parameters, missing_section
from linkage_vibration.prediction.settings import ParameterError, Parameters

USAGE = """\
usage: linkage_vibration_node [--help] [--ros-args [-p PARAMETER:=VALUE] [--params-file FILE]
                              [-r OLD:=NEW] [--log-level LEVEL] [-e ENCLAVE]]
"""

LAUNCH_PREFIX = "launch_params_"  # of files in which launch_ros passes what others give by ``-p``


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
    """Refuse arguments before ``--ros-args``, of which rcl takes some for remappings of ROS 1."""
    of_ros = False
    for argument in arguments:
        if argument == "--ros-args":
            of_ros = True
        elif argument == "--" and of_ros:
            of_ros = False
        elif not of_ros:
            raise _unknown(argument)


def _unknown(argument: str) -> StartError:
    """Return the error that an argument is unknown."""
    return StartError(
        f"Argument {argument} is unknown; write parameters as `--ros-args -p PARAMETER:=VALUE` and "
        "topics as `--ros-args -r OLD:=NEW`, or see `--help`."
    )


def unused_files(arguments: Sequence[str], node_name: str) -> list[str]:
    """Return a sentence about each file that has no parameters of the node; raise it for all."""
    files = [Path(file) for option, file in pairwise(arguments) if option == "--params-file"]
    files = [file for file in files if not file.name.startswith(LAUNCH_PREFIX)]
    unused = [
        missing_section(file, node_name) for file in files if not has_parameters(file, node_name)
    ]
    if files and len(unused) == len(files):  # The node would run on its defaults.
        raise ParameterError(unused[0])
    return unused


@contextmanager
def start_errors() -> Iterator[None]:
    """Turn the errors with which rcl and rclpy refuse to start into a `StartError`."""
    try:
        yield
    except NameValidationException as error:
        problem = str(error).splitlines()[0].rstrip(":")
        raise StartError(f"ROS 2 cannot start: {problem}; choose another name.") from None
    except ValueError as error:
        if "NOT_SET" not in str(error):  # rclpy declares the parameters that were given
            raise
        raise StartError(
            "A parameter was given without a value, for example as an empty list; give it a value."
        ) from None
    except RuntimeError as error:  # of rcl, such as an invalid argument or missing security
        raise refusal(error) from None


def plain_text(error: Exception) -> str:
    """Return an error of rcl in one line, without file names, line numbers and the last stop."""
    text = re.sub(r",? at /\S+:\d+", "", str(error)).strip().rstrip(".")
    return re.sub(r"\s*\n\s*", "; ", text)


def refusal(error: RuntimeError) -> StartError:
    """Return an error of rcl as the reason why the node cannot start."""
    text = plain_text(error)
    if text.startswith("["):  # arguments behind --ros-args that rcl does not know
        return _unknown(ast.literal_eval(text)[0])
    if os.environ.get("ROS_SECURITY_ENABLE") == "true":  # rcl may not name it
        text += (
            "; ROS_SECURITY_ENABLE is true, so check ROS_SECURITY_KEYSTORE, the enclave, and "
            "whether this DDS was built with security"
        )
    return StartError(f"ROS 2 cannot start: {text}.")
