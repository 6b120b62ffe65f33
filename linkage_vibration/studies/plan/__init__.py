# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses the cheapest model that meets a tolerance.

`question` states what is needed, and compares answers. `choice` finds the cheapest settings:
elements and modes a link, and a table or a solve for each prediction, and compares them with an
unreduced, finer model. `unknowns` says how accurate a model can be at all.
"""
