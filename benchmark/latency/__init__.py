# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How much longer a prediction takes than an echo."""
