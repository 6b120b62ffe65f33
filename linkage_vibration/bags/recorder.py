# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Records messages to logs on a thread of its own, so that the caller never waits."""

import contextlib
import fcntl
import math
import os
import platform
import re
import shutil
import threading
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from linkage_vibration.bags.writing import Attachment, DiskError, LogError, LogExistsError, Topic
from linkage_vibration.support.missing_library import missing_library
from linkage_vibration.support.resources import command

if TYPE_CHECKING:
    from linkage_vibration.bags.log_writer import LogWriter

# When the queue is this full, messages are dropped. 50,000 messages are 10 s of five topics at
# 1 kHz, which is longer than the pauses of a working disk. As many more may be on their way to it.
QUEUE_MESSAGES = 50_000
QUEUE_BYTES = 32 * 2**20
POLL_PERIOD = 0.02  # s; short, so that a batch does not hold Python's lock for long
FLUSH_PERIOD = 0.5  # s; a killed process loses the messages of this time, and of a write
RETRY_PERIOD = 2.0  # s between attempts to begin a file after a failure
DRAIN_TIME = 5.0  # s that `stop` waits for a slow disk

# Names of metadata records.
PROVENANCE_METADATA = "linkage_vibration"
RECORDING_METADATA = "linkage_vibration.recording"
FAULTS_METADATA = "linkage_vibration.input_faults"

# Free bytes, beyond those of an empty log, that a retry needs, so that a full disk stays usable.
_ROOM_TO_RESUME = 2**20
_MARGIN = 512  # bytes that a message may add to a log beyond its size
_SHARES = 4  # files within disk_limit; one is deleted at a time
# A running number and the time; earlier versions had no number, but counted within a second.
_NAME = re.compile(r"linkage_vibration_((\d{6,})_\d{8}-\d{6}|\d{8}-\d{6}(_\d+)?)\.mcap", re.ASCII)


@dataclass(frozen=True, slots=True)
class LogLimits:
    """Limits of the size of logs; 0 is no limit."""

    split_size: int = 0  # bytes of a file
    split_duration: float = 0.0  # s of a file
    disk_limit: int = 0  # bytes of all logs in the folder, at which recording ends,
    delete_oldest: bool = False  # or the oldest are deleted; a file then has at most a quarter


@dataclass(frozen=True, slots=True)
class Provenance:
    """The origin of the messages of a log, which is stored in each file."""

    attachments: tuple[Attachment, ...] = ()  # the mechanism, the table and the like
    metadata: Mapping[str, str] = field(default_factory=dict)


UNLIMITED = LogLimits()

# A message: topic, data, log time, publish time.
_Entry: TypeAlias = tuple[Topic, bytes, int, int] | Provenance
# A log in the folder: running number (0: none), time of the last change, path, size in bytes.
_Found: TypeAlias = tuple[int, int, Path, int]


class _LimitError(LogError):
    """A limit allows no further file."""


class FullFolderError(_LimitError):
    """The logs of the folder have reached their limit."""


