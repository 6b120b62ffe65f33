# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP logs of joint states and predictions; knows neither rclpy nor a message type."""
