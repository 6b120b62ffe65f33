# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""Records without holding up whoever has something to record."""

import contextlib
import math
import platform
import re
import shutil
import threading
import time
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TypeAlias

from linkage_vibration.bags.writing import Attachment, LogError, LogWriter, Topic

# A message that finds one of these reached is dropped. 50,000 messages are 10 s of five topics at
# 1 kHz: longer than a disk pauses that has not failed. As much again may be under way to the disk.
QUEUE_MESSAGES = 50_000
QUEUE_BYTES = 32 * 2**20
POLL_PERIOD = 0.02  # s; short, so that no batch keeps Python's lock from the node for long
LONGEST_POLL = 0.2  # s; a wake-up costs as much as some messages, where there are few
BATCH = 16  # messages that a poll is to find
FLUSH_PERIOD = 0.5  # s; what a killed process loses, and as much for a disk that is not idle
RETRY_PERIOD = 2.0  # s between two files, after a failure
DRAIN_TIME = 5.0  # s that a slow disk is given at the end

# Names of metadata records.
PROVENANCE_METADATA = "linkage_vibration"
RECORDING_METADATA = "linkage_vibration.recording"

# Bytes free beyond those of an empty log before a retry, so that a full disk gets no more crumbs.
_ROOM_TO_RESUME = 2**20
_MARGIN = 512  # bytes that a message may add to a log beside its own
_SHARES = 4  # of the disk's limit; one at a time is deleted
_SUFFIX = ".mcap"
_NAME = re.compile(r"linkage_vibration_\d{8}-\d{6}(_\d+)?\.mcap")


@dataclass(frozen=True, slots=True)
class Limits:
    """How large logs become.

    Attributes
    ----------
    split_size : int
        Bytes that a file may have before the next one begins; 0 for no limit.
    split_duration : float
        How long a file is written before the next one begins, s; 0 for no limit.
    disk_limit : int
        Bytes that all logs in the folder may have; 0 for no limit. Recording ends there.
    delete_oldest : bool
        Whether to delete the oldest logs of the folder instead. A file then has a quarter of
        ``disk_limit`` at most.
    """

    split_size: int = 0
    split_duration: float = 0.0
    disk_limit: int = 0
    delete_oldest: bool = False


@dataclass(frozen=True, slots=True)
class Provenance:
    """What made the messages of a log; each of its files tells it.

    Attributes
    ----------
    attachments : tuple of Attachment
        Files: mechanism, table, parameters.
    metadata : mapping of str to str
        Facts, such as `package_versions`; they go into the metadata record `PROVENANCE_METADATA`.
    """

    attachments: tuple[Attachment, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)


UNLIMITED = Limits()

# A message: topic, data, log time, publish time.
_Entry: TypeAlias = tuple[Topic, bytes, int, int] | Provenance


class _LimitReached(LogError):
    """There may be no further file."""


