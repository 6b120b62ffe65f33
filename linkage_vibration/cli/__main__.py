# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Run the command with ``python -m linkage_vibration.cli``."""

import sys

from linkage_vibration.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
