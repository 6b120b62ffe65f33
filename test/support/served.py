# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The shipped mechanism and its table, as the node serves them, and a table of many tests."""

from functools import partial

from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.prediction.answers import LoadedModel, ModelWithoutTable
from linkage_vibration.prediction.level_cache import kept_table
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import Table, load_table
from linkage_vibration.table.tabulation import build_table


def shipped() -> LoadedModel:
    """Return what the node serves by default."""
    path = config_file(DEFAULT_MECHANISM)
    mechanism = read_mechanism(path)
    table = load_table(config_file(DEFAULT_TABLE), mechanism)
    return ModelWithoutTable(mechanism, path.read_text()).with_predictor(Predictor(table))


def turning_table() -> Table:
    """Return a coarse table of a crank that turns all the way; one test builds it for all."""
    mechanism = read_mechanism(config_file("four_bar.yaml"))
    return kept_table(mechanism, partial(build_table, LinkageModel(mechanism), 1e-2), "coarse")
