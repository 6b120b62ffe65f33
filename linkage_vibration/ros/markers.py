# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Draws the linkage for 3D viewers: as it stands, and how a mode moves it."""

import math
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from linkage_vibration.drawing.geometry import (
    Curves,
    corners,
    largest,
    mode_curves,
    nearest_mode,
    scene,
    size,
)
from linkage_vibration.drawing.palette import COLOURS, GREY
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.prediction.answers import Served
from linkage_vibration.ros.endpoints import publisher

FloatArray = NDArray[np.float64]

SWING = 0.08  # of the linkage's size, how far the point that moves most is drawn from its place
SWINGS_PER_SECOND = 0.5  # slow enough to be followed
_LINE, _PIN = 0.012, 0.03  # of the size: widths of lines, diameters of joints
WARN_PERIOD = 5.0  # s
_PICTURES = 3.0  # after which a picture that is not renewed goes
_UNSEEN_PERIOD = 1.0  # s, between two looks whether somebody subscribes now


@dataclass(frozen=True, slots=True)
class MarkerSettings:
    """What to draw, and how often.

    Attributes
    ----------
    mode : int
        Index into a prediction's natural frequencies; -1 for none.
    rate : float
        Pictures a second, Hz; above 0.
    frame : str
        Frame of the mechanism: x forward, z up.
    """

    mode: int
    rate: float
    frame: str


class Markers:
    """Publishes ``~/markers`` while somebody subscribes to them.

    Links, rigid bodies, pins and the ground are true to scale; the mode is drawn about them,
    magnified and slowed down. A thread draws, so that live predictions do not wait for it.

    Parameters
    ----------
    node : Node
        To publish on.
    served : callable
        Returns what is served now.
    settings : MarkerSettings
        To begin with.
    """

    def __init__(self, node: Node, served: Callable[[], Served], settings: MarkerSettings) -> None:
        self._node, self._served, self._settings = node, served, settings
        self._angle = math.nan
        self._before: FloatArray | None = None  # the mode as it was drawn last, for its sign
        self._thread = ThreadPoolExecutor(1, "linkage_vibration_markers")
        self._drawing: Future[None] | None = None
        self._publisher = publisher(node, MarkerArray, "~/markers")
        # Simulated time may stand still while somebody looks on.
        self._timer = node.create_timer(
            _UNSEEN_PERIOD, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def configure(self, settings: MarkerSettings) -> None:
        """Draw otherwise from now on."""
        self._settings = settings

    def update(self, crank_angle: float) -> None:
        """Take the crank angle (rad) that is drawn from now on."""
        self._angle = crank_angle

    def close(self) -> None:
        """Take the timer and the publisher back."""
        self._angle = math.nan  # the timer may come once more
        self._node.destroy_timer(self._timer)
        self._thread.shutdown(cancel_futures=True)
        self._node.destroy_publisher(self._publisher)

    def _on_timer(self) -> None:
        if not math.isfinite(self._angle):
            return
        seen = self._publisher.get_subscription_count() > 0
        # Waking ten times a second for nobody costs as much as ten predictions.
        period = round(1e9 / self._settings.rate) if seen else round(1e9 * _UNSEEN_PERIOD)
        if self._timer.timer_period_ns != period:
            self._timer.timer_period_ns = period
        if not seen:
            return
        if self._drawing is None or self._drawing.done():
            self._drawing = self._thread.submit(self._draw, self._angle, self._settings)

    def _draw(self, angle: float, settings: MarkerSettings) -> None:
        try:
            markers = self._markers(self._served(), angle, settings)
            stamp = self._node.get_clock().now().to_msg()
            lifetime = Duration(seconds=_PICTURES / settings.rate).to_msg()
            for marker in markers:
                marker.header.stamp, marker.header.frame_id = stamp, settings.frame
                marker.lifetime = lifetime
            self._publisher.publish(MarkerArray(markers=markers))
        except LinkageVibrationError:
            pass  # where the linkage cannot be, there is nothing to draw; predictions tell why
        except Exception as error:
            self._node.get_logger().error(
                f"Drawing has failed ({type(error).__name__}: {error}).",
                throttle_duration_sec=WARN_PERIOD,
            )

    def _markers(self, served: Served, angle: float, settings: MarkerSettings) -> list[Marker]:
        drawn = scene(served.model, served.model.kinematics.at(angle))
        scale = size(drawn.bodies)
        line, pin = _LINE * scale, _PIN * scale
        rigid = {body.name for body in served.mechanism.rigid_bodies}
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
        if settings.mode >= 0:
            markers += self._mode(served, angle, settings.mode, drawn.bodies)
        return markers

    def _mode(self, served: Served, angle: float, mode: int, bodies: Curves) -> list[Marker]:
        """Draw a mode at this moment of its swing, if there is such a mode here."""
        prediction = served.predictor.predict(angle)
        if not prediction.status.has_numbers or mode >= len(prediction.natural_frequencies):
            return []
        frequency = float(prediction.natural_frequencies[mode])
        solution = served.model.solve(angle)
        moved = mode_curves(solution, nearest_mode(solution, frequency))
        shape = np.vstack(list(moved.values()))
        # A shape has no sign of its own: it takes that of the picture before.
        sign, before = 1.0, self._before
        if before is not None and before.shape == shape.shape and (before * shape).sum() < 0.0:
            sign = -1.0
        self._before = sign * shape
        scale = size(bodies)
        phase = 2.0 * math.pi * SWINGS_PER_SECOND * time.monotonic()
        factor = sign * math.sin(phase) * SWING * scale / largest(moved)
        markers = [
            _marker(
                "mode", i, Marker.LINE_STRIP, COLOURS[1], _LINE * scale, at + factor * moved[name]
            )
            for i, (name, at) in enumerate(bodies.items())
        ]
        low, high = corners(bodies)
        above = np.array([[(low[0] + high[0]) / 2.0, high[1] + 2.0 * SWING * scale]])
        text = _marker(
            "mode_text", 0, Marker.TEXT_VIEW_FACING, COLOURS[1], 2.0 * _PIN * scale, above
        )
        text.text = f"mode {mode + 1}: {frequency:.1f} Hz"
        return [*markers, text]


def _marker(name: str, number: int, kind: int, colour: str, width: float, at: FloatArray) -> Marker:
    """Return a marker of one name and number, which replaces the one before."""
    marker = Marker(ns=name, id=number, type=kind, action=Marker.ADD)
    marker.scale.x = marker.scale.y = marker.scale.z = width
    marker.color = ColorRGBA(
        r=int(colour[1:3], 16) / 255.0,
        g=int(colour[3:5], 16) / 255.0,
        b=int(colour[5:7], 16) / 255.0,
        a=1.0,
    )
    points = [Point(x=x, y=0.0, z=z) for x, z in at.tolist()]
    if kind == Marker.TEXT_VIEW_FACING:
        marker.pose.position = points[0]
    else:
        marker.points = points
    return marker
