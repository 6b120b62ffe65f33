# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The messages that the crank angle can come from; a new input is one file and one line here."""

from linkage_vibration.prediction.inputs.crank_input import CrankInput
from linkage_vibration.prediction.inputs.joint_state import JointInput
from linkage_vibration.prediction.inputs.percent import PercentInput

INPUTS: dict[str, type[CrankInput]] = {
    "joint_state": JointInput,
    "percent": PercentInput,
}
"""The values of the parameter ``input``."""
