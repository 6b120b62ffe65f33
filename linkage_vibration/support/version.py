# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The version of the installed package."""

from importlib.metadata import version

VERSION = version("linkage_vibration")
