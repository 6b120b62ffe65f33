# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Vibration of a linkage mechanism, predicted from the angle of its crank."""

from importlib.metadata import version

__version__ = version("linkage_vibration")
