# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node: joint states in, predictions out, both into a log where asked."""

import math
import os
import sys
import time
from pathlib import Path
from signal import SIG_BLOCK, SIG_IGN, SIG_UNBLOCK, SIGINT, SIGTERM, pthread_sigmask, signal
from typing import Any, cast

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import (
    PublisherEventCallbacks,
    QoSOfferedIncompatibleQoSInfo,
    QoSRequestedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.executors import ExternalShutdownException
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_policy_name_from_kind,
)
from rclpy.serialization import deserialize_message
from rclpy.subscription import MessageInfo, RCLError
from sensor_msgs.msg import JointState

import linkage_vibration
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.inputs import JointInput, ReadingError
from linkage_vibration.logs.definitions import message_definition, type_hash
from linkage_vibration.logs.recording import Attachment, LogWriter, Topic, offered_qos_profiles
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages import encode_prediction, fault
from linkage_vibration.prediction import Predictor, Status
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.resources import DEFAULT_MECHANISM, DEFAULT_TABLE, config_file
from linkage_vibration.ros.parameters import declare_parameters, parameters_yaml
from linkage_vibration.table import Table, load_table, table_bytes
from linkage_vibration.tabulation import build_table
from linkage_vibration_interfaces.msg import VibrationPrediction
from linkage_vibration_interfaces.srv import PredictVibration

NODE_NAME = "linkage_vibration"
STOP_SIGNALS = (SIGINT, SIGTERM)

# A tenth of a second of joint states at 1 kHz: rides out a stall of the machine without loss, and
# no prediction waits longer than that behind it. Of predictions as many, for late retransmission.
QUEUE_DEPTH = 100
# Live predictions wait while a request is answered. This many take less than a tenth of a second:
# joint states at 1 kHz fit the queue meanwhile.
MAX_REQUEST = 1_000
WARN_PERIOD = 5.0  # s, between warnings about the same thing
MISSING_AFTER = 5.0  # s without the joint, before it is said to be missing
MAX_NAMES_TOLD = 20


