# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Names of the message types of inputs."""

JOINT_STATE = "sensor_msgs/msg/JointState"
FLOAT64 = "std_msgs/msg/Float64"
IMU = "sensor_msgs/msg/Imu"
CAN_FRAME = "can_msgs/msg/Frame"
ISOBUS_FRAME = "ros2_isobus/msg/IsobusFrame"
