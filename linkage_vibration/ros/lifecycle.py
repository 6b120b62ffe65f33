# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The lifecycle node: what it does in each state, and its diagnostics."""

import math
import os
import select
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from inspect import iscoroutinefunction
from threading import Thread
from typing import Any, BinaryIO

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.guard_condition import GuardCondition
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from linkage_vibration.bags.recorder import (
    LogLimits,
    Provenance,
    Recorder,
    log_writer,
    package_versions,
)
from linkage_vibration.bags.writing import LogError
from linkage_vibration.errors import LinkageVibrationError, printable
from linkage_vibration.messages.definitions import check_interfaces
from linkage_vibration.messages.topics import TABLE_INFO
from linkage_vibration.prediction.answers import LoadedModel, place_name
from linkage_vibration.prediction.doubts import excitation_doubts
from linkage_vibration.prediction.excitation import Excitation
from linkage_vibration.prediction.level_cache import kept_table
from linkage_vibration.prediction.levels import LevelTable, kept_levels
from linkage_vibration.prediction.provenance import attachments, implement_facts
from linkage_vibration.prediction.resonance import ResonanceMonitor
from linkage_vibration.prediction.settings import NODE_NAME, ParameterError, Parameters
from linkage_vibration.readers.excitations import excitation_files
from linkage_vibration.readers.loaded_model import load_model, read_loads
from linkage_vibration.readers.sensors import Sensor, live_sensors, sensor_files
from linkage_vibration.ros.command_line import plain_text
from linkage_vibration.ros.diagnostics import Health, statuses
from linkage_vibration.ros.endpoints import OUTPUTS, WARN_PERIOD, Throttle, advertise, rest
from linkage_vibration.ros.listener import Listener
from linkage_vibration.ros.live_inputs import LiveTopic, check_output_topics, live_topics
from linkage_vibration.ros.live_pipeline import LivePipeline, input_topics, output_topics
from linkage_vibration.ros.log_control import Recording, log_folder
from linkage_vibration.ros.parameter_server import (
    changed,
    check_qos_overrides,
    declare_parameters,
    new_values,
)
from linkage_vibration.ros.services import Services
from linkage_vibration.ros.statistics import CLOCK_LEAP, Statistics
from linkage_vibration_interfaces.msg import TableInfo

TRANSITIONS = {
    Transition.TRANSITION_CONFIGURE: "configure",
    Transition.TRANSITION_ACTIVATE: "activate",
}
ANSWER_TIME = 1.0  # s, in which requests that wait are answered when the node ends
ARRIVAL_TIME = 0.1  # s, in which requests that are under way may still arrive
FULFILLED = {"configure": ("inactive", "active"), "activate": ("active",)}  # by these states


