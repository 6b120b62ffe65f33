# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Runs a test for each case in which what nobody saw once counted as good.

``python -m benchmark.not_known`` writes the page only if all tests pass.
"""

import subprocess
import sys
from pathlib import Path

from benchmark.report import machine, publish, table

ROWS = (
    (
        "The publisher of the ground speed stops in a warning.",
        "clear after 2.6 s",
        "The state is unknown from `stale_after` on; it is never clear.",
        "prediction/test_resonance.py::test_stale_speeds "
        "prediction/test_resonance_rate.py::test_not_known_is_never_clear",
    ),
    (
        "A reading without numbers comes every 0.9 s, and the load is above its limit.",
        "no warning",
        "A warning: such a reading does not restart the dwell time.",
        "prediction/test_severity.py::"
        "test_a_reading_without_numbers_neither_ends_nor_restarts_a_dwell",
    ),
    (
        "All stamps are zero.",
        '"No load exceeded the limit"',
        "Live, the time of receipt counts. Of a log it is said in how many readings loads exceeded "
        "the limit, and that the stamps do not say for how long; `review --limits` fails.",
        "prediction/test_verdict.py::test_stamps_that_stand_still_hide_no_load "
        "testing/test_quantities.py::test_stamps_that_stand_still "
        "playback/test_measurements.py::test_stamps_that_do_not_move",
    ),
    (
        "Readings are 5 s apart and above the limit.",
        '"No known load exceeded the limit"',
        '"Loads exceeded 0.33 of the static force in 4 of 4 readings; more than 3 s apart, they '
        'cannot warn."',
        "prediction/test_verdict.py::test_sparse_readings_cannot_warn",
    ),
    (
        "Readings are 5 s apart and below the limit.",
        "known for the whole drive",
        "Known for 60 % of the drive, as a reading holds for at most 3 s.",
        "prediction/test_verdict.py::test_how_long_messages_hold",
    ),
    (
        "All crank angles are outside of the table.",
        "a green box above empty charts",
        "The page begins with the angles and the range of the table, and has no other chart.",
        "review/test_findings.py::test_only_angles_outside",
    ),
    (
        "The ground is not known for most of a drive.",
        "green; the share comes fourth",
        "The sentence begins with the share that is known, and the page is not green. Its chart is "
        "hatched there.",
        "prediction/test_verdict.py::test_what_is_known_comes_first "
        "review/test_findings.py::test_part_of_a_total_is_marked "
        "review/test_findings.py::test_rows_of_an_overview_are_green_as_their_pages",
    ),
    (
        "Three of the sources of the shipped drive are never known.",
        "green",
        "Known for 0 % of the drive: the page is not green, and a check of its loads fails.",
        "testing/test_bag_checks.py::test_what_is_not_known_fails",
    ),
    (
        "`check_bag` reads a drive that was not assessed for 57 %.",
        "passed",
        "It fails below a `known_share` of 0.95, with the reason.",
        "testing/test_bag_checks.py::test_what_is_not_known_fails "
        "testing/test_quantities.py::test_what_is_not_known",
    ),
    (
        "`check_bag` reads angles that are out of range.",
        '"no speed is known"',
        "The status of the predictions fails first.",
        "testing/test_bag_checks.py::test_status_comes_before_loads_that_are_not_known",
    ),
    (
        "`listen` measures a sixtieth of what is predicted.",
        "green, consistent",
        "The page begins with the order that contradicts its prediction, and is not green.",
        "review/test_listening_page.py::test_contradictions_come_first",
    ),
    (
        "Two publishers of one joint disagree in a bag.",
        "3000 predictions are OK",
        "Their angles are not known, and the page names them.",
        "playback/test_replay.py::test_readings_that_go_to_and_fro",
    ),
    (
        "An angle is frozen, or a speed in another unit, where the load is largest.",
        "the worst moment of the drive; a check passes",
        "No such reading is the worst moment; if all are doubted, none is named. A check fails by "
        "the fault, unless its `input_faults` allow it.",
        "playback/test_replay.py::test_a_doubted_reading_is_not_the_worst "
        "playback/test_replay.py::test_what_the_judge_finds_stands_in_every_output "
        "prediction/test_judge.py::test_when_a_frozen_angle_is_doubted "
        "prediction/test_judge.py::test_when_speeds_are_doubted "
        "testing/test_quantities.py::test_faults_of_the_inputs",
    ),
    (
        "Stamps of a bag are in the future, or count from the start of the computer.",
        "nothing is said",
        "The input faults of log, page and JSON name them.",
        "prediction/test_judge.py::test_faults_of_readings",
    ),
    (
        "Two logs are joined to one file.",
        "half is dropped",
        "The file is refused with the commands that split it.",
        "bags/test_wild_files.py::test_joined_files",
    ),
    (
        "The summary of a file lists a chunk twice.",
        "600 of 300 readings",
        "The chunk is read once.",
        "bags/test_wild_files.py::test_chunk_index_that_is_repeated",
    ),
    (
        "A recorder was killed and left a write-ahead log.",
        "100 of 500 readings",
        "All readings are read, or the bag is refused with a remedy.",
        "bags/test_wild_files.py::test_write_ahead_log",
    ),
    (
        "Modes of a starter veer, or were measured by `calibrate`.",
        "no deviation, without a reason",
        "All have deviations (`python -m benchmark uncertainty`); where one is not known, "
        "`predict` says why.",
        "table/tabulation/test_deviations.py::test_machines_that_do_not_close_leave_no_deviation "
        "cli/test_cli.py::test_build_says_why_deviations_are_not_known",
    ),
    (
        "`advise` names a height that is quieter with 24 %.",
        "called the quietest",
        "Nothing is called quieter below 50 %; a factor that is not known has a reason; the only "
        "candidate is not called quieter.",
        "prediction/test_advice.py::test_sentences "
        "prediction/test_advice.py::test_a_probability_needs_95_percent_of_the_members "
        "prediction/test_advice.py::test_the_only_candidate_is_not_quieter",
    ),
    (
        "The factor of a load that is known is not known.",
        "`nan` without a reason",
        "Sentence, CSV, JSON, `/diagnostics` and `advise` have the reason beside it.",
        "review/test_log.py::test_factors_that_are_not_known_have_a_reason "
        "review/test_log.py::test_why_a_table_has_no_factors",
    ),
    (
        "A sentence says what would have ended a warning.",
        "0.335 there, for a limit of 0.33",
        "It is sought for the angle and the speeds of that moment, and named only if it ends it.",
        "review/test_findings.py::test_what_ends_a_warning_does_end_it",
    ),
    (
        '"Mostly by" an excitation.',
        "48 % of the square, at another pin",
        "It is said of more than half of the square, at the pin that is named.",
        "prediction/test_verdict.py::test_mostly_is_more_than_half_of_the_square",
    ),
    (
        "Loads exceed the limit for 16 s, and warn for 14 s of these.",
        '"exceeded for 14.0 s in all"',
        "The time above the limit and the time in warnings are two figures.",
        "prediction/test_verdict.py::test_the_largest_load_may_be_too_short_to_warn",
    ),
    (
        "Ten readings share each stamp.",
        '"Predictions are missing in 149 gaps"',
        "No gap: only a step of ten usual ones is one.",
        "drawing/test_intervals.py::test_samples_that_share_a_stamp",
    ),
    (
        "The clock jumps back in a warning.",
        "one episode on the topic, two in the summary",
        "One jump ends the warning everywhere.",
        "prediction/test_severity.py::test_a_gap_or_a_jump_back_ends_a_warning "
        "review/test_findings.py::test_jump_of_the_clock",
    ),
    (
        "Speeds come later than readings, or from the beginning.",
        '"no load is known for the first 3.1 s" in both cases',
        "It is said only of the former.",
        "prediction/test_verdict.py::test_the_time_before_the_first_speed_is_said",
    ),
)


def main() -> None:
    """Run the tests, and publish what is said now."""
    folder = Path(__file__).parents[1]
    tests = [f"test/{each}" for row in ROWS for each in row[3].split()]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
    subprocess.run(command, cwd=folder, check=True)
    cells = [[*row[:3], "<br>".join(f"`{each}`" for each in row[3].split())] for row in ROWS]
    publish(
        "not_known",
        "What is not known is not good",
        [
            "This page lists cases in which what nobody saw once counted as good, what was said "
            "then, what is said now, and the tests in `test/` that show it. All of them passed "
            "when this page was written. The seconds above, below and not known are compared for "
            "10,000 drives [here](random_drives.md).",
            table(["case", "then", "now", "tests"], cells),
        ],
        machine(),
    )


if __name__ == "__main__":
    main()
