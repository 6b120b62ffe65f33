# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The shipped mechanism and its table, as the node serves them."""

from linkage_vibration.prediction.answers import LoadedModel, ModelWithoutTable
from linkage_vibration.prediction.predictor import Predictor
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.support.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
from linkage_vibration.table.table import load_table


def shipped() -> LoadedModel:
    """Return what the node serves by default."""
    path = config_file(DEFAULT_MECHANISM)
    mechanism = read_mechanism(path)
    table = load_table(config_file(DEFAULT_TABLE), mechanism)
    return ModelWithoutTable(mechanism, path.read_text()).with_predictor(Predictor(table))