class LinkageVibrationNode(LifecycleNode):
    """Predicts from each reading while active, with its table and services while configured."""

    def __init__(self, stop_asked: Callable[[], bool] = lambda: False) -> None:
        super().__init__(NODE_NAME, automatically_declare_parameters_from_overrides=True)
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = self._fulfilling(service.callback)
            if service.srv_type.__module__.startswith("lifecycle_msgs"):
                service.callback = self._guarded(service.callback)
        self.problem = ""  # why the last transition failed, if it did
        self._stop_asked = stop_asked  # by long operations
        self._state, self._starting, self._untouched = "unconfigured", False, True
        self._statistics = Statistics()
        self._throttle = Throttle(self.get_logger())
        # These exist while the node is configured.
        self._served: LoadedModel | None = None
        self._excitations, self._monitored = dict[str, bytes](), tuple[Excitation, ...]()
        self._predicting: LivePipeline | None = None
        self._sensors = list[Sensor]()
        self._recording: Recording | None = None
        self._offered: Services | None = None
        self._outputs = dict[str, Any]()  # by the types of their messages

        self._settings = declare_parameters(self)
        self._listener = Listener(self)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        # A simulated clock that runs fast goes forward by less from message to message.
        limits = Duration(seconds=CLOCK_LEAP), Duration(nanoseconds=-1)
        self._jumps = self.get_clock().create_jump_callback(
            JumpThreshold(min_forward=limits[0], min_backward=limits[1]),
            pre_callback=self._before_jump,
            post_callback=self._on_jump,
        )
        second = self.create_guard_condition(self._on_second)
        reader, writer = os.pipe()
        self._pipe = os.fdopen(reader, "rb"), os.fdopen(writer, "wb")
        self._seconds = Thread(
            target=_trigger_every_second, args=[second, self._pipe[0]], daemon=True
        )
        self._seconds.start()

    def start(self) -> None:
        """Configure and activate the node as a lifecycle manager does, or raise an error."""
        self._starting = True  # the caller reports a failure
        for step in (self.trigger_configure, self.trigger_activate):
            done = step()
            self._check_signals()
            if done is not TransitionCallbackReturn.SUCCESS:
                raise LinkageVibrationError(self.problem)
        self._starting = False

    @property
    def autostart(self) -> bool:
        """Whether the node starts by itself."""
        return self._settings.autostart

    def set_parameters_atomically(
        self, parameter_list: "list[Parameter[Any]]"
    ) -> SetParametersResult:
        """Set parameters for a service, before rclpy checks them, so that refusals are ours."""
        asked, settings = new_values(self, parameter_list), self._settings
        result = SetParametersResult(successful=True)
        try:
            self._use(changed(settings, asked, configured=self._served is not None))
            if asked:
                result = super().set_parameters_atomically(asked)
        except LinkageVibrationError as error:
            result = SetParametersResult(successful=False, reason=str(error))
        if not result.successful:
            self._use(settings)
        return result

    def set_parameters(self, parameter_list: "list[Parameter[Any]]") -> list[SetParametersResult]:
        """Set each parameter for itself, as `set_parameters_atomically` does."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read or build the table, and offer the services."""
        return self._become("inactive", self._configure, self._clean_up)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Subscribe, predict, and record if the parameter record is set."""
        return self._become("active", self._activate, self._deactivate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Unsubscribe, and complete the log."""
        return self._become("inactive", self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release the table, the services and the publishers."""
        return self._become("unconfigured", self._clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End everything."""
        self._deactivate()
        return self._become("finalized", self._clean_up)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Return to the first state after an unexpected error, which `problem` keeps."""
        self._deactivate()
        self._clean_up()
        self._state = "unconfigured"
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """End the node, complete its log, and log a summary."""
        self._pipe[1].close()
        self._seconds.join()  # a thread that runs while Python ends may crash the process
        self._pipe[0].close()
        recording, counts = self._recording, self._statistics
        self._deactivate()
        self._clean_up()
        summary = f"{counts.received} messages received, {counts.predicted} predictions made."
        self.get_logger().info(summary)
        if recording is not None:
            recording.report_end()
        self._listener.close()
        self.destroy_node()

    def serve(self, executor: Executor) -> None:
        """Handle what is not a reading, for one turn of an executor, and rest after it.

        For another timeout rclpy starts again, with the request that waits, and so never gets
        further. Without a timeout, the guard condition of every second ends a turn.
        """
        began = time.thread_time()
        executor.spin_once()
        if self._listener.active:
            rest(time.thread_time() - began)

    def answer_waiting(self, executor: Executor) -> None:
        """Answer the requests and goals that wait, and that arrive now, by an error.

        A client may ask for the result of its goal only after that has ended.
        """
        if self._offered is None:
            return
        began, waited = time.monotonic(), self._offered.busy
        self._offered.refuse()
        while time.monotonic() < began + (ANSWER_TIME if waited else ARRIVAL_TIME):
            executor.spin_once(0.05)
            waited |= self._offered.busy

    def create_service(self, kind: Any, name: str, callback: Any, **options: Any) -> Any:
        """Offer a service, as rclpy does, whose errors do not end the process."""
        return super().create_service(kind, name, self._guarded(callback), **options)

    def _guarded(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that logs rclpy's errors for invalid requests; coroutines are ours."""

        def call(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except (RuntimeError, ValueError) as error:
                why = f"while the node is {self._state}: {plain_text(error)}"
                self.get_logger().error(f"A request was refused {why}.")
                return response

        return callback if iscoroutinefunction(callback) else call

    def _fulfilling(self, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return a callback that accepts what a node with autostart has done before a manager."""

        def call(request: ChangeState.Request, response: ChangeState.Response) -> Any:
            wanted = request.transition.label or TRANSITIONS.get(request.transition.id, "")
            done = FULFILLED.get(wanted, ())
            if not (self.autostart and self._state in done):
                return callback(request, response)
            self.get_logger().info(f"A request to {wanted} the node finds it {self._state}.")
            response.success = True
            return response

        return call

    def _become(
        self, state: str, do: Callable[[], None], undo: Callable[[], None] = lambda: None
    ) -> TransitionCallbackReturn:
        """Change to a state; if that fails, undo it and report why."""
        self._untouched = False
        try:
            do()
        except LinkageVibrationError as error:
            undo()
            self.problem = str(error)
            if not self._starting:
                self.get_logger().error(self.problem)
            return TransitionCallbackReturn.FAILURE
        except ExternalShutdownException:
            undo()
            return TransitionCallbackReturn.FAILURE
        except Exception as defect:
            self.problem = f"{type(defect).__name__}: {defect}; please report this."
            self.get_logger().error(self.problem)
            raise
        self.problem, self._state = "", state
        return TransitionCallbackReturn.SUCCESS

    def _on_building(self, finished: float) -> None:
        """Log how much of a table is built, and stop at a signal."""
        self._check_signals()
        words = f"{100.0 * finished:.0f} % of the table is built."
        self.get_logger().info(words, throttle_duration_sec=WARN_PERIOD)

    def _check_signals(self) -> None:
        if self._stop_asked():
            raise ExternalShutdownException

    def _configure(self) -> None:
        check_interfaces()
        settings = self._settings
        folder = log_folder(settings)
        try:
            log_writer()
        except LogError as error:
            self.get_logger().warning(f"{error} The node predicts without.")
        self._served = served = load_model(
            settings, self.get_logger().info, self._on_building, kept_table
        )
        self._check_signals()
        self._monitored = excitations = read_loads(settings, served, self.get_logger().info)
        path = settings.sensor_path()
        self._sensors = live_sensors(path) if path else []
        self._excitations = excitation_files(settings.excitation_path()) | sensor_files(path)
        levels = kept_levels(served.predictor, served.mechanism, excitations)
        self._check_signals()
        levels.prepare()  # so that no reading waits for it
        self._check_signals()
        for doubt in excitation_doubts(excitations, levels):
            self.get_logger().info(f"{settings.excitation_path()}: {doubt}")
        inputs = self._input_topics(settings)
        check_qos_overrides(self, inputs)
        topics = [*input_topics(inputs), *output_topics(self)]
        provenance = self._provenance(served)
        sizes = settings.split_size, settings.split_duration, settings.disk_limit
        limits = LogLimits(*sizes, settings.delete_oldest)
        recorder = Recorder(folder, topics, provenance, limits, settings.compression)
        self._recording = recording = Recording(self, recorder, self._begin_log)
        self._outputs = {output.type: advertise(self, output) for output in OUTPUTS}
        sensors = None
        if self._sensors:
            # It takes half of the time of all imports.
            from linkage_vibration.listening.live import sensor_monitor

            sensors = sensor_monitor(self._sensors, served, excitations, settings)
        self._predicting = LivePipeline(
            self,
            self._listener,
            self._outputs,
            settings,
            inputs,
            served.predictor,
            ResonanceMonitor(excitations, levels=levels),
            sensors,
            recording.write,
            self._statistics,
            self._throttle,
        )
        used = excitations, self._swap, levels, lambda: self._settings.warning_load_ratio
        self._offered = Services(self, self._serving, *used)
        self._publish_model(served)

    def resolve_topic_name(self, topic: str, **options: Any) -> str:
        """Return the absolute name of a topic after remapping, or raise a `ParameterError`."""
        try:
            return str(super().resolve_topic_name(topic, **options))
        except RuntimeError:  # of rcl
            raise ParameterError(
                f"The topic {topic[:40]!r} of {len(topic)} characters has an invalid name; use "
                "letters, digits, _ and /, and at most 247 characters with the namespace."
            ) from None

    def _activate(self) -> None:
        assert self._predicting is not None
        assert self._recording is not None
        self._recording.activate(begin=self._settings.record)
        self._predicting.subscribe()
        self._listener.start()
        served = self._serving()
        first, last = map(math.degrees, served.table.alpha3_range)
        source = printable(self._predicting.input_name)
        self.get_logger().info(
            f"Predicting for {source}, crank angles {first:g} to {last:g} "
            f"deg, table {served.table.table_id} of {served.mechanism.name}{_with_name(served)}."
        )

    def _deactivate(self) -> None:
        self._listener.stop()
        if self._predicting is not None:
            self._predicting.unsubscribe()
        if self._recording is not None:
            self._recording.deactivate()

    def _begin_log(self, start: Callable[[], None]) -> None:
        """Start a log whose load states count from 1, as those of its replay do."""
        with self._listener.paused():
            start()
            if self._predicting is not None:
                self._predicting.restart_count()

    def _clean_up(self) -> None:
        for part in (self._offered, self._recording):
            if part is not None:
                part.close()
        while self._outputs:
            self.destroy_publisher(self._outputs.popitem()[1])
        self._offered = self._predicting = self._recording = self._served = None

    def _serving(self) -> LoadedModel:
        if self._served is None:
            # A request may arrive before its service is destroyed.
            raise LinkageVibrationError("The node is not configured; configure it first.")
        return self._served

    def _swap(self, served: LoadedModel, levels: LevelTable) -> None:
        """Use another table from now on."""
        assert self._predicting is not None
        assert self._recording is not None
        provenance = self._provenance(served)
        with self._listener.paused():
            self._served = served
            self._predicting.replace(served.predictor, served.mechanism, levels)
            self._recording.recorder.change_provenance(provenance)
        self._publish_model(served)
        self.get_logger().info(
            f"Predicting from table {served.table.table_id}{_with_name(served)} from now on."
        )

    def _publish_model(self, served: LoadedModel) -> None:
        now = self.get_clock().now().to_msg()
        self._outputs[TABLE_INFO].publish(_table_info(served, self._monitored, now))

    def _provenance(self, served: LoadedModel) -> Provenance:
        """Return the model and the parameters that a log attaches."""
        name = self.get_fully_qualified_name()
        files = attachments(served, self._settings, name, self._excitations)
        facts = {"table_id": served.table.table_id, "mechanism": served.mechanism.name}
        return Provenance(files, {**package_versions(), **facts, **implement_facts(served)})

    def _use(self, settings: Parameters) -> None:
        """Use other parameters from now on; after an error, those before have to be used again."""
        if settings == self._settings:
            return
        predicting, recording = self._predicting, self._recording
        if predicting is None or recording is None:
            self._settings = settings
            return
        topics = self._input_topics(settings)
        logged = input_topics(topics)  # which need their definitions
        self._settings = settings
        with self._listener.paused():
            for topic in logged:
                recording.recorder.add_topic(topic)
            predicting.apply(settings, topics)
            recording.recorder.change_provenance(self._provenance(self._serving()))

    def _input_topics(self, settings: Parameters) -> dict[str, LiveTopic]:
        """Return the topics of the inputs by their absolute names, which no output has."""
        topics = live_topics(settings, self.resolve_topic_name, self._sensors)
        check_output_topics(topics, self.resolve_topic_name)
        return topics

    def _on_second(self) -> None:
        if self.autostart and self._untouched:  # somebody else made the node, and spins it
            self.start()
        self._listener.check()
        now, counts = time.monotonic(), self._statistics
        counts.watch_wall_clock(time.time(), now)
        if self._recording is not None:
            self._recording.watch()
        if self._predicting is not None:
            self._predicting.judge(now)
        name = self.get_fully_qualified_name()
        health = Health(
            self._state,
            self.problem,
            counts.since_last_time(now),
            self._served,
            self._predicting,
            self._recording,
            same_name=self.get_fully_qualified_node_names().count(name),
        )
        message = DiagnosticArray(status=statuses(name, health, counts))
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _before_jump(self) -> None:
        self._before = self.get_clock().now().nanoseconds

    def _on_jump(self, _: Any) -> None:
        self._statistics.clock_jumps += self._before > 0  # a simulated clock begins at zero


def _trigger_every_second(guard: GuardCondition, end: BinaryIO) -> None:
    """Trigger a guard condition every second of the steady clock, until a file ends.

    The waits of the middleware are by the wall clock, so they last an hour longer if that is set
    back by an hour; a timer of rclpy would not end them.
    """
    with suppress(InvalidHandle):
        while not select.select([end], [], [], 1.0)[0]:
            guard.trigger()


def _with_name(served: LoadedModel) -> str:
    """Return the name of the implement in use, as a part of a sentence."""
    name = implement_facts(served).get("implement")
    return f" with the implement {name}" if name else ""


def _table_info(served: LoadedModel, excitations: Sequence[Excitation], stamp: Time) -> TableInfo:
    """Return the message that describes a table, which is in use since a time."""
    table, response = served.table, served.mechanism.response
    low, high = table.alpha3_range
    sound = max(low, table.range_away_from_toggles[0]), min(high, table.range_away_from_toggles[1])
    same = "table_id mechanism_name model_hash package_version n_modes"
    same += " peak_error frf_error force_error mode_names unknown_deviations force_places"
    info = TableInfo(
        stamp=stamp,
        n_points=len(table.alpha3),
        interpolation_error=float(table.interpolation_error.max()),
        places=[place_name(place) for place in table.frf_places],
        excitations=[excitation.name for excitation in excitations],
        response_place=place_name((response.point, response.direction)),
        mechanism=served.mechanism_text,
        **{name: getattr(table, name) for name in same.split()},
    )
    info.crank_angle_first, info.crank_angle_last = low, high
    info.sound_first, info.sound_last = sound
    info.band_low, info.band_high = table.band
    info.peak_band_low, info.peak_band_high = table.peak_band
    info.mode_base_shares, info.mode_body_shares, info.mode_link_shares = table.mode_shares.T
    return info
