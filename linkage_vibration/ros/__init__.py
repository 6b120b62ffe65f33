# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 node; only this room imports rclpy."""
