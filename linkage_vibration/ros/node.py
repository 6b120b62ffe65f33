# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node: crank angles in, predictions and resonances out, all of it into a log where asked."""

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, JumpThreshold
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.event_handler import (
    PublisherEventCallbacks,
    QoSOfferedIncompatibleQoSInfo,
    QoSRequestedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.parameter import Parameter
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
from std_msgs.msg import Float64, String
from std_srvs.srv import Trigger

import linkage_vibration
from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.excitation import Resonance, ResonanceMonitor, Source
from linkage_vibration.inputs import JointInput, PercentInput, Reading, ReadingError
from linkage_vibration.logs.definitions import message_definition, type_hash
from linkage_vibration.logs.recorder import Provenance, Recorder, package_versions
from linkage_vibration.logs.recording import Attachment, LogError, Topic, offered_qos_profiles
from linkage_vibration.mechanics.model import LinkageModel
from linkage_vibration.messages import encode_prediction, encode_resonance, fault
from linkage_vibration.prediction import Predictor, Status
from linkage_vibration.readers.excitations import read_excitations
from linkage_vibration.readers.mechanism import read_mechanism
from linkage_vibration.resources import (
    DEFAULT_EXCITATIONS,
    DEFAULT_MECHANISM,
    DEFAULT_TABLE,
    config_file,
)
from linkage_vibration.ros.diagnostics import Health, Log, Statistics, diagnostics, status
from linkage_vibration.ros.markers import Markers, MarkerSettings
from linkage_vibration.ros.parameters import (
    JOINT_STATE,
    changed,
    declare_parameters,
    in_own_types,
    parameters_yaml,
)
from linkage_vibration.ros.services import Services
from linkage_vibration.serving import Served, place_name
from linkage_vibration.table import Table, load_table, table_bytes
from linkage_vibration.tabulation import build_table
from linkage_vibration_interfaces.msg import Resonance as ResonanceMessage
from linkage_vibration_interfaces.msg import TableInfo, VibrationPrediction

NODE_NAME = "linkage_vibration"
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
SPEED_TOPICS = {
    Source.ENGINE: "engine_speed",
    Source.PTO: "pto_speed",
    Source.GROUND: "ground_speed",
}

# A tenth of a second of joint states at 1 kHz: rides out a stall of the machine without loss, and
# no prediction waits longer than that behind it. Of predictions as many, for late retransmission.
QUEUE_DEPTH = 100
WARN_PERIOD = 5.0  # s, between warnings about the same thing
MISSING_AFTER = 5.0  # s without the joint, before it is said to be missing
MAX_NAMES_TOLD = 20


class LinkageVibrationNode(LifecycleNode):
    """Answers each reading of the crank angle with a prediction on ``~/prediction``.

    Configured, it has its table and offers its services; active, it listens and predicts.

    Attributes
    ----------
    problem : str
        Why it could not be configured or activated; empty where it could.

    Raises
    ------
    LinkageVibrationError
        If a parameter is not valid.
    """

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        self.problem = ""
        self._statistics = Statistics()
        self._state = "unconfigured"
        self._next_warning: dict[str, float] = {}
        self._other_joints: set[str] = set()
        self._input: JointInput | PercentInput
        self._served: Served | None = None
        self._predictor: Predictor
        self._monitor: ResonanceMonitor
        self._resonance: Resonance | None = None
        self._listening: dict[str, Any] = {}  # subscriptions by their topics
        self._sending: list[Any] = []  # publishers
        self._answering: list[Any] = []  # services beside those of `Services`
        self._offered: Services | None = None
        self._markers: Markers | None = None
        self._recorder: Recorder | None = None
        self._log_error_told = False

        self._settings = declare_parameters(self)
        self.add_pre_set_parameters_callback(in_own_types)
        self.add_on_set_parameters_callback(self._may_set)
        self.add_post_set_parameters_callback(self._apply)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        # Simulated time may stand still; a log must be watched, and told of, nevertheless.
        self.create_timer(1.0, self._on_second, clock=Clock(clock_type=ClockType.STEADY_TIME))
        back = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1))
        self._jumps = self.get_clock().create_jump_callback(back, post_callback=self._on_jump)

    # Life

    def start(self) -> None:
        """Configure and activate, as a lifecycle manager would.

        Raises
        ------
        LinkageVibrationError
            If that cannot be done.
        """
        for step in (self.trigger_configure, self.trigger_activate):
            if step() is not TransitionCallbackReturn.SUCCESS:
                if not rclpy.ok():
                    raise ExternalShutdownException
                raise LinkageVibrationError(self.problem)

    @property
    def autostart(self) -> bool:
        """Whether it is to start by itself."""
        return self._settings.autostart

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load or build the table, and offer the services."""
        return self._become("inactive", self._configure, self._clean_up)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen, predict, and record where that is asked for."""
        return self._become("active", self._activate, self._deactivate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen no more, and complete the log."""
        return self._become("inactive", self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give back the table, the services and all that is published."""
        return self._become("unconfigured", self._clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End whatever is going on."""
        self._deactivate()
        return self._become("finalized", self._clean_up)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin anew after what nobody has foreseen."""
        self._deactivate()
        return self._become("unconfigured", self._clean_up)

    def close(self) -> None:
        """End the node, complete its log, and tell what was done."""
        self._deactivate()
        recorder = self._recorder
        self._clean_up()
        self.destroy_node()
        # The node's own logger would complain of a /rosout that a signal has shut down.
        counts, logger = self._statistics, get_logger(f"{NODE_NAME}.end")
        logger.info(f"{counts.received} readings in, {counts.predicted} predictions out.")
        if recorder is not None and recorder.path is not None:
            if recorder.error is not None and not self._log_error_told:
                logger.error(f"{recorder.error} Predictions went on.")
            logger.info(f"Log: {recorder.path}")

    def _become(
        self, state: str, do: Callable[[], None], undo: Callable[[], None] = lambda: None
    ) -> TransitionCallbackReturn:
        """Go over to a state; where that fails, tell why and stay."""
        try:
            do()
        except LinkageVibrationError as error:
            undo()
            self.problem = str(error)
            if not self.autostart:
                self.get_logger().error(self.problem)
            return TransitionCallbackReturn.FAILURE
        except (ExternalShutdownException, RCLError):
            if rclpy.ok():
                raise
            undo()  # a signal has come
            return TransitionCallbackReturn.FAILURE
        self.problem, self._state = "", state
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        settings = self._settings
        self._input = settings.crank_input()
        path = settings.excitation_file
        found = read_excitations(_path(path) if path else config_file(DEFAULT_EXCITATIONS))
        self._monitor = ResonanceMonitor(found)
        self._served = served = self._load_model()
        self._predictor = served.predictor
        self._prediction_publisher = self._publisher(VibrationPrediction, "~/prediction")
        self._resonance_publisher = self._publisher(ResonanceMessage, "~/resonance")
        self._info_publisher = self._publisher(TableInfo, "~/table_info", latched=True)
        self._mechanism_publisher = self._publisher(String, "~/mechanism", latched=True)
        self._output_topic = self._prediction_publisher.topic_name
        self._resonance_topic = self._resonance_publisher.topic_name
        self._offered = Services(self, self._serving, self._swap)
        self._markers = Markers(self, self._serving, self._marker_settings())
        self._answering = [
            self.create_service(Trigger, "~/start_recording", self._on_start_recording),
            self.create_service(Trigger, "~/stop_recording", self._on_stop_recording),
        ]
        joint_state = settings.input == JOINT_STATE
        self._input_topic = self.resolve_topic_name(
            "joint_states" if joint_state else "hitch_position"
        )
        self._reading = (
            f"joint {settings.joint_name} on {self._input_topic}"
            if joint_state
            else f"hitch position on {self._input_topic}"
        )
        topics = [
            _topic(
                self._input_topic,
                "sensor_msgs/msg/JointState" if joint_state else "std_msgs/msg/Float64",
            ),
            _topic(self._output_topic, "linkage_vibration_interfaces/msg/VibrationPrediction"),
            _topic(self._resonance_topic, "linkage_vibration_interfaces/msg/Resonance"),
        ]
        topics += [
            _topic(self.resolve_topic_name(name), "std_msgs/msg/Float64")
            for name in SPEED_TOPICS.values()
        ]
        self._recorder = Recorder(
            _path(settings.log_directory),
            topics,
            self._provenance(served),
            settings.limits(),
            settings.compression,
        )
        self._apply_settings()
        self._tell_table(served)

    def _activate(self) -> None:
        assert self._served is not None and self._recorder is not None
        self._statistics.last_reading = math.nan
        self._activated = time.monotonic()
        if self._settings.record:
            self._start_recording()
        if self._settings.input == JOINT_STATE:
            self._listen(self._input_topic, JointState, self._on_joint_state)
        else:
            self._listen(self._input_topic, Float64, self._on_percent)
        for source, name in SPEED_TOPICS.items():
            topic = self.resolve_topic_name(name)
            self._listen(topic, Float64, partial(self._on_speed, source, topic))
        table = self._served.table
        first, last = map(math.degrees, table.alpha3_range)
        self.get_logger().info(
            f"Predicting for {self._reading}, crank angles {first:g} to {last:g} deg, "
            f"table {table.table_id} of {self._served.mechanism.name}."
        )

    def _deactivate(self) -> None:
        for subscription in self._listening.values():
            self.destroy_subscription(subscription)
        self._listening.clear()
        self._resonance = None
        if self._recorder is not None:
            self._recorder.stop()

    def _clean_up(self) -> None:
        if self._offered is not None:
            self._offered.close()
        if self._markers is not None:
            self._markers.close()
        for service in self._answering:
            self.destroy_service(service)
        for publisher in self._sending:
            self.destroy_publisher(publisher)
        self._sending, self._answering = [], []
        self._offered = self._markers = self._recorder = self._served = None

    # What it is made of

    def _load_model(self) -> Served:
        """Return the mechanism with its table, read or built."""
        mechanism_file, table_file = self._settings.mechanism_file, self._settings.table_file
        path = _path(mechanism_file) if mechanism_file else config_file(DEFAULT_MECHANISM)
        mechanism = read_mechanism(path)
        if table_file or not mechanism_file:
            table_path = _path(table_file) if table_file else config_file(DEFAULT_TABLE)
            table = load_table(table_path, mechanism)
        else:
            self.get_logger().info(
                f"Building the table of {path}, as table_file is not given; "
                "`linkage-vibration build` makes one once and for all."
            )
            table = build_table(LinkageModel(mechanism), solved=_stop_if_asked)
        return Served(Predictor(table), mechanism, path.read_text(encoding="utf-8"))

    def _serving(self) -> Served:
        assert self._served is not None  # as long as there is somebody to ask
        return self._served

    def _swap(self, served: Served) -> None:
        """Serve another table from now on."""
        self._served, self._predictor = served, served.predictor
        if self._recorder is not None:
            self._recorder.change_provenance(self._provenance(served))
        self._tell_table(served)
        self.get_logger().info(f"Predicting from table {served.table.table_id} from now on.")

    def _provenance(self, served: Served) -> Provenance:
        """Return what a log keeps of the model and parameters that made it."""
        settings = f"# linkage_vibration {linkage_vibration.__version__}\n" + parameters_yaml(
            self._settings, self.get_fully_qualified_name()
        )
        name, table = served.mechanism.name, served.table
        return Provenance(
            (
                Attachment(f"{name}.yaml", "application/yaml", served.mechanism_text.encode()),
                Attachment(f"{table.table_id}.npz", "application/x-npz", table_bytes(table)),
                Attachment("parameters.yaml", "application/yaml", settings.encode()),
            ),
            {**package_versions(), "table_id": table.table_id, "mechanism": name},
        )

    def _tell_table(self, served: Served) -> None:
        self._info_publisher.publish(table_info(served.table, self.get_clock().now().to_msg()))
        self._mechanism_publisher.publish(String(data=served.mechanism_text))

    def _publisher(self, kind: Any, name: str, *, latched: bool = False) -> Any:
        qos = _qos(ReliabilityPolicy.RELIABLE)
        if latched:
            qos.depth, qos.durability = 1, DurabilityPolicy.TRANSIENT_LOCAL
        topic = self.resolve_topic_name(name)
        events = PublisherEventCallbacks(incompatible_qos=partial(self._on_deaf, topic))
        publisher = self.create_publisher(kind, name, qos, event_callbacks=events)
        self._sending.append(publisher)
        return publisher

    def _listen(self, topic: str, kind: Any, heard: Callable[..., None]) -> None:
        # Best effort hears publishers of either kind, and never waits for a lost message. rclpy's
        # type hints do not know that `raw` hands out bytes.
        self._listening[topic] = self.create_subscription(
            kind,
            topic,
            cast(Any, heard),
            _qos(ReliabilityPolicy.BEST_EFFORT),
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=partial(self._on_mute, topic)
            ),
            raw=True,
        )

    # What comes in

    def _on_joint_state(self, data: bytes, info: MessageInfo) -> None:
        began, received = time.monotonic(), self.get_clock().now().nanoseconds
        self._statistics.received += 1
        assert isinstance(self._input, JointInput)
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
        if self._other_joints:
            self._other_joints.clear()
        header = message.header
        self._record(self._input_topic, data, received, info)
        self._answer(
            reading, header.stamp.sec, header.stamp.nanosec, header.frame_id, received, began
        )

    def _on_percent(self, data: bytes, info: MessageInfo) -> None:
        began, received = time.monotonic(), self.get_clock().now().nanoseconds
        self._statistics.received += 1
        assert isinstance(self._input, PercentInput)
        try:
            percent = deserialize_message(data, Float64).data
        except RuntimeError as error:
            self._warn("bytes", f"A hitch position of {len(data)} bytes is not valid CDR: {error}")
            return
        self._record(self._input_topic, data, received, info)
        sec, nanosec = divmod(received, 10**9)
        self._answer(self._input.reading(percent), sec, nanosec, "", received, began)

    def _answer(
        self, reading: Reading, sec: int, nanosec: int, frame: str, received: int, began: float
    ) -> None:
        """Predict, publish and record."""
        counts = self._statistics
        counts.last_reading = began
        counts.take_stamp(sec, nanosec)
        prediction = self._predictor.predict(reading.crank_angle, reading.stddev)
        encoded = encode_prediction(prediction, sec, nanosec, frame)
        self._prediction_publisher.publish(encoded)
        counts.predicted += 1
        counts.latencies.append(time.monotonic() - began)
        self._record(self._output_topic, encoded, received)
        if self._monitor.speeds_told:
            self._resonance = self._monitor.assess(prediction, reading.velocity, received)
            encoded = encode_resonance(self._resonance, sec, nanosec, frame)
            self._resonance_publisher.publish(encoded)
            self._record(self._resonance_topic, encoded, received)
        if prediction.status.has_numbers:
            if self._markers is not None:
                self._markers.update(reading.crank_angle)
        else:
            counts.without_numbers += 1
        if prediction.status is not Status.OK:
            told = fault(prediction, self._predictor.table.alpha3_range)
            self._warn(prediction.status.name, f"{self._reading}: {told}.")

    def _on_speed(self, source: Source, topic: str, data: bytes, info: MessageInfo) -> None:
        received = self.get_clock().now().nanoseconds
        try:
            value = deserialize_message(data, Float64).data
        except RuntimeError as error:
            self._warn("speed", f"A speed of {len(data)} bytes is not valid CDR: {error}")
            return
        if self._settings.fixed_speed(source) is None:
            self._monitor.set_speed(source, value, received)
        self._record(topic, data, received, info)

    def _on_other(self, topic: str, data: bytes, info: MessageInfo) -> None:
        self._record(topic, data, self.get_clock().now().nanoseconds, info)

    def _record(
        self, topic: str, data: bytes, received: int, info: MessageInfo | None = None
    ) -> None:
        """Log a message that came, or one of ours as it is handed to DDS."""
        recorder = self._recorder
        # A simulated clock reads zero until it runs; such times would spoil the log.
        if recorder is None or not recorder.active or received <= 0:
            return
        sent = info["source_timestamp"] if info is not None else time.time_ns()
        recorder.write(topic, data, received, sent or received)

    # What is asked

    def _may_set(self, asked: "list[Parameter[Any]]") -> Any:
        return changed(self._settings, asked, configured=self._served is not None)[1]

    def _apply(self, asked: "list[Parameter[Any]]") -> None:
        configured = self._served is not None
        self._settings, _ = changed(self._settings, asked, configured=configured)
        if configured:
            self._apply_settings()

    def _apply_settings(self) -> None:
        """Let what can be set while the node works have its effect."""
        settings, monitor = self._settings, self._monitor
        self._input = settings.crank_input()
        monitor.warning_margin = settings.warning_margin
        monitor.hysteresis = settings.hysteresis
        monitor.stale_after = settings.stale_after
        for source in Source:
            fixed = settings.fixed_speed(source)
            if fixed is not None:
                monitor.set_fixed(source, fixed)
            elif monitor.is_fixed(source):
                monitor.forget(source)
        if self._markers is not None:
            self._markers.configure(self._marker_settings())

    def _marker_settings(self) -> MarkerSettings:
        settings = self._settings
        return MarkerSettings(settings.marker_mode, settings.marker_rate, settings.marker_frame)

    def _on_start_recording(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        if self._state != "active":
            response.message = f"The node is {self._state}; activate it first."
            return response
        try:
            response.message = str(self._start_recording())
        except LogError as error:
            response.message = str(error)
        else:
            response.success = True
        return response

    def _start_recording(self) -> Path | None:
        assert self._recorder is not None
        self._log_error_told = False
        self._recorder.start()
        self.get_logger().info(f"Recording to {self._recorder.path}")
        return self._recorder.path

    def _on_stop_recording(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        recorder = self._recorder
        if recorder is None or not recorder.active:
            response.message = "Nothing is being recorded."
            return response
        recorder.stop()
        response.success, response.message = True, str(recorder.path)
        self.get_logger().info(f"Log: {recorder.path}")
        return response

    # What it tells of itself

    def _on_second(self) -> None:
        now, counts = time.monotonic(), self._statistics
        counts.watch_wall_clock()
        self._find_extra_topics()
        self._tell_log_error()
        if self._state == "active":
            quiet = now - (
                self._activated if math.isnan(counts.last_reading) else counts.last_reading
            )
            if quiet > MISSING_AFTER and self._settings.input == JOINT_STATE:
                names = ", ".join(sorted(self._other_joints)[:MAX_NAMES_TOLD]) or "none"
                self._warn(
                    "missing",
                    f"Joint {self._settings.joint_name} has not been on {self._input_topic} for "
                    f"more than {MISSING_AFTER:g} s; joints seen there: {names}. Set joint_name to "
                    "one of them, or remap the topic.",
                )
        told = status(
            f"{self.get_fully_qualified_name()}: predictions",
            "" if self._served is None else self._served.mechanism.name,
            self._health(now),
            counts,
        )
        self._diagnostics.publish(diagnostics(self.get_clock().now().to_msg(), told))

    def _health(self, now: float) -> Health:
        counts, recorder, served = self._statistics, self._recorder, self._served
        rate, without_numbers = counts.since_last_time(now)
        return Health(
            state=self._state,
            problem=self.problem,
            reading=self._reading if served is not None else "",
            age=now - counts.last_reading,
            stale_after=self._settings.stale_after,
            rate=rate,
            without_numbers=without_numbers,
            resonance=self._resonance,
            log=None
            if recorder is None
            else Log(
                recorder.recording,
                str(recorder.path or ""),
                recorder.written,
                recorder.dropped,
                "" if recorder.error is None else str(recorder.error),
            ),
            table_id="" if served is None else served.table.table_id,
            interpolation_error=math.nan
            if served is None
            else float(served.table.interpolation_error.max()),
        )

    def _find_extra_topics(self) -> None:
        """Listen to those topics to be logged whose type has become known."""
        if self._state != "active" or self._recorder is None:
            return
        wanted = {self.resolve_topic_name(name) for name in self._settings.extra_topics.split()}
        wanted -= self._listening.keys()
        if not wanted:
            return
        for topic, types in self.get_topic_names_and_types():
            if topic in wanted:
                try:
                    kind = _message_class(types[0])
                    self._recorder.add_topic(_topic(topic, types[0]))
                except (LinkageVibrationError, ImportError, AttributeError) as error:
                    self._warn(topic, f"{topic} cannot be logged: {error}")
                    continue
                self._listen(topic, kind, partial(self._on_other, topic))

    def _on_jump(self, _: Any) -> None:
        self._statistics.clock_jumps += 1

    def _on_mute(self, topic: str, event: QoSRequestedIncompatibleQoSInfo) -> None:
        self._statistics.qos_mismatches[topic] += event.total_count_change
        self._warn(
            f"publisher of {topic}",
            f"A publisher of {topic} offers a QoS that this "
            f"node cannot use ({qos_policy_name_from_kind(event.last_policy_kind)}); nothing of it "
            "is received. Publish with sensor-data QoS.",
        )

    def _on_deaf(self, topic: str, event: QoSOfferedIncompatibleQoSInfo) -> None:
        self._statistics.qos_mismatches[topic] += event.total_count_change
        self._warn(
            f"subscriber of {topic}",
            f"A subscriber of {topic} asks for a QoS that this "
            f"node does not offer ({qos_policy_name_from_kind(event.last_policy_kind)}); it "
            "receives nothing. Subscribe volatile, reliable or best effort.",
        )

    def _tell_log_error(self) -> None:
        recorder = self._recorder
        if recorder is not None and recorder.error is not None and not self._log_error_told:
            self._log_error_told = True
            self.get_logger().error(f"{recorder.error} Predictions go on.")

    def _warn(self, about: str, text: str) -> None:
        """Warn, once in WARN_PERIOD about the same thing.

        rclpy's own throttle takes longer to keep silent than a whole prediction takes.
        """
        now = time.monotonic()
        if now >= self._next_warning.get(about, 0.0):
            self._next_warning[about] = now + WARN_PERIOD
            self.get_logger().warning(text)


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT, SIGTERM or SIGHUP, and return the exit code."""
    # ROS 2 from wheels lies in the Python environment and leaves this unset; a sourced one sets it.
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    # rclpy shuts down on both signals while it is up, and nothing else may act on them: Python's
    # KeyboardInterrupt could strike in the middle of a write to the log, and a second signal could
    # kill a process that is ending well. What comes before rclpy listens is held until it does.
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    for stop in STOP_SIGNALS:
        signal.signal(stop, signal.SIG_IGN)
    _end_on_hangup()
    try:
        rclpy.init(args=args)
    except RCLError as error:
        get_logger(NODE_NAME).fatal(" ".join(str(error).split()))
        return 1
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
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
        if node.autostart:
            node.start()
        # Single-threaded: the multi-threaded executor delays and loses messages under load, and the
        # events executor (about two thirds of the latency, in rclpy 9.1) never calls back with the
        # time of sending, which the log keeps.
        rclpy.spin(node)
    finally:
        node.close()


def _end_on_hangup() -> None:
    """Let the end of a terminal or a session end the node as SIGTERM does; rclpy ignores it.

    Not where whoever started it (nohup) wants it to be outlived.
    """
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGHUP])

    def wait() -> None:
        signal.sigwait([signal.SIGHUP])
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, name="hangup", daemon=True).start()


def _stop_if_asked() -> None:
    if not rclpy.ok():
        raise ExternalShutdownException


def table_info(table: Table, stamp: Any) -> TableInfo:
    """Return what ``~/table_info`` tells of a table in use since a time."""
    first, last = table.alpha3_range
    sound_first, sound_last = table.sound_range
    return TableInfo(
        stamp=stamp,
        table_id=table.table_id,
        mechanism_name=table.mechanism_name,
        model_hash=table.model_hash,
        package_version=table.package_version,
        crank_angle_first=first,
        crank_angle_last=last,
        sound_first=max(first, sound_first),
        sound_last=min(last, sound_last),
        band_low=table.band[0],
        band_high=table.band[1],
        n_modes=table.n_modes,
        n_points=len(table.alpha3),
        interpolation_error=float(table.interpolation_error.max()),
        peak_error=table.peak_error,
        frf_error=table.frf_error,
        places=[place_name(place) for place in table.places],
    )


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


def _message_class(type_name: str) -> Any:
    """Return the Python class of a type such as ``std_msgs/msg/String``."""
    package, _, name = type_name.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), name)


def _topic(name: str, type_name: str) -> Topic:
    # Played back as reliable, a log reaches subscribers of either kind.
    qos = offered_qos_profiles(reliable=True, depth=QUEUE_DEPTH)
    return Topic(name, type_name, message_definition(type_name), type_hash(type_name), qos)


if __name__ == "__main__":
    sys.exit(main())
