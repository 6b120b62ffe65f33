# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Chooses the cheapest model that meets a tolerance.

`scene` states the question. `choice` finds the cheapest settings: elements and modes a link, and a
table or a solve for each prediction. `physics` says which physics the scene needs.
`measurement` compares the choice with an unreduced, finer model. `report` presents both. `results`
holds what a model or a table gives at one angle, its errors and its cost.
"""
