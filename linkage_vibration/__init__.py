# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Predict how a linkage vibrates from the angle of its input crank.

The names in `__all__` are the public API; CONTRIBUTING says how it may change. Each name is
imported when it is first used, so that importing the package is fast.
"""

from importlib import import_module

TYPE_CHECKING = False  # That of typing would take most of the time of this import.
if TYPE_CHECKING:
    from linkage_vibration.errors import LinkageVibrationError
    from linkage_vibration.mechanics.description import Mechanism
    from linkage_vibration.mechanics.frf import Frf
    from linkage_vibration.mechanics.ground_motion import transmissibility
    from linkage_vibration.mechanics.kinematics import Configuration, Kinematics, Toggle
    from linkage_vibration.mechanics.model import (
        IdentifiedSolution,
        LinkageModel,
        ModeShape,
        Solution,
    )
    from linkage_vibration.mechanics.response import Peak, PoleResidue
    from linkage_vibration.messages.columns import MessageColumns
    from linkage_vibration.playback.replay import Replayed, WhatIf, replay
    from linkage_vibration.prediction.parameter_files import read_parameters
    from linkage_vibration.prediction.predictor import Prediction, Predictor, Status
    from linkage_vibration.prediction.settings import Parameters
    from linkage_vibration.readers.mechanism import read_mechanism
    from linkage_vibration.review.log import Log, read_log
    from linkage_vibration.review.overview import summaries
    from linkage_vibration.review.picture import plot
    from linkage_vibration.studies.sweep import sweep
    from linkage_vibration.support.version import __version__ as __version__
    from linkage_vibration.table.table import Table, load_table, save_table
    from linkage_vibration.table.tabulation.building import build_table
    from linkage_vibration.testing.bag_checks import Failure, Report, check_bag
    from linkage_vibration.testing.limits import Limits

_MODULES = {
    "errors": ["LinkageVibrationError"],
    "mechanics.description": ["Mechanism"],
    "mechanics.frf": ["Frf"],
    "mechanics.ground_motion": ["transmissibility"],
    "mechanics.kinematics": ["Configuration", "Kinematics", "Toggle"],
    "mechanics.model": ["IdentifiedSolution", "LinkageModel", "ModeShape", "Solution"],
    "mechanics.response": ["Peak", "PoleResidue"],
    "messages.columns": ["MessageColumns"],
    "playback.replay": ["Replayed", "WhatIf", "replay"],
    "prediction.parameter_files": ["read_parameters"],
    "prediction.predictor": ["Prediction", "Predictor", "Status"],
    "prediction.settings": ["Parameters"],
    "readers.mechanism": ["read_mechanism"],
    "review.log": ["Log", "read_log"],
    "review.overview": ["summaries"],
    "review.picture": ["plot"],
    "studies.sweep": ["sweep"],
    "support.version": ["__version__"],
    "table.table": ["Table", "load_table", "save_table"],
    "table.tabulation.building": ["build_table"],
    "testing.bag_checks": ["Failure", "Report", "check_bag"],
    "testing.limits": ["Limits"],
}
_HOMES = {name: f"{__name__}.{module}" for module, names in _MODULES.items() for name in names}

# fmt: off
__all__ = [
    "Configuration", "Failure", "Frf", "IdentifiedSolution", "Kinematics", "Limits",
    "LinkageModel", "LinkageVibrationError", "Log", "Mechanism", "MessageColumns", "ModeShape",
    "Parameters", "Peak", "PoleResidue", "Prediction", "Predictor", "Replayed", "Report",
    "Solution", "Status", "Table", "Toggle", "WhatIf", "build_table", "check_bag", "load_table",
    "plot", "read_log", "read_mechanism", "read_parameters", "replay", "save_table", "summaries",
    "sweep", "transmissibility",
]
# fmt: on


if not TYPE_CHECKING:  # For a type checker it would stand for any name.

    def __getattr__(name: str) -> object:
        """Import a name of the public API when it is first used."""
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from linkage_vibration.support.version import check_versions

        check_versions()
        globals()[name] = value = getattr(import_module(_HOMES[name]), name)
        return value


def __dir__() -> list[str]:
    """Return the public API, which an editor offers."""
    return [*__all__, "__version__"]
