# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The inputs: what tractors publish (`presets`), and how a message becomes an angle or a speed."""
