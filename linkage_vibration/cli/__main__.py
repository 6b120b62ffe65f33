# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Run the command, also with ``python -m linkage_vibration.cli``."""

import sys


def main() -> int:
    """Run the command, which Ctrl-C ends without a word while its own modules are imported."""
    try:
        from linkage_vibration.cli import main as command
    except KeyboardInterrupt:
        return 130
    return command.main()


if __name__ == "__main__":
    sys.exit(main())
