# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated drives with sensors, and what `search_modes` reports of them."""
