# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""The node's services: predictions, FRFs, mode shapes, the table, advice, another implement."""

import math
import tempfile
import time
from array import array
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import astuple
from functools import partial
from pathlib import Path
from threading import get_ident
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.task import Future

from linkage_vibration.errors import LinkageVibrationError
from linkage_vibration.messages.encoding import encode_message
from linkage_vibration.messages.topics import ADVICE, PREDICTION
from linkage_vibration.prediction import answers
from linkage_vibration.prediction.advice import Question, advise
from linkage_vibration.prediction.answers import LoadedModel, ServingError, place_name
from linkage_vibration.prediction.excitation import Excitation, Source
from linkage_vibration.prediction.levels import LevelTable
from linkage_vibration.prediction.predictor import Predictor, fault
from linkage_vibration.ros.endpoints import rest
from linkage_vibration.support.own_process import call_in_process
from linkage_vibration_interfaces import srv
from linkage_vibration_interfaces.action import SetImplement
from linkage_vibration_interfaces.msg import Advice, VibrationPrediction

P = ParamSpec("P")
T = TypeVar("T")

MAX_REQUEST = 1_000  # angles, which take less than 0.1 s; other requests wait meanwhile
MAX_WAITING = 16  # requests; each costs the executor a microsecond when it wakes
SLICE = 10  # predictions in less than a millisecond, after which the readings have the processor
FEEDBACK_PERIOD = 0.25  # s
DELIVERY = 0.3  # s, in which the middleware sends an answer
_CODES = {"sequence<double>": "d", "sequence<float>": "f", "sequence<uint8>": "B"}  # of arrays


