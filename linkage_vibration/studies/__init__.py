# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Studies of a mechanism: planning a model, measurement and calibration."""
