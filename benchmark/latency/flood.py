# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""A client that floods the services of a node: ``python -m benchmark.latency.flood NODE``.

Of each service, three requests wait all the time.
"""

import os
import sys
from typing import Any

os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)

import rclpy
from rcl_interfaces.srv import GetParameters

from linkage_vibration_interfaces.srv import GetModeShapes, PredictVibration

WAITING = 3


def main() -> None:
    """Say that it floods, and do so until the process is killed."""
    rclpy.init()
    node = rclpy.create_node(f"flood_{os.getpid()}")
    requests = {
        "predict": (PredictVibration, PredictVibration.Request(crank_angles=[2.0] * 100)),
        "get_mode_shapes": (GetModeShapes, GetModeShapes.Request(crank_angle=2.0)),
        "get_parameters": (GetParameters, GetParameters.Request(names=["hitch_sign"])),
    }

    def ask(client: Any, request: Any) -> None:
        client.call_async(request).add_done_callback(lambda _: ask(client, request))

    for name, (kind, request) in requests.items():
        client: Any = node.create_client(kind, f"{sys.argv[1]}/{name}")
        client.wait_for_service()
        for _ in range(WAITING):
            ask(client, request)
    print("flooding", flush=True)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