class Recorder:
    """Logs messages to files in a folder, from `start` to `stop`, on a thread of its own."""

    def __init__(
        self,
        folder: Path,
        topics: Iterable[Topic],
        provenance: Provenance,
        limits: LogLimits = UNLIMITED,
        compression: str = "zstd",
    ) -> None:
        self.path: Path | None = None
        self.active = self.recording = False
        self.written = self.deleted = 0
        self.error: LogError | None = None  # the failure that lasts
        self.news: deque[LogError | str] = deque()  # failures and deleted logs, to take out
        self._folder = folder
        self._topics = {topic.name: topic for topic in topics}
        self._provenance = provenance
        self._limits = limits
        self._compression = compression
        self._thread: threading.Thread | None = None
        self._wake = threading.Event()
        # Both threads use these, with the lock.
        self._lock = threading.Lock()
        self._queue: deque[_Entry] = deque()
        self._queued = self._queued_bytes = self._overflowed = 0
        # Only the recorder's thread uses these while it runs.
        self._batch: deque[_Entry] = deque()
        self._log: LogWriter | None = None
        self._lost = self._reported = self._reports = self._written_before = 0
        self._number = 0  # of the last file
        self._room = math.inf
        self._begun = self._flushed = self._split_at = self._deadline = 0.0
        self._failed = False
        self._next_try = 0.0

    @property
    def dropped(self) -> int:
        """Number of messages since `start` that are in no file."""
        return self._overflowed + self._lost

    def add_topic(self, topic: Topic) -> None:
        """Accept messages of another topic from now on."""
        self._topics = {**self._topics, topic.name: topic}

    def start(self, *, wait: bool = False) -> None:
        """Begin a log, or ``wait`` while its disk is full; raise a `LogError` if it cannot be."""
        if self._thread is not None and self._thread.is_alive():
            raise LogError(f"{self.path} is being recorded already; stop that first.")
        self._wake.clear()
        self.path = self.error = None
        self.written = self._written_before = self.deleted = 0
        self._queued = self._queued_bytes = self._overflowed = self._lost = 0
        self._deadline = math.inf
        self._failed = False
        try:
            self._begin_file()
        except LogError as error:
            if waits := wait and isinstance(error, DiskError):
                self.news.append(error)
            self.error = error  # another caller knows it, so it is no news
            self._end_file(error)
            if not waits:
                raise
        self.active, self.recording = True, not self._failed
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def write(self, messages: Sequence[tuple[str, bytes, int, int]]) -> None:
        """Queue messages (topic, CDR, log and publish time in ns), or count all as dropped."""
        size = sum(len(data) for _, data, _, _ in messages)
        with self._lock:
            if not self.active:
                return
            if self._queued >= QUEUE_MESSAGES or self._queued_bytes + size > QUEUE_BYTES:
                self._overflowed += len(messages)
                return
            for topic, data, log_time, publish_time in messages:
                self._queue.append((self._topics[topic], data, log_time, publish_time))
            self._queued += len(messages)
            self._queued_bytes += size

    def change_provenance(self, provenance: Provenance) -> None:
        """Write all messages from now on to a file with this provenance."""
        with self._lock:
            if self.active:
                self._queue.append(provenance)
            else:
                self._provenance = provenance

    def stop(self) -> None:
        """Write the queue within `DRAIN_TIME` and complete the log; this never raises."""
        with self._lock:
            self.active = False
        if self._thread is None or not self._thread.is_alive():
            return
        self._deadline = time.monotonic() + DRAIN_TIME
        self._wake.set()
        self._thread.join(DRAIN_TIME + 1.0)
        if self._thread.is_alive():
            problem = f"{self.path} is still being written, as its disk does not respond"
            hint = f"complete it with `{command(f'recover {self.path}')}` when the disk responds"
            self.keep(LogError(f"{problem}; {hint}."))

    def _run(self) -> None:
        """Write messages until recording ends."""
        try:
            while self.active:
                self._wake.wait(POLL_PERIOD)
                self._work()
            self._work()
        except Exception as defect:
            problem = f"Recording {self.path} failed: {defect!r}"
            self.keep(LogError(f"{problem}; please report this defect."))
            raise
        finally:
            with self._lock:
                self.active = self.recording = False
                left = [*self._batch, *self._queue]
                self._batch.clear()
                self._queue.clear()
            for item in left:
                if isinstance(item, Provenance):
                    self._provenance = item
                else:
                    self._lost += 1
            self._end_file()

    def _work(self) -> None:
        """Write the queued messages, as far as the disk accepts them."""
        while self._log is not None or self._resume():
            now = time.monotonic()
            try:
                if now >= self._flushed + FLUSH_PERIOD:
                    self._flush()
                elif now > self._deadline or not (self._batch or self._take()):
                    break
                else:
                    self._handle(self._batch[0])
            except LogError as error:
                self._end_file(error)

    def _take(self) -> bool:
        """Make the queue the next batch; return whether it has an entry."""
        with self._lock:
            self._batch, self._queue = self._queue, self._batch
            self._queued = self._queued_bytes = 0
        return bool(self._batch)

    def _handle(self, entry: _Entry) -> None:
        """Handle the first entry of the batch; if it needs the next file, only end this one."""
        log = self._log
        assert log is not None
        if isinstance(entry, Provenance):
            self._batch.popleft()
            self._provenance = entry
            self._end_file()
            return
        topic, data, log_time, publish_time = entry
        log.add_topic(topic)
        too_large = log.size + len(data) + _MARGIN > self._room
        if log.messages and (too_large or time.monotonic() > self._split_at):
            self._end_file()
            return
        self._batch.popleft()
        if too_large:
            self._lost += 1
            if self.error is None:
                problem = f"A message of {len(data)} bytes on {topic.name} is too large for a log"
                self.keep(LogError(f"{problem}; raise split_size or disk_limit."))
            return
        log.write(topic.name, data, log_time, publish_time)

    def _flush(self) -> None:
        """Hand all messages to the operating system, and wait until the disk has them."""
        log = self._log
        assert log is not None
        if self._reported != self.dropped:
            self._report_dropped(log)
        log.flush()
        self.written = self._written_before + log.written
        log.sync()
        self._flushed = time.monotonic()
        if not self.recording:  # after a failure, which has ended now
            self.recording, self.error = True, None

    def _report_dropped(self, log: "LogWriter") -> None:
        """Store in the file how many messages were dropped so far."""
        self._reported, self._reports = self.dropped, self._reports + 1
        # Viewers warn of two records of one name.
        number = f".{self._reports}" if self._reports > 1 else ""
        log.add_metadata(RECORDING_METADATA + number, {"dropped": str(self._reported)})

    def _begin_file(self) -> None:
        """Begin the next file; raise `LogError` if that fails."""
        self._begun = self._flushed = time.monotonic()
        self._split_at = self._begun + (self._limits.split_duration or math.inf)
        logs = _logs(self._folder)
        self._number = max([self._number, *(number for number, *_ in logs)])
        self._room = self._make_room(logs)
        self._log = log = self._unused_file()
        log.add_metadata(PROVENANCE_METADATA, self._provenance.metadata)
        self._reports = 0
        self._report_dropped(log)
        log.flush()
        self.path = log.path

    def _unused_file(self) -> "LogWriter":
        """Create a file whose number exceeds all others, whatever time the clock has."""
        topics, files = list(self._topics.values()), self._provenance.attachments
        while True:
            self._number += 1
            name = f"linkage_vibration_{self._number:06}_{time.strftime('%Y%m%d-%H%M%S')}.mcap"
            with contextlib.suppress(LogExistsError):  # another recorder was faster
                return log_writer()(self._folder / name, topics, files, self._compression)

    def _end_file(self, error: LogError | None = None) -> None:
        """Complete the current file, if there is one; after an error, only close it."""
        log, self._log = self._log, None
        if log is not None:
            if error is None:
                try:
                    self._report_dropped(log)
                    log.close()
                except LogError as failure:
                    error = failure
            self._written_before += log.written
            self.written = self._written_before
            if error is not None:
                log.abandon()
                self._lost += log.held
                if not log.written:
                    with contextlib.suppress(OSError):
                        log.path.unlink()
        if error is not None:
            self.keep(error)
            self.recording, self._failed = False, True
            self._next_try = self._begun + RETRY_PERIOD

    def _resume(self) -> bool:
        """Begin the next file if that is possible; return whether it was."""
        if self._failed:
            if time.monotonic() < self._next_try:
                return False
            self._next_try = time.monotonic() + RETRY_PERIOD
            free = 0
            with contextlib.suppress(OSError):
                free = shutil.disk_usage(self._folder).free
            if free <= self._empty_size() + _ROOM_TO_RESUME:
                return False
        try:
            self._begin_file()
        except LogError as error:
            if isinstance(error, _LimitError):  # it ends the recording, so it replaces others
                self.active, self.error = False, None
            self._end_file(error)
            return False
        self._failed = False
        return True

    def _make_room(self, logs: Sequence[_Found]) -> float:
        """Return the greatest size of the next file, for which old ones may be deleted."""
        limits = self._limits
        least = 2 * self._empty_size()
        shares = _SHARES if limits.delete_oldest else 1
        for name, needed in (("split_size", least), ("disk_limit", shares * least)):
            if 0 < (limit := getattr(limits, name)) < needed:
                # The parameters in the log have more digits with a larger limit.
                empty = f"a log without messages already has {least // 2}"
                hint = f"set it to {needed + _MARGIN} or more"
                raise _LimitError(f"{name} is {limit} bytes, but {empty}; {hint}.")
        largest = limits.split_size or math.inf
        if not limits.disk_limit:
            return largest
        taken = sum(size for *_, size in logs)
        if limits.delete_oldest:
            largest = min(largest, limits.disk_limit // _SHARES)
            for *_, path, size in logs:
                if taken + largest <= limits.disk_limit:
                    break
                taken -= self._delete(path) * size
        largest = min(largest, limits.disk_limit - taken)
        if largest < least:
            fix = "" if limits.delete_oldest else "delete logs, set delete_oldest, or "
            full = f"the logs in {self._folder} have reached disk_limit, {limits.disk_limit} bytes"
            hint = f"{fix}raise it to {taken + least} or more, and start again"
            raise FullFolderError(f"Nothing more is recorded, as {full}; {hint}.")
        return largest

    def _delete(self, path: Path) -> bool:
        """Delete and report a log, and return true, unless another recorder has it open."""
        try:
            with path.open("rb") as log:
                fcntl.flock(log, fcntl.LOCK_SH | fcntl.LOCK_NB)
                path.unlink()
        except FileNotFoundError:
            return True
        except BlockingIOError:
            return False
        except OSError as error:
            problem = f"The oldest log, {path}, cannot be deleted: {error.strerror}"
            raise LogError(f"{problem}; delete it.") from None
        self.deleted += 1
        self.news.append(f"{path}, the oldest log, was deleted, as disk_limit has been reached.")
        return True

    def _empty_size(self) -> int:
        """Return the approximate size of a log without messages, bytes."""
        attachments = sum(len(attachment.data) for attachment in self._provenance.attachments)
        definitions = sum(len(topic.definition) for topic in self._topics.values())
        return attachments + 4 * definitions + 8192

    def keep(self, error: LogError) -> None:
        """Keep and report an error, unless nothing is recorded since an earlier one."""
        if self.recording or self.error is None:
            self.error = error
            self.news.append(error)


def package_versions() -> dict[str, str]:
    """Return the versions of Python and of the main libraries, for `Provenance.metadata`."""
    versions = {"python": platform.python_version()}
    for name in ("linkage_vibration", "mcap", "numpy", "scipy"):
        with contextlib.suppress(PackageNotFoundError):  # a node predicts without mcap
            versions[name] = version(name)
    return versions


def log_writer() -> "type[LogWriter]":
    """Return what writes logs, or raise a `LogError` that names the library that is missing."""
    try:
        from linkage_vibration.bags.log_writer import LogWriter
    except ImportError as error:
        problem = missing_library(error)
        raise LogError(f"No log can be recorded and no bag be read: {problem}") from None
    return LogWriter


def _logs(folder: Path) -> list[_Found]:
    """Return the logs in a folder, the oldest first: those without a number, then by number."""
    logs = []
    with contextlib.suppress(OSError):
        for entry in os.scandir(folder):
            match = _NAME.fullmatch(entry.name)
            if match and entry.is_file(follow_symlinks=False):
                with contextlib.suppress(FileNotFoundError):
                    status = entry.stat(follow_symlinks=False)
                    order = int(match[2] or 0), status.st_mtime_ns
                    logs.append((*order, folder / entry.name, status.st_size))
    return sorted(logs)
