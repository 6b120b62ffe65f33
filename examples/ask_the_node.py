# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""How do I ask a running node for predictions, FRFs, levels, mode shapes, its table and advice?

It also changes the implement. The node has its default name.
"""

from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.action import ActionClient

from linkage_vibration_interfaces.action import SetImplement
from linkage_vibration_interfaces.srv import (
    Advise,
    GetFrf,
    GetGroundLevels,
    GetModeShapes,
    GetTable,
    PredictVibration,
)

rclpy.init()
node = rclpy.create_node("client")


def ask(name: str, kind: Any, **fields: Any) -> Any:
    """Return the answer of a service."""
    client = node.create_client(kind, f"/linkage_vibration/{name}")
    assert client.wait_for_service(20.0), "the node does not run"
    for _ in range(2):  # DDS loses a response if the node has not found the client yet
        future = client.call_async(kind.Request(**fields))
        rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
        if future.done():
            break
    answer = future.result()
    assert answer is not None, f"{name}: no answer"
    assert getattr(answer, "success", True), answer.message
    return answer


angles = np.radians([100.0, 132.0, 160.0])
for prediction in ask("predict", PredictVibration, crank_angles=angles).predictions:
    print(prediction.table_id, list(prediction.natural_frequencies))

answer = ask("predict", PredictVibration, crank_angles=angles, crank_angle_stddev=0.01, shares=True)
shares = np.reshape(answer.frequency_shares, (len(angles), 4, -1))  # Hz
for cause, share in zip(("parameters", "angle", "links", "table"), shares[1], strict=True):
    print(cause, share.tolist())

places = {"outputs": ["E1.z", "V1.z"], "inputs": ["E1.z"]}
frf = ask("get_frf", GetFrf, crank_angle=angles[1], **places)
lines = len(frf.frequencies), len(frf.outputs), len(frf.inputs)
receptance = (np.array(frf.real) + 1j * np.array(frf.imaginary)).reshape(lines)  # m/N
highest = np.abs(receptance[:, 0, 0]).argmax()
print(f"{frf.outputs[0]} peaks at {frf.frequencies[highest]} Hz")

asked = {"crank_angle": angles[1], "ground_speed": 8.0}
ground = ask(
    "get_ground_levels", GetGroundLevels, outputs=["E1.z", "lift_cylinders.force"], **asked
)
velocity, force = ground.levels[:2]
print(f"E1 moves at {velocity} m/s rms, and {ground.outputs[1]} varies by {force} N rms")
densities = np.reshape(ground.densities, (2, len(ground.frequencies)))
print(f"E1 shakes most at {ground.frequencies[np.nanargmax(densities[0])]} Hz")

modes = ask("get_mode_shapes", GetModeShapes, crank_angle=angles[1])
shapes = np.array(modes.shapes).reshape(-1, len(modes.places))
for frequency, shape in zip(modes.natural_frequencies, shapes, strict=True):
    print(f"{frequency:.2f} Hz: {modes.places[np.abs(shape).argmax()]} moves most")

answer = ask("get_table", GetTable)
Path(f"{answer.table_id}.npz").write_bytes(bytes(answer.table))
Path(f"{answer.table_id}.yaml").write_text(answer.mechanism)

client = ActionClient(node, SetImplement, "/linkage_vibration/set_implement")
assert client.wait_for_server(20.0), "the node does not run"
sent = client.send_goal_async(SetImplement.Goal(mass=1200.0, inertia=300.0))
rclpy.spin_until_future_complete(node, sent, timeout_sec=20.0)
done = sent.result().get_result_async()
rclpy.spin_until_future_complete(node, done, timeout_sec=100.0)
changed = done.result().result
assert changed.success, changed.message
print("now in use:", changed.table_id)

present = {"crank_angle": np.radians(165.0), "ground_speed": 8.3, "engine_speed": 188.5}
answer = ask("advise", Advise, **present, ground_speed_min=4.0, ground_speed_max=12.0)
print(answer.advice.sentence)
print("load ratio now", answer.advice.places[answer.advice.NOW].load_ratio)
loads = np.reshape(answer.load_ratios, (len(answer.crank_angles), len(answer.ground_speeds)))
print("smallest in the map", np.nanmin(loads))