class Services:
    """Answers requests; models are solved in a thread, and tables are built in a process."""

    def __init__(
        self,
        node: Node,
        served: Callable[[], LoadedModel],
        excitations: Sequence[Excitation],
        swap: Callable[[LoadedModel, LevelTable], None],  # in the executor's thread
        levels: LevelTable,
        limit: Callable[[], float],  # returns the load ratio above which a load warns
    ) -> None:
        self._node, self._served, self._swap, self._limit = node, served, swap, limit
        self._excitations, self._levels = excitations, levels
        # At most one of them builds a table; the other is free for short requests.
        self._threads = ThreadPoolExecutor(2, "linkage_vibration_services")
        self._ending, self._waiting, self._answered_at = False, 0, -math.inf
        self._awaited: set[Future[None]] = set()  # of the requests and goals that wait
        self._goals = 0  # whose results are not sent yet
        self._wanted: Path | None = None  # a folder; its removal stops the building of a table
        group = ReentrantCallbackGroup()
        offer: Any = partial(node.create_service, callback_group=group)
        self._services = [
            offer(srv.PredictVibration, "~/predict", _reporting(self._predict)),
            offer(srv.GetFrf, "~/get_frf", _reporting(self._get_frf)),
            offer(srv.GetGroundLevels, "~/get_ground_levels", _reporting(self._get_ground_levels)),
            offer(srv.GetModeShapes, "~/get_mode_shapes", _reporting(self._get_mode_shapes)),
            offer(srv.GetTable, "~/get_table", _reporting(self._get_table)),
            offer(srv.Advise, "~/advise", _reporting(self._advise)),
        ]
        accept: Any = {"cancel_callback": lambda _: CancelResponse.ACCEPT, "callback_group": group}
        name = "~/set_implement"
        self._actions = [ActionServer(node, SetImplement, name, self._on_goal, **accept)]

    @property
    def busy(self) -> bool:
        """Whether a request or a goal has no answer yet."""
        return self._waiting > 0 or self._goals > 0

    def refuse(self) -> None:
        """Stop building; requests and goals that wait, and later ones, are answered by an error.

        They do not wait for what a thread or another process still computes.
        """
        self._ending = True
        self._stop_building()
        self._threads.shutdown(wait=False, cancel_futures=True)
        for ready in list(self._awaited):
            ready.set_result(None)

    def close(self) -> None:
        """Stop building, answer what waits, and destroy the services, in the executor's thread."""
        self.refuse()
        self._threads.shutdown()
        self._destroy()

    def _stop_building(self) -> None:
        if self._wanted is not None:
            with suppress(FileNotFoundError):
                self._wanted.rmdir()

    def _destroy(self) -> None:
        """Destroy the services; if the executor continues, it first answers waiting requests.

        It may call this first, as rclpy 7 begins with the latest task, so this may call itself.
        """
        if self.busy and self._node.executor is not None:
            self._node.executor.create_task(self._destroy)
            return
        # The middleware forgets what it has not sent when a service is destroyed.
        time.sleep(max(self._answered_at + DELIVERY - time.monotonic(), 0.0))
        for service in self._services:
            self._node.destroy_service(service)
        while self._actions:
            self._actions.pop().destroy()

    async def _predict(
        self, request: srv.PredictVibration.Request, response: srv.PredictVibration.Response
    ) -> str:
        angles, stddev = request.crank_angles, request.crank_angle_stddev
        if not 0 < len(angles) <= MAX_REQUEST:
            raise ServingError(
                f"crank_angles has {len(angles)} angles; give 1 to {MAX_REQUEST} in a request."
            )
        if not 0.0 <= stddev < math.inf:
            raise ServingError(
                f"crank_angle_stddev is {stddev} rad; give a finite number of at least 0."
            )
        predictor = self._served().predictor
        now = self._node.get_clock().now().seconds_nanoseconds()
        response.predictions, failed, shares = await self._away(_predict, predictor, request, now)
        response.frequency_shares = _numbers(shares[:, :, 0])
        response.damping_ratio_shares = _numbers(shares[:, :, 1])
        if failed:
            problem = fault(predictor.predict(angles[failed[0]]), predictor.table.alpha3_range)
            response.message = (
                f"{len(failed)} of {len(angles)} angles have no prediction, the first is "
                f"crank_angles[{failed[0]}]: {problem}."
            )
        return predictor.table.unknown_deviations

    async def _answered(self, response: Any, ask: Callable[..., T], *args: Any, **kwargs: Any) -> T:
        """Give a response what a function of the mechanism in use answers, and return that."""
        served = self._served()
        answer = await self._away(ask, served, *args, **kwargs)
        _fill(response, served, answer)
        return answer

    async def _get_frf(self, request: srv.GetFrf.Request, response: srv.GetFrf.Response) -> None:
        asked = request.crank_angle, request.outputs, request.inputs, np.array(request.frequencies)
        answer = await self._answered(response, answers.answer_frf, *asked, exact=request.exact)
        values = answer.values
        response.real, response.imaginary = _numbers(values.real), _numbers(values.imag)

    async def _get_ground_levels(self, request: srv.GetGroundLevels.Request, response: Any) -> None:
        asked = self._excitations, request.crank_angle, abs(request.ground_speed), request.outputs
        await self._answered(response, answers.answer_ground, *asked)

    async def _get_mode_shapes(self, request: srv.GetModeShapes.Request, response: Any) -> None:
        await self._answered(response, answers.answer_mode_shapes, request.crank_angle)

    async def _get_table(self, _: object, response: srv.GetTable.Response) -> None:
        served = self._served()
        response.table = array("B", await self._away(lambda: served.table_file))
        response.table_id = served.table.table_id
        response.mechanism = served.mechanism_text

    async def _advise(self, request: srv.Advise.Request, response: srv.Advise.Response) -> None:
        angles = request.crank_angle_min, request.crank_angle_max
        speeds = request.ground_speed_min, request.ground_speed_max
        present = [request.engine_speed, request.pto_speed, abs(request.ground_speed)]
        present = [speed / source.si for source, speed in zip(Source, present, strict=True)]
        question = Question(
            request.crank_angle,
            np.array(present),
            None if angles == (0.0, 0.0) else angles,
            None if speeds == (0.0, 0.0) else speeds,
        )
        served = self._served()
        sec, nanosec = self._node.get_clock().now().seconds_nanoseconds()
        asked = partial(advise, self._levels, self._excitations, question, limit=self._limit())
        advised = await self._away(asked)
        # The bytes of the topic, decoded, so that the service and the topic cannot differ.
        advised.message.table_id = served.table.table_id
        encoded = encode_message(ADVICE, advised.message, sec, nanosec, "")
        response.advice = deserialize_message(encoded, Advice)
        _fill(response, served, advised)

    async def _on_goal(self, goal: Any) -> SetImplement.Result:
        """Use another implement, with progress; a client may cancel it."""
        clock, result = Clock(clock_type=ClockType.STEADY_TIME), SetImplement.Result()
        self._goals += 1
        timer = self._node.create_timer(FEEDBACK_PERIOD, lambda: self._report(goal), clock=clock)
        try:
            await self._replace(self._served(), _implement(goal.request))
        except LinkageVibrationError as error:
            result.message = f"The table is unchanged: {error}"
        finally:
            self._node.destroy_timer(timer)
            # rclpy sends the result in a task of its own, which may follow the first of these.
            self._later(lambda: self._later(self._sent))
        with suppress(LinkageVibrationError):
            result.table_id = self._served().table.table_id
        result.success = not result.message
        end = goal.canceled if goal.is_cancel_requested else goal.abort
        (goal.succeed if result.success else end)()
        return result

    def _later(self, call: Callable[[], object]) -> None:
        """Call a function in the executor, if there is one."""
        if self._node.executor is not None:
            self._node.executor.create_task(call)

    def _sent(self) -> None:
        """Note that a result is sent."""
        self._goals -= 1

    def _report(self, goal: Any) -> None:
        """Publish how much of a table is built, or stop if its client has cancelled it."""
        if goal.is_cancel_requested:
            self._stop_building()
        elif self._wanted is not None:
            with suppress(OSError, ValueError):  # nothing is written yet
                finished = float(answers.progress_file(self._wanted).read_text())
                feedback = SetImplement.Feedback(progress=finished, step="building the table")
                goal.publish_feedback(feedback)

    async def _replace(self, served: LoadedModel, wanted: answers.Implement | str) -> None:
        """Build the table for another implement, or for that of a name, and use it."""
        if self._wanted is not None:
            raise ServingError(
                "The table of another implement is being built; ask again when it is in use."
            )
        changed = answers.replaced(served, wanted)
        with tempfile.TemporaryDirectory(prefix="linkage_vibration_") as folder:
            self._wanted = Path(folder) / "wanted"
            self._wanted.mkdir()
            try:
                # A thread would block the interpreter, and so the readings, again and again.
                like = changed.mechanism, served.table, self._excitations, self._wanted
                building = partial(call_in_process, answers.rebuilt, *like)
                predictor, levels = await self._away(building)
                # The table may be complete although the node was cleaned up meanwhile.
                if self._served() is not served:
                    raise ServingError("The node was configured again; ask again.")
                self._swap(changed.with_predictor(predictor), levels)
                self._levels = levels
            finally:
                self._wanted = None

    async def _away(self, work: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Call a function in a thread while the executor continues; all its errors become ours."""
        if self._waiting >= MAX_WAITING:
            raise ServingError(f"{self._waiting} requests are waiting already; ask again later.")
        ready: Future[None] = Future()
        worker, began = 0, 0.0

        def measured() -> T:
            nonlocal worker, began
            worker, began = get_ident(), time.thread_time()
            return work(*args, **kwargs)

        def done(_: object) -> None:
            if not ready.done():
                ready.set_result(None)
            # A sleeping executor does not see the result. It may also have ended by now.
            with suppress(InvalidHandle):
                if self._node.executor is not None:
                    self._node.executor.wake()
            if get_ident() == worker:
                rest(time.thread_time() - began)

        self._waiting += 1
        try:
            if self._ending:
                raise CancelledError
            answer = self._threads.submit(measured)
            self._awaited.add(ready)
            answer.add_done_callback(done)
            await ready
            if not answer.done():
                raise CancelledError
            return answer.result()
        except LinkageVibrationError:
            raise
        except CancelledError:
            raise ServingError("The node is ending or being cleaned up.") from None
        except Exception as error:
            self._node.get_logger().error(f"A request failed: {type(error).__name__}: {error}")
            raise ServingError(
                f"This cannot be computed ({type(error).__name__}: {error}); check the numbers."
            ) from None
        finally:
            self._awaited.discard(ready)
            self._waiting, self._answered_at = self._waiting - 1, time.monotonic()


def _implement(request: SetImplement.Goal) -> answers.Implement | str:
    """Return the implement of a goal, or its name."""
    centre = tuple(request.centre_of_gravity)
    implement = answers.Implement(request.rigid_body, request.mass, request.inertia, centre)
    if request.name and implement != answers.Implement("", 0.0, 0.0, ()):
        raise ServingError("name has its own properties; leave all other fields empty.")
    return request.name or implement


def _reporting(answer: Callable[[Any, Any], Awaitable[str | None]]) -> Callable[..., Any]:
    """Return the callback of a service whose response reports the error, or else a note."""

    async def respond(request: Any, response: Any) -> Any:
        note: str | None = ""
        try:
            note = await answer(request, response)
        except LinkageVibrationError as error:
            response.message = str(error)
        response.success = not response.message
        response.message = response.message or note or ""
        return response

    return respond


def _predict(
    predictor: Predictor, request: srv.PredictVibration.Request, stamp: tuple[int, int]
) -> tuple[list[VibrationPrediction], list[int], NDArray[np.float64]]:
    """Return predictions, indices of angles without one, and shares, (n or 0, 4, 2, n_modes)."""
    messages, failed, shares = [], [], []
    stddev, began = request.crank_angle_stddev, time.thread_time()
    for i, angle in enumerate(request.crank_angles):
        prediction = predictor.predict(angle, stddev)
        # The bytes of the topic, decoded, so that the service and the topic cannot differ.
        encoded = encode_message(PREDICTION, prediction, *stamp, "")
        messages.append(deserialize_message(encoded, VibrationPrediction))
        if not prediction.status.has_numbers:
            failed.append(i)
        if request.shares:
            shares.append(astuple(predictor.shares(angle, stddev)))
        if i % SLICE == SLICE - 1:
            rest(time.thread_time() - began)
            began = time.thread_time()
    return messages, failed, np.reshape(shares, (len(shares), 4, 2, predictor.table.n_modes))


def _fill(response: Any, served: LoadedModel, answer: object) -> None:
    """Give a response the id of the table, and what of an answer has the names of its fields."""
    for name, kind in response.get_fields_and_field_types().items():
        match getattr(answer, name, None):
            case np.ndarray() as numbers:
                setattr(response, name, _numbers(numbers, _CODES[kind]))
            case tuple() as texts:
                names = [place_name(each) if isinstance(each, tuple) else each for each in texts]
                setattr(response, name, names)
            case float() as number:
                setattr(response, name, number)
    if hasattr(response, "table_id"):
        response.table_id = served.table.table_id


def _numbers(values: "NDArray[np.float64 | np.uint8]", code: str = "d") -> "array[Any]":
    """Return numbers row by row in an array, which messages accept without checking each."""
    return array(code, np.ascontiguousarray(values, code).tobytes())
