# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of the node: their layouts, encodings, definitions and topics."""
