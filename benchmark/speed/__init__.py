# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Compares error and time of all methods on one linkage; see docs/performance.md."""
