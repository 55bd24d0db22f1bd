"""Metadata of a recording: rosbag2 metadata.yaml, QoS profiles, parameters as YAML."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

METADATA_RECORD = "cylconn_ros"
"""Name of the MCAP metadata record with parameters, version and method of a run."""
ROSBAG2_VERSION = 9  # the metadata version that ROS 2 Jazzy writes
_INFINITE = {"sec": 9223372036, "nsec": 854775807}  # RMW_DURATION_INFINITE


@dataclass(frozen=True)
class TopicInfo:
    """A topic to record: resolved name, type (``package/msg/Name``) and offered QoS."""

    name: str
    type: str
    reliability: str = "reliable"  # or best_effort
    durability: str = "volatile"  # or transient_local
    history: str = "keep_last"
    depth: int = 50

    def qos(self) -> list[dict[str, Any]]:
        """Return ``offered_qos_profiles`` with one profile, in rosbag2's format."""
        return [
            {
                "history": self.history,
                "depth": self.depth,
                "reliability": self.reliability,
                "durability": self.durability,
                "deadline": dict(_INFINITE),
                "lifespan": dict(_INFINITE),
                "liveliness": "automatic",
                "liveliness_lease_duration": dict(_INFINITE),
                "avoid_ros_namespace_conventions": False,
            }
        ]


def to_yaml(data: object) -> str:
    """Serialize ``data`` as block-style YAML; keys keep their order."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, width=100, allow_unicode=True)


def bag_information(
    file_name: str,
    topics: Sequence[TopicInfo],
    type_hashes: Mapping[str, str],
    counts: Mapping[str, int],
    start_ns: int,
    end_ns: int,
    custom: Mapping[str, str],
) -> dict[str, Any]:
    """Build ``rosbag2_bagfile_information``; times are log times in ns since the epoch."""
    times = {
        "duration": {"nanoseconds": end_ns - start_ns},
        "starting_time": {"nanoseconds_since_epoch": start_ns},
        "message_count": sum(counts.values()),
    }
    return {
        "version": ROSBAG2_VERSION,
        "storage_identifier": "mcap",
        **times,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": topic.qos(),
                    "type_description_hash": type_hashes[topic.type],
                },
                "message_count": counts[topic.name],
            }
            for topic in topics
        ],
        # MCAP compresses chunks inside the file; rosbag2 declares only its own compression.
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, **times}],
        "custom_data": dict(custom),
        "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
    }


def parameters_yaml(parameters: Mapping[str, object], node: str = "/**") -> str:
    """Serialize dotted parameters as a ROS 2 parameter file that loads as a scene.

    Unset values (None, empty lists) are omitted, since an empty list has no type in ROS 2.
    """
    tree: dict[str, Any] = {}
    for name, value in parameters.items():
        if isinstance(value, (tuple, list)):
            value = list(value)
        if value is None or value == []:
            continue
        *branches, leaf = name.split(".")
        place = tree
        for branch in branches:
            place = place.setdefault(branch, {})
        place[leaf] = value
    return to_yaml({node: {"ros__parameters": tree}})


class _Dumper(yaml.SafeDumper):
    """YAML with number lists in one line, multi-line strings as literal blocks, no anchors."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _represent_list(dumper: yaml.SafeDumper, data: list[Any]) -> yaml.Node:
    flat = all(isinstance(item, (int, float)) for item in data)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flat)


def _represent_text(dumper: yaml.SafeDumper, data: str) -> yaml.Node:
    style = "|" if "\n" in data else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", data, style=style)


_Dumper.add_representer(list, _represent_list)
_Dumper.add_representer(str, _represent_text)
