# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""From a reading to a prediction: inputs, the predictor, excitations and resonances."""
