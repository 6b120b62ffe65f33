# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's linkage, with three modes, with which node, replay and page are measured."""

from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.support.resources import PAPER_MECHANISM, PAPER_TABLE, config_file

PARAMETERS = Parameters(
    mechanism_file=str(config_file(PAPER_MECHANISM)), table_file=str(config_file(PAPER_TABLE))
)
ARGUMENTS = ["-p", f"mechanism_file:={PARAMETERS.mechanism_file}"]
ARGUMENTS += ["-p", f"table_file:={PARAMETERS.table_file}"]
"""Parameters of the node on its command line, after ``--ros-args``."""