class Recorder:
    """Logs to files in a folder, from `start` to `stop`, on a thread of its own.

    Messages wait in a queue that is bounded; those that do not fit are counted. The thread hands
    what has come to the operating system twice a second, and waits for the disk to have it. When
    writing fails, the file is left as it is, and a new one is begun as soon as that succeeds,
    tried every few seconds. Every file is complete in itself; its metadata record
    `RECORDING_METADATA` tells how many messages had been dropped since `start` when the
    file began, whenever that number changed, and when the file ended.

    Parameters
    ----------
    folder : Path
        Where the logs go; it must exist.
    topics : iterable of Topic
        What may be written; `add_topic` adds others.
    provenance : Provenance
        What makes the messages; `change_provenance` replaces it.
    limits : Limits
        How large logs become.
    compression : str
        One of `recording.COMPRESSIONS`.

    Attributes
    ----------
    path : Path or None
        The file under way, else the last one.
    active : bool
        Whether messages are taken: from `start` to `stop`, or until ``disk_limit`` is reached.
    recording : bool
        Whether a file is under way; not so while active after a failure, until it is mended.
    written : int
        How many messages the operating system has been given since `start`.
    error : LogError or None
        The first failure since `start`.
    """

    def __init__(
        self,
        folder: Path,
        topics: Iterable[Topic],
        provenance: Provenance,
        limits: Limits = UNLIMITED,
        compression: str = "zstd",
    ) -> None:
        self.path: Path | None = None
        self.active = self.recording = False
        self.written = 0
        self.error: LogError | None = None
        self._folder = folder
        self._topics = {topic.name: topic for topic in topics}
        self._provenance = provenance
        self._limits = limits
        self._compression = compression
        self._thread: threading.Thread | None = None
        self._wake = threading.Event()
        # What both sides touch, under the lock.
        self._lock = threading.Lock()
        self._queue: deque[_Entry] = deque()
        self._queued = self._queued_bytes = self._overflowed = 0
        # What the thread alone touches while it lives.
        self._batch: deque[_Entry] = deque()
        self._log: LogWriter | None = None
        self._lost = self._told = self._written_before = 0
        self._room = math.inf
        self._begun = self._flushed = self._split_at = self._deadline = 0.0
        self._mended = True
        self._next_try = 0.0
        self._pause, self._taken = POLL_PERIOD, 0

    @property
    def dropped(self) -> int:
        """How many messages since `start` are in no file."""
        return self._overflowed + self._lost

    def add_topic(self, topic: Topic) -> None:
        """Let messages of another topic be written, from now on."""
        self._topics = {**self._topics, topic.name: topic}

    def start(self) -> None:
        """Begin a log.

        Raises
        ------
        LogError
            If one is under way, or if it cannot be begun.
        """
        if self._thread is not None and self._thread.is_alive():
            raise LogError(f"{self.path} is being recorded already; stop it first.")
        self._wake.clear()
        self.error = None
        self.written = self._written_before = 0
        self._queued = self._queued_bytes = self._overflowed = self._lost = 0
        self._deadline = math.inf
        self._mended = True
        self._pause, self._taken = POLL_PERIOD, 0
        self._begin_file()
        self.active = True
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Have a message written, or dropped if too many wait; ignore it while not active.

        Parameters
        ----------
        topic : str
            Name of one of the topics.
        data : bytes
            The message in CDR, with its encapsulation header.
        log_time, publish_time : int
            When it was received and when it was sent, ns; they may jump.
        """
        size = len(data)
        with self._lock:
            if not self.active:
                return
            if self._queued >= QUEUE_MESSAGES or self._queued_bytes + size > QUEUE_BYTES:
                self._overflowed += 1
                return
            self._queue.append((self._topics[topic], data, log_time, publish_time))
            self._queued += 1
            self._queued_bytes += size

    def change_provenance(self, provenance: Provenance) -> None:
        """Let what is written from now on go to a file that tells this provenance."""
        with self._lock:
            if self.active:
                self._queue.append(provenance)
            else:
                self._provenance = provenance

    def stop(self) -> None:
        """Write what waits, within `DRAIN_TIME`, and complete the log; never raises."""
        with self._lock:
            self.active = False
        if self._thread is None or not self._thread.is_alive():
            return
        self._deadline = time.monotonic() + DRAIN_TIME
        self._wake.set()
        self._thread.join(DRAIN_TIME + 1.0)
        if self._thread.is_alive():
            self._keep(
                LogError(
                    f"{self.path} is still being written, as its disk does not answer; complete "
                    f"it with `linkage-vibration recover {self.path}` when it does."
                )
            )

    def _run(self) -> None:
        """Write until there is nothing more to write."""
        try:
            while self.active:
                self._wake.wait(self._pause)
                self._work()
                wanted = self._pause * BATCH / max(self._taken, 1)
                self._pause = max(POLL_PERIOD, min(wanted, LONGEST_POLL))
                self._taken = 0
            self._work()
        except Exception as defect:
            self._keep(LogError(f"{self.path} was given up: {defect!r}; please report this."))
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
        """Write what has come, as far as the disk takes it."""
        while self._log is not None or self._resume():
            now = time.monotonic()
            if now >= self._flushed + FLUSH_PERIOD:
                self._flush()
            elif now > self._deadline or not (self._batch or self._take()):
                break
            else:
                self._do(self._batch[0])

    def _take(self) -> bool:
        """Make what has come the next batch; return whether there is any."""
        with self._lock:
            self._batch, self._queue = self._queue, self._batch
            self._queued = self._queued_bytes = 0
        self._taken += len(self._batch)
        return bool(self._batch)

    def _do(self, entry: _Entry) -> None:
        """Do what the first entry of the batch asks for, unless that needs the next file."""
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
            self._keep(
                LogError(
                    f"A message of {len(data)} bytes on {topic.name} is larger than a log may be; "
                    "raise split_size or disk_limit."
                )
            )
            return
        log.write(topic.name, data, log_time, publish_time)
        if log.error is not None:
            self._end_file()

    def _flush(self) -> None:
        """Hand what was written to the operating system, and wait until the disk has it."""
        log = self._log
        assert log is not None
        if self._told != self.dropped:
            self._tell(log)
        log.flush()
        self.written = self._written_before + log.written
        log.sync()
        self._flushed = time.monotonic()
        if log.error is not None:
            self._end_file()

    def _tell(self, log: LogWriter) -> None:
        """Let the file tell how many messages were dropped so far."""
        self._told = self.dropped
        log.add_metadata(RECORDING_METADATA, {"dropped": str(self._told)})

    def _begin_file(self) -> None:
        """Begin the next file; raise LogError if that does not succeed."""
        self._room = self._make_room()
        self._log = log = LogWriter(
            _unused_path(self._folder),
            list(self._topics.values()),
            self._provenance.attachments,
            self._compression,
        )
        log.add_metadata(PROVENANCE_METADATA, self._provenance.metadata)
        self._tell(log)
        log.flush()
        self.path = log.path
        self.recording = True
        self._begun = self._flushed = time.monotonic()
        self._split_at = self._begun + (self._limits.split_duration or math.inf)

    def _end_file(self) -> None:
        """Complete the file under way, if any; after a failure, leave it as it is."""
        log, self._log = self._log, None
        if log is None:
            return
        self._tell(log)
        log.close()
        self._written_before += log.written
        self.written = self._written_before
        self._lost += log.dropped
        if log.error is not None:
            self._keep(log.error)
            self.recording = False
            self._mended = False
            self._next_try = self._begun + RETRY_PERIOD
            if not log.written:
                with contextlib.suppress(OSError):
                    log.path.unlink()

    def _resume(self) -> bool:
        """Begin the next file if that can be; return whether it was."""
        if not self._mended:
            if time.monotonic() < self._next_try:
                return False
            self._next_try = time.monotonic() + RETRY_PERIOD
            if not self._disk_has_room():
                return False
        try:
            self._begin_file()
        except _LimitReached as reached:
            self._keep(reached)
            self.recording = self.active = False
            return False
        except LogError as error:
            self._keep(error)
            self.recording = self._mended = False
            self._next_try = time.monotonic() + RETRY_PERIOD
            return False
        self._mended = True
        return True

    def _disk_has_room(self) -> bool:
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:
            return False
        return free > self._empty_size() + _ROOM_TO_RESUME

    def _make_room(self) -> float:
        """Return how many bytes the next file may have; delete old ones for it if that was asked.

        Raises
        ------
        LogError
            If there is no room for a file, or none can be made.
        """
        limits = self._limits
        least = 2 * self._empty_size()
        largest = limits.split_size or math.inf
        if largest < least:
            raise _LimitReached(
                f"split_size is {limits.split_size} bytes, and a log that tells what made it has "
                f"{least // 2} before its first message; give {least} or more."
            )
        if not limits.disk_limit:
            return largest
        logs = _logs(self._folder)
        taken = sum(size for _, size in logs)
        if limits.delete_oldest:
            largest = min(largest, limits.disk_limit // _SHARES)
            for path, size in logs:
                if taken + largest <= limits.disk_limit:
                    break
                _delete(path)
                taken -= size
        largest = min(largest, limits.disk_limit - taken)
        if largest < least:
            mend = "" if limits.delete_oldest else "delete some, set delete_oldest, or "
            raise _LimitReached(
                f"Recording has ended, as the logs in {self._folder} have reached disk_limit, "
                f"{limits.disk_limit} bytes; {mend}raise it, and start again."
            )
        return largest

    def _empty_size(self) -> int:
        """Return how many bytes a log without messages has, about."""
        attachments = sum(len(attachment.data) for attachment in self._provenance.attachments)
        definitions = sum(len(topic.definition) for topic in self._topics.values())
        return attachments + 4 * definitions + 8192

    def _keep(self, error: LogError) -> None:
        """Keep the first error."""
        if self.error is None:
            self.error = error


def package_versions() -> dict[str, str]:
    """Return the versions of what computes and writes, for `Provenance.metadata`."""
    distributions = ("linkage_vibration", "mcap", "numpy", "scipy")
    return {"python": platform.python_version()} | {name: version(name) for name in distributions}


def _unused_path(folder: Path) -> Path:
    """Return where a log that begins now goes."""
    stem = time.strftime("linkage_vibration_%Y%m%d-%H%M%S")
    path = folder / f"{stem}{_SUFFIX}"
    number = 1
    while path.exists():
        number += 1
        path = folder / f"{stem}_{number}{_SUFFIX}"
    return path


def _logs(folder: Path) -> list[tuple[Path, int]]:
    """Return the logs in a folder with their sizes in bytes, the one written to longest ago first.

    In a folder that cannot be read there are none; writing to it tells why.
    """
    found = []
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if _NAME.fullmatch(path.name):
                with contextlib.suppress(FileNotFoundError):
                    status = path.stat()
                    found.append((status.st_mtime_ns, len(path.name), path, status.st_size))
    return [(path, size) for _, _, path, size in sorted(found)]


def _delete(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise LogError(
            f"{path}, the oldest log, could not be deleted: {error.strerror}; delete it."
        ) from None
