# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Exports a table to C and as an FMU, where there is no Python."""
