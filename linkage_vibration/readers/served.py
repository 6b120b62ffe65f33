# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the mechanism and the table that the parameters name, and builds a missing table."""

from collections.abc import Callable

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.answers import Served
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.readers.mechanism import load_yaml, mechanism_of
from linkage_vibration.table.table import load_table
from linkage_vibration.table.tabulation import build_table


def read_served(
    settings: Parameters,
    report: Callable[[str], object] = lambda text: None,
    check: Callable[[], None] = lambda: None,
) -> Served:
    """Return a mechanism with its table, which is built if the parameters name no table.

    Parameters
    ----------
    settings : Parameters
        They name the files.
    report : callable
        It is called with a sentence before a table is built, as that takes seconds.
    check : callable
        It is called repeatedly while the table is built, and raises an error to stop that.

    Raises
    ------
    LinkageVibrationError
        If a file cannot be used, or the mechanism cannot be tabulated.
    """
    path, table_path = settings.mechanism_path(), settings.table_path()
    content, text = load_yaml(path)
    mechanism = mechanism_of(content, path)
    if table_path is not None:
        table = load_table(table_path, mechanism)
    else:
        report(
            f"Building the table of {path}, as table_file is not given; "
            "`linkage-vibration build` saves a table, which then loads at once."
        )
        table = build_table(LinkageModel(mechanism), progress=lambda _: check())
    return Served(Predictor(table), mechanism, text)
