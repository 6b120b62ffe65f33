# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Every file that comes in: mechanisms, components (matrices, FRFs, meshes) and bags."""
