# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Remembers the implement in use over a restart, in a file below ``ROS_HOME``."""

import os
from dataclasses import asdict, replace
from pathlib import Path

import yaml
from rclpy.impl.rcutils_logger import RcutilsLogger

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.answers import Implement, Implements, with_implement
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.mechanism import load_yaml
from linkage_vibration.support.atomic_files import make_folder, write_text


class _MemoryError(LinkageVibrationError):
    """The file cannot be used."""


class Memory:
    """The file in which a node keeps the implement in use, below ``ROS_HOME`` or else ``~/.ros``.

    It is used while ``implement_file`` is given. Other values of ``mechanism_file``,
    ``implement_file`` or ``implement`` than when it was written replace what it says.
    """

    def __init__(self, node_name: str, settings: Parameters, logger: RcutilsLogger) -> None:
        home = os.environ.get("ROS_HOME") or Path.home() / ".ros"
        name = node_name.strip("/").replace("/", ".")
        self.path = Path(home) / "linkage_vibration" / f"{name}.yaml"
        self._used, self._logger = bool(settings.implement_file), logger
        names = ("mechanism_file", "implement_file", "implement")
        self._given = {key: getattr(settings, key) for key in names}

    def recall(self, implements: Implements) -> Implement | None:
        """Return the implement that was in use; None if none is known, or it cannot be used."""
        if not self._used or not self.path.exists():
            return None
        try:
            implement = self._read(implements)
        except LinkageVibrationError as error:
            self._logger.warning(
                f"The remembered implement is not used, but that of the parameters. {error}"
            )
            return None
        if implement is None:
            self._logger.info(
                f"The parameters have changed since {self.path} was written, so they decide on the "
                "implement."
            )
        else:
            self._logger.info(
                f"The implement that was in use before is used again: "
                f"{implement.name or 'unnamed'} (delete {self.path} to use that of the parameters)."
            )
        return implement

    def keep(self, implement: Implement) -> None:
        """Write the implement in use."""
        if not self._used:
            return
        values = asdict(implement) | {"centre_of_gravity": [*implement.centre_of_gravity]}
        text = yaml.safe_dump({"parameters": self._given, "implement": values}, sort_keys=False)
        text = (
            f"# The node reads this when it is configured. Delete it to use the parameters.\n{text}"
        )
        try:
            make_folder(self.path.parent, _MemoryError)
            write_text(self.path, text, _MemoryError)
        except LinkageVibrationError as error:
            self._logger.warning(f"The implement will not be remembered over a restart: {error}")

    def _read(self, implements: Implements) -> Implement | None:
        """Return the implement of the file; None if the parameters have changed since."""
        try:
            content = load_yaml(self.path)[0]
            implement = Implement(**content["implement"])
            if content["parameters"] != self._given:
                return None
            if implement.name:
                return implements.find(implement.name)
            implement = replace(implement, centre_of_gravity=(*implement.centre_of_gravity,))
            with_implement(implements.mechanism, implements.mechanism_text, implement)
        except LinkageVibrationError as error:
            where = "" if str(self.path) in str(error) else f"{self.path}: "
            raise _MemoryError(f"{where}{error}") from None
        except (KeyError, TypeError) as error:
            raise _MemoryError(f"{self.path}: is damaged ({error!r}); delete it.") from None
        return implement