class LinkageVibrationNode(Node):
    """Answers each joint state on ``joint_states`` with a prediction on ``~/prediction``.

    Raises
    ------
    LinkageVibrationError
        If a parameter, the mechanism, the table or the log's folder cannot be used.
    """

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        self._recording: LogWriter | None = None
        self._log_error_told = False
        self._received = self._predicted = 0
        self._other_joints: set[str] = set()
        self._next_warning: dict[str, float] = {}

        self._settings = declare_parameters(self)
        self._input = JointInput(
            self._settings.joint_name,
            self._settings.sign,
            self._settings.scale,
            self._settings.offset,
        )
        mechanism_path, table = self._load_model()
        self._predictor = Predictor(table)
        self._last_reading = time.monotonic()

        self._publisher = self.create_publisher(
            VibrationPrediction,
            "~/prediction",
            _qos(ReliabilityPolicy.RELIABLE),
            event_callbacks=PublisherEventCallbacks(incompatible_qos=self._on_deaf_subscriber),
        )
        # Best effort hears publishers of either kind, and never waits for a lost joint state.
        # rclpy's type hints do not know that `raw` hands out bytes.
        self._subscription = self.create_subscription(
            JointState,
            "joint_states",
            cast(Any, self._on_joint_state),
            _qos(ReliabilityPolicy.BEST_EFFORT),
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._on_mute_publisher),
            raw=True,
        )
        self._input_topic = self._subscription.topic_name
        self._output_topic = self._publisher.topic_name
        self.create_service(PredictVibration, "~/predict", self._on_request)
        # Simulated time may stand still; a log must reach the disk nevertheless.
        self.create_timer(1.0, self._on_second, clock=Clock(clock_type=ClockType.STEADY_TIME))

        first, last = map(math.degrees, table.alpha3_range)
        self.get_logger().info(
            f"Predicting for joint {self._settings.joint_name} on "
            f"{self._input_topic}, crank angles {first:g} to {last:g} deg, "
            f"table {table.table_id} of {mechanism_path}."
        )
        # Last, so that nothing can fail between its beginning and `close`.
        if self._settings.record:
            self._recording = self._open_log(mechanism_path, table)
            self.get_logger().info(f"Recording to {self._recording.path}")

    def close(self) -> None:
        """End the node, complete its log, and tell what was done."""
        # Destroyed first: its logger would complain of a /rosout that a signal has shut down.
        self.destroy_node()
        logger = get_logger(NODE_NAME)
        logger.info(f"{self._received} joint states in, {self._predicted} predictions out.")
        if self._recording is not None:
            self._recording.close()
            self._tell_log_error()
            logger.info(f"Log: {self._recording.path}")

    def _load_model(self) -> tuple[Path, Table]:
        """Return the mechanism's path and its table, read or built."""
        mechanism_file, table_file = self._settings.mechanism_file, self._settings.table_file
        if mechanism_file == "":
            mechanism_path = config_file(DEFAULT_MECHANISM)
            table_path = config_file(DEFAULT_TABLE) if table_file == "" else _path(table_file)
            return mechanism_path, load_table(table_path, read_mechanism(mechanism_path))
        mechanism_path = _path(mechanism_file)
        mechanism = read_mechanism(mechanism_path)
        if table_file != "":
            return mechanism_path, load_table(_path(table_file), mechanism)
        self.get_logger().info(
            f"Building the table of {mechanism_path}, as table_file is not given; "
            "`linkage-vibration build` makes one once and for all."
        )
        return mechanism_path, build_table(LinkageModel(mechanism), solved=_stop_if_asked)

    def _open_log(self, mechanism_path: Path, table: Table) -> LogWriter:
        """Begin a log that tells which model and parameters made it."""
        settings = f"# linkage_vibration {linkage_vibration.__version__}\n" + parameters_yaml(
            self._settings, self.get_fully_qualified_name()
        )
        attachments = [
            Attachment(mechanism_path.name, "application/yaml", mechanism_path.read_bytes()),
            Attachment(f"{table.table_id}.npz", "application/x-npz", table_bytes(table)),
            Attachment("parameters.yaml", "application/yaml", settings.encode()),
        ]
        return LogWriter(
            unused_path(_path(self._settings.log_directory)),
            [
                _topic(self._input_topic, "sensor_msgs/msg/JointState"),
                _topic(
                    self._output_topic,
                    "linkage_vibration_interfaces/msg/VibrationPrediction",
                ),
            ],
            attachments,
        )

    def _on_joint_state(self, data: bytes, info: MessageInfo) -> None:
        received = self.get_clock().now().nanoseconds
        self._received += 1
        try:
            message = deserialize_message(data, JointState)
            reading = self._input.reading(message)
        except ReadingError as error:
            self._warn("reading", str(error))
            return
        except RuntimeError as error:
            self._warn("bytes", f"A joint state of {len(data)} bytes is not valid CDR: {error}")
            return
        if reading is None:
            # Several nodes may share the topic; `_on_second` tells when none has the joint.
            if len(self._other_joints) < MAX_NAMES_TOLD:
                self._other_joints.update(message.name[:MAX_NAMES_TOLD])
            return
        self._last_reading = time.monotonic()
        self._other_joints.clear()

        prediction = self._predictor.predict(reading.crank_angle)
        stamp = message.header.stamp
        encoded = encode_prediction(prediction, stamp.sec, stamp.nanosec, message.header.frame_id)
        self._publisher.publish(encoded)
        self._predicted += 1
        if prediction.status is not Status.OK:
            self._warn(
                prediction.status.name,
                f"Joint {self._settings.joint_name} gives an angle without a sound prediction: "
                f"{fault(prediction, self._predictor.table.alpha3_range)}.",
            )
        # A simulated clock reads zero until it runs; such times would spoil the log.
        if self._recording is not None and received > 0:
            sent = info["source_timestamp"] or received
            self._recording.write(self._input_topic, data, received, sent)
            now = self.get_clock().now().nanoseconds
            self._recording.write(self._output_topic, encoded, now, time.time_ns())

    def _on_request(
        self, request: PredictVibration.Request, response: PredictVibration.Response
    ) -> PredictVibration.Response:
        angles = request.crank_angles
        if not 0 < len(angles) <= MAX_REQUEST:
            response.message = (
                f"crank_angles has {len(angles)} angles; give 1 to {MAX_REQUEST} in a request."
            )
            return response
        predictions = [self._predictor.predict(angle) for angle in angles]
        sec, nanosec = self.get_clock().now().seconds_nanoseconds()
        # By way of the bytes, so that the service and the topic cannot tell different things.
        response.predictions = [
            deserialize_message(encode_prediction(p, sec, nanosec, ""), VibrationPrediction)
            for p in predictions
        ]
        failed = [i for i, p in enumerate(predictions) if not p.status.has_numbers]
        response.success = not failed
        if failed:
            first = failed[0]
            response.message = (
                f"{len(failed)} of {len(angles)} angles have no prediction, the first is "
                f"crank_angles[{first}]: "
                f"{fault(predictions[first], self._predictor.table.alpha3_range)}."
            )
        return response

    def _on_second(self) -> None:
        if self._recording is not None:
            self._recording.flush()
            self._tell_log_error()
        if time.monotonic() - self._last_reading > MISSING_AFTER:
            names = ", ".join(sorted(self._other_joints)[:MAX_NAMES_TOLD]) or "none"
            self._warn(
                "missing",
                f"Joint {self._settings.joint_name} has not been on "
                f"{self._input_topic} for more than {MISSING_AFTER:g} s; "
                f"joints seen there: {names}. Set joint_name to one of them, or remap the topic.",
            )

    def _on_mute_publisher(self, event: QoSRequestedIncompatibleQoSInfo) -> None:
        self._warn(
            "publisher",
            f"A publisher of {self._input_topic} offers a QoS that this "
            f"node cannot use ({qos_policy_name_from_kind(event.last_policy_kind)}); nothing of it "
            "is received. Publish with sensor-data QoS.",
        )

    def _on_deaf_subscriber(self, event: QoSOfferedIncompatibleQoSInfo) -> None:
        self._warn(
            "subscriber",
            f"A subscriber of {self._output_topic} asks for a QoS that this "
            f"node does not offer ({qos_policy_name_from_kind(event.last_policy_kind)}); it "
            "receives nothing. Subscribe volatile, reliable or best effort.",
        )

    def _tell_log_error(self) -> None:
        if (
            self._recording is not None
            and self._recording.error is not None
            and not self._log_error_told
        ):
            self._log_error_told = True
            get_logger(NODE_NAME).error(f"{self._recording.error} Predictions go on.")

    def _warn(self, about: str, text: str) -> None:
        """Warn, once in WARN_PERIOD about the same thing.

        rclpy's own throttle takes longer to keep silent than a whole prediction takes.
        """
        now = time.monotonic()
        if now >= self._next_warning.get(about, 0.0):
            self._next_warning[about] = now + WARN_PERIOD
            self.get_logger().warning(text)


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM, and return the exit code."""
    # ROS 2 from wheels lies in the Python environment and leaves this unset; a sourced one sets it.
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    # rclpy shuts down on both signals while it is up, and nothing else may act on them: Python's
    # KeyboardInterrupt could strike in the middle of a write to the log, and a second signal could
    # kill a process that is ending well. What comes before rclpy listens is held until it does.
    pthread_sigmask(SIG_BLOCK, STOP_SIGNALS)
    for stop in STOP_SIGNALS:
        signal(stop, SIG_IGN)
    try:
        rclpy.init(args=args)
    except RCLError as error:
        get_logger(NODE_NAME).fatal(" ".join(str(error).split()))
        return 1
    finally:
        pthread_sigmask(SIG_UNBLOCK, STOP_SIGNALS)
    try:
        _run()
    except LinkageVibrationError as error:
        get_logger(NODE_NAME).fatal(str(error))
        return 1
    except ExternalShutdownException:
        pass
    except RCLError:
        # What a signal interrupts may find its context gone.
        if rclpy.ok():
            raise
    finally:
        rclpy.try_shutdown()
    return 0


def _run() -> None:
    node = LinkageVibrationNode()
    try:
        # Single-threaded: the multi-threaded executor delays and loses messages under load, and the
        # events executor (about two thirds of the latency, in rclpy 9.1) never calls back with the
        # time of sending, which the log keeps.
        rclpy.spin(node)
    finally:
        node.close()


def _stop_if_asked() -> None:
    if not rclpy.ok():
        raise ExternalShutdownException


def _qos(reliability: ReliabilityPolicy) -> QoSProfile:
    """Return a profile of its own: rclpy's overrides change the shared ones in place."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=QUEUE_DEPTH,
        reliability=reliability,
        durability=DurabilityPolicy.VOLATILE,
    )


def _path(text: str) -> Path:
    """Return the path that a parameter means; no shell has expanded its ``~``."""
    return Path(text).expanduser().absolute()


def unused_path(folder: Path) -> Path:
    """Return where a log that begins now goes."""
    stem = time.strftime("linkage_vibration_%Y%m%d-%H%M%S")
    path = folder / f"{stem}.mcap"
    number = 1
    while path.exists():
        number += 1
        path = folder / f"{stem}_{number}.mcap"
    return path


def _topic(name: str, type_name: str) -> Topic:
    # Played back as reliable, a log reaches subscribers of either kind.
    qos = offered_qos_profiles(reliable=True, depth=QUEUE_DEPTH)
    return Topic(name, type_name, message_definition(type_name), type_hash(type_name), qos)


if __name__ == "__main__":
    sys.exit(main())
