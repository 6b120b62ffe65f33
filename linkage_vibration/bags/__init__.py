# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Reads, writes, records and recovers bags (MCAP, ROS 1, SQLite); knows nothing of linkages."""
