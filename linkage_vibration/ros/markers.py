# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the linkage for 3D viewers, at its crank angle and moved by a mode."""

import math
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from linkage_vibration.drawing import geometry
from linkage_vibration.drawing.geometry import Curves, size
from linkage_vibration.drawing.palette import COLOURS, GREY
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.answers import Served
from linkage_vibration.prediction.settings import Parameters
from linkage_vibration.ros.endpoints import WARN_PERIOD, publisher

FloatArray = NDArray[np.float64]

SWING = 0.08  # largest drawn movement of a mode, as a fraction of the linkage's size
SWINGS_PER_SECOND = 0.5  # slow enough for the eye
_LINE, _PIN = 0.012, 0.03  # widths of lines and diameters of joints, as fractions of the size
_PICTURES = 3.0  # a picture disappears if none follows in so many periods


class Markers:
    """Publishes ``~/markers`` while they have a subscriber.

    Links, rigid bodies, pins and the ground are true to scale; the mode is magnified and slowed
    down. A thread draws, so that live predictions do not wait for it. ``served`` returns the
    current mechanism and table. The attribute `settings` may be replaced at any time.
    """

    def __init__(self, node: Node, served: Callable[[], Served], settings: Parameters) -> None:
        self._node, self._served, self.settings, self._angle = node, served, settings, math.nan
        self._before: FloatArray | None = None  # the mode in the last picture, for its sign
        self._thread = ThreadPoolExecutor(1, "linkage_vibration_markers")
        self._drawing: Future[None] | None = None
        self._publisher = publisher(node, MarkerArray, "~/markers")
        # Simulated time may stop while somebody watches.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(1.0 / settings.marker_rate, self._on_timer, clock=clock)
        self._timer.cancel()  # its calls without a subscriber would cost as much as predictions

    def watch(self) -> None:
        """Begin to draw if the markers have a subscriber; the node calls this every second."""
        if self._timer.is_canceled() and self._publisher.get_subscription_count():
            self._timer.reset()

    def update(self, crank_angle: float) -> None:
        """Draw this crank angle (rad) from now on."""
        self._angle = crank_angle

    def close(self) -> None:
        """Destroy the timer and the publisher."""
        self._angle = math.nan  # the timer may call once more
        self._node.destroy_timer(self._timer)
        self._thread.shutdown(cancel_futures=True)
        self._node.destroy_publisher(self._publisher)

    def _on_timer(self) -> None:
        if not math.isfinite(self._angle):
            return
        if not self._publisher.get_subscription_count():
            self._timer.cancel()
            return
        period = round(1e9 / self.settings.marker_rate)
        if self._timer.timer_period_ns != period:
            self._timer.timer_period_ns = period
        if self._drawing is None or self._drawing.done():
            self._drawing = self._thread.submit(self._draw, self._angle, self.settings)

    def _draw(self, angle: float, settings: Parameters) -> None:
        try:
            markers = self._markers(self._served(), angle, settings)
            stamp = self._node.get_clock().now().to_msg()
            lifetime = Duration(seconds=_PICTURES / settings.marker_rate).to_msg()
            for marker in markers:
                marker.header.stamp, marker.header.frame_id = stamp, settings.marker_frame
                marker.lifetime = lifetime
            self._publisher.publish(MarkerArray(markers=markers))
        except LinkageVibrationError:
            pass  # at an angle that the linkage cannot reach; the prediction reports it
        except Exception as error:
            self._node.get_logger().error(
                f"Drawing has failed ({type(error).__name__}: {error}); please report this.",
                throttle_duration_sec=WARN_PERIOD,
            )

    def _markers(self, served: Served, angle: float, settings: Parameters) -> list[Marker]:
        drawn = geometry.scene(served.model, served.model.kinematics.at(angle))
        scale = size(drawn.bodies)
        line, pin = _LINE * scale, _PIN * scale
        rigid = {body.name for body in served.mechanism.rigid}
        markers = [
            _marker("bodies", i, Marker.LINE_STRIP, COLOURS[2 if name in rigid else 0], line, at)
            for i, (name, at) in enumerate(drawn.bodies.items())
        ]
        for name, kind, colour, at in (
            ("joints", Marker.SPHERE_LIST, COLOURS[4], drawn.joints),
            ("ground", Marker.CUBE_LIST, GREY, drawn.ground),
            ("centres_of_gravity", Marker.SPHERE_LIST, COLOURS[2], drawn.centres),
        ):
            if len(at):
                markers.append(_marker(name, 0, kind, colour, pin, at))
        mode = served.table.find_mode(settings.marker_mode)
        if mode is None:
            self._node.get_logger().warning(
                f"Parameter marker_mode is {settings.marker_mode!r}, but no mode has this name; "
                f"use a number or one of: {', '.join(served.table.mode_names)}.",
                throttle_duration_sec=WARN_PERIOD,
            )
        elif mode >= 0:
            markers += self._mode(served, angle, mode, drawn.bodies)
        return markers

    def _mode(self, served: Served, angle: float, mode: int, bodies: Curves) -> list[Marker]:
        """Return the markers of a mode at this moment, if the prediction has such a mode."""
        prediction = served.predictor.predict(angle)
        if not prediction.status.has_numbers or mode >= len(prediction.natural_frequencies):
            return []
        frequency = float(prediction.natural_frequencies[mode])
        scale, colour = size(bodies), COLOURS[1]
        low, high = geometry.corners(bodies)
        above = np.array([[(low[0] + high[0]) / 2.0, high[1] + 2.0 * SWING * scale]])
        text = _marker("mode_text", 0, Marker.TEXT_VIEW_FACING, colour, 2.0 * _PIN * scale, above)
        if math.isnan(frequency):
            text.text = f"{served.table.mode_label(mode)}: overdamped"
            return [text]
        text.text = f"{served.table.mode_label(mode)}: {frequency:.1f} Hz"
        solution = served.model.solve(angle)
        moved = geometry.mode_curves(solution, geometry.nearest_mode(solution, frequency))
        shape = np.vstack(list(moved.values()))
        # The sign of a mode shape is arbitrary, so it follows the last picture.
        sign, before = 1.0, self._before
        if before is not None and before.shape == shape.shape and (before * shape).sum() < 0.0:
            sign = -1.0
        self._before = sign * shape
        phase = 2.0 * math.pi * SWINGS_PER_SECOND * time.monotonic()
        factor = sign * math.sin(phase) * SWING * scale / geometry.largest(moved)
        markers = [
            _marker("mode", i, Marker.LINE_STRIP, colour, _LINE * scale, at + factor * moved[name])
            for i, (name, at) in enumerate(bodies.items())
        ]
        return [*markers, text]


def _marker(name: str, number: int, kind: int, colour: str, width: float, at: FloatArray) -> Marker:
    """Return a marker, which replaces the marker of the same name and number."""
    marker = Marker(ns=name, id=number, type=kind, action=Marker.ADD)
    marker.scale.x = marker.scale.y = marker.scale.z = width
    red, green, blue = (value / 255.0 for value in bytes.fromhex(colour[1:]))
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=1.0)
    points = [Point(x=x, y=0.0, z=z) for x, z in at.tolist()]
    if kind == Marker.TEXT_VIEW_FACING:
        marker.pose.position = points[0]
    else:
        marker.points = points
    return marker
