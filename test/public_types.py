# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What errors advise has right types, and what they refuse has wrong ones, by `make lint` alone.

Each comment that ignores an error has to be needed there.
"""

import linkage_vibration as lv


def advised() -> None:
    """Use the public names as errors advise, without an error of types."""
    model = lv.LinkageModel(lv.read_mechanism("a.yaml"))
    table = lv.build_table(model)
    predictor = lv.Predictor(lv.load_table("a.npz"))
    many = predictor.predict([2.0, 2.1], [0.01, 0.02])
    predictor.predict(2.0)
    solution = model.stack([2.0, 2.1]).rows[0]
    solution.frf(["E1.z"], [("E1", "z")]).frf([10.0, 20.0])
    frf = table.frf(2.0, ["E1.z"], ["E1.z"]).at([10.0, 20.0])
    model.coupled_frf(2.0, [10.0], ["E1.z"], ["E1.z"])
    table.evaluate([2.0, 2.1])
    for source in (model.mechanism, solution, solution.shape(0), frf, table, many):
        lv.plot(source, "a.png")
    lv.plot(lv.read_log("a.mcap"))
    lv.plot(lv.sweep(model.mechanism.with_values({"a": 1.0}), {"a": [1.0]}, [2.0]))
    lv.summaries(["a.mcap"])
    lv.check_bag("a.mcap", lv.Limits(gap=1.0))


def refused() -> None:
    """Use the public names as errors refuse it, with an error of types each time."""
    lv.LinkageModel("a.yaml")  # type: ignore[arg-type]
    model = lv.LinkageModel(lv.read_mechanism())
    lv.build_table(model.mechanism)  # type: ignore[arg-type]
    lv.Predictor(model)  # type: ignore[arg-type]
    lv.plot(model)  # type: ignore[arg-type]
    lv.load_table().frf(2.0, ["E1.z"], ["E1.z"]).at(10.0)  # type: ignore[arg-type]
    lv.predictor  # type: ignore[attr-defined]  # noqa: B018
