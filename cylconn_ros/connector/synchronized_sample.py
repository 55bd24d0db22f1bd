"""Results of the synchronizer: complete samples, and counters of the other messages."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple


class SynchronizedSample(NamedTuple):
    """A complete sample; its numbers are in ``SampleMatcher.sample``."""

    stamp: int  # ns
    h: float  # s since the sample before; 0 for the first of a history
    repeated: bool  # the last sample arrived once more: nothing is to be computed
    restarted: bool  # stamps went back: a new history begins


@dataclasses.dataclass
class Counts:
    """Counters of samples and of messages that did not become part of one."""

    samples: int = 0  # complete samples, each stamp once
    duplicate_samples: int = 0  # complete samples with the last stamp
    duplicate_messages: int = 0  # messages already received for the last or an incomplete sample
    late: int = 0  # messages older than the last complete sample
    incomplete: int = 0  # samples dropped: a newer one was complete, or too many were incomplete
    restarts: int = 0  # times the stamps went back to a new history
    unknown_frames: int = 0  # messages whose frame_id is no frame of the scene
    late_loads: int = 0  # loads that arrived after the sample with their stamp was processed
    unused_loads: int = 0  # loads older than the load in force, or too many that wait
    early_loads: int = 0  # loads whose stamps are far ahead of the samples
    load_body: int = 0  # 0: A, 1: B, of the last of these loads
    load_lead: int = 0  # ns, of the last early load


class UnknownFrame(NamedTuple):
    """A frame_id that is no frame of the scene, and the axes that are assumed instead."""

    body: int
    quantity: str  # pose, twist or load
    frame: str
    axes: str  # world or body
