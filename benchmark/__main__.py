# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Runs benchmarks one after another: ``python -m benchmark [NAME ...]``, all without a name."""

import argparse
import subprocess
import sys

# In the order in which `make bench` runs them: short ones first, the hour of the soak last.
STEPS = (
    "validation.exudyn_beams",
    "validation.solid_fe",
    "validation.sdynpy_fbs",
    "reproduce",
    "freed_dimensions",
    "calibrations",
    "bounds",
    "stability",
    "noise",
    "ground",
    "ground_map",
    "loads",
    "tyres_and_damping",
    "own_hitch",
    "measured_modes",
    "listening",
    "uncertainty",
    "ensemble",
    "advice",
    "budget",
    "speed",
    "speed.paper_job",
    "fuzz",
    "measured_faults",
    "working_hour",
    "motion",
    "resonance_rates",
    "tutorial",
    "sweeps",
    "export_processors",
    "export_c",
    "latency",
    "rebuild",
    "signals",
    "crash",
    "message_bytes",
    "libraries",
    "log_readers",
    "can_bus",
    "input_memory",
    "commands",
    "replay",
    "long_bag",
    "review_page",
    "overload",
    "promises",
    "sensors",
    "soak",
)


def main() -> int:
    """Run the named steps, report which failed, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmark", description=__doc__)
    parser.add_argument("steps", nargs="*", metavar="NAME", help=", ".join(STEPS))
    steps = parser.parse_args().steps or list(STEPS)
    unknown = [step for step in steps if step not in STEPS]
    if unknown:
        parser.error(f"there is no benchmark {unknown[0]}; choose from {', '.join(STEPS)}")
    failed = [step for step in steps if not _run(step)]
    if failed:
        print(f"{len(failed)} of {len(steps)} benchmarks failed: {', '.join(failed)}.")
    return 1 if failed else 0


def _run(step: str) -> bool:
    """Run one benchmark in a process of its own; return whether it succeeded."""
    print(f"\n== benchmark.{step}", flush=True)
    return subprocess.run([sys.executable, "-m", f"benchmark.{step}"], check=False).returncode == 0


if __name__ == "__main__":
    sys.exit(main())
