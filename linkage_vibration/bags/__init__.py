# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP, ROS 1 and SQLite bags: reading, writing, recording and recovery; knows no linkage."""
