# Copyright 2026 The linkage_vibration authors
# SPDX-License-Identifier: Apache-2.0
"""What a log contains besides its messages, so that rosbag2, Foxglove and rosbags open it."""

from dataclasses import dataclass
from functools import cache

import yaml

from linkage_vibration.errors import LinkageVibrationError

# Queue of the node's topics, also in the QoS of a log: a second of joint states at 1 kHz, so that a
# short stall of the machine loses none. A queue of 100 lost 0.6 % in an hour on a machine whose
# load was three times its number of cores.
QUEUE_DEPTH = 1000
# The newest version of rosbag2 metadata with integer policies, see offered_qos_profiles.
ROSBAG2_METADATA_VERSION = 7
ROSBAG2_METADATA = "rosbag2"  # the name of its record
COMPRESSIONS = ("none", "lz4", "zstd")  # as mcap.writer.CompressionType names them


class LogError(LinkageVibrationError):
    """A log cannot be created or written."""


class DiskError(LogError):
    """The disk of a log is full or fails, which may end."""


class LogExistsError(LogError):
    """A file has the name of a new log already."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a log."""

    name: str
    type: str  # full name, such as ``std_msgs/msg/Float64``
    definition: str  # see `message_definition`
    type_hash: str  # see the function of this name
    offered_qos_profiles: str  # see the function of this name

    def metadata(self) -> dict[str, str]:
        """Return what rosbag2 stores with the channel."""
        qos = self.offered_qos_profiles
        return {"offered_qos_profiles": qos, "topic_type_hash": self.type_hash}


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file that is stored in a log."""

    name: str
    media_type: str  # such as ``application/yaml``
    data: bytes


@cache
def offered_qos_profiles(*, latched: bool = False) -> str:
    """Return the QoS of one reliable publisher, with the queue of the node, as rosbag2 stores it.

    The policies in this YAML list are the integers of ``rmw/types.h``, as rosbag2 wrote them up to
    Iron. Humble and Iron read only these; Jazzy and later read both these and names.
    """
    infinite = dict(zip(("sec", "nsec"), divmod(2**63 - 1, 10**9), strict=True))
    profile = {
        "history": 1,
        "depth": QUEUE_DEPTH,
        "reliability": 1,
        "durability": 1 if latched else 2,
        "deadline": infinite.copy(),  # a copy, as YAML would refer to an object that it has already
        "lifespan": infinite.copy(),
        "liveliness": 1,
        "liveliness_lease_duration": infinite,
        "avoid_ros_namespace_conventions": False,
    }
    return yaml.safe_dump([profile], sort_keys=False)


def rosbag2_metadata() -> dict[str, str]:
    """Return the content of the record `ROSBAG2_METADATA`; rosbag2 replaces all but the version."""
    metadata = {
        "version": ROSBAG2_METADATA_VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": 0},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": 0,
        "topics_with_message_count": [],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [],
        "files": [],
        "custom_data": {},
    }
    return {"serialized_metadata": yaml.safe_dump(metadata, sort_keys=False)}
