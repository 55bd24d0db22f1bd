"""What ``cylconn replay`` prints: counts, irregularities and the comparison with the recording."""

from __future__ import annotations

from pathlib import Path

from cylconn_ros.recording.bag import Bag
from cylconn_ros.recording.run import why_incomplete
from cylconn_ros.replay.compare import Comparison, Topic, agree, verdict
from cylconn_ros.replay.replay import Replay

_SHOWN = 6  # fields per topic


def lacking(bag: Bag) -> str:
    """A line that says what a recording lacks; empty if it is complete."""
    if bag.damage:
        return f"DAMAGED     {bag.damage}; the intact messages were used"
    reason = why_incomplete(bag.source)
    return f"INCOMPLETE  {reason}" if reason else ""


def report(replay: Replay, seconds: float, cpu: float) -> None:
    """Print counts and times. seconds, cpu: elapsed and CPU time, s."""
    counts, health = replay.counts, replay.pipeline.health
    print(
        f"messages    {counts.read} read, {counts.used} used, {counts.outputs} recorded outputs, "
        f"{counts.other} of other topics"
    )
    for name, topic in replay.inputs.items():
        print(f"  {name:<14} {counts.by_topic.get(topic, 0):>9}  {topic}")
    share, busy = (1e6 * t / counts.used if counts.used else 0.0 for t in (seconds, cpu))
    print(
        f"samples     {counts.responses} in {seconds:.2f} s, {share:.2f} us per input message "
        f"({busy:.2f} us of CPU time)"
    )
    for text in replay.irregularities():
        print(f"irregular   {text}")
    if health.undecodable:
        print(f"            {health.undecodable_text}")
    if text := lacking(replay.bag):
        print(text)
    before = replay.bag.metadata.get("samples_before", "0")
    if before != "0":
        print(f"LATE BEGIN  the recording began {before} samples after the run: what the connector "
              "knew from them, as the measured latency, is not known here")  # fmt: skip
    for topic, reason in replay.bag.source.left_out.items():
        print(f"left out    {topic}: {reason}")
    for text in replay.bag.source.notes:
        print(f"note        {text}")
    if problem := replay.problem():
        print(f"NOT USABLE  {problem}")


def conclude(comparison: Comparison | None, tolerance: float, output: Path | None) -> bool:
    """Print the comparison, if there is one, and the next command; False if outputs diverge."""
    well = comparison is None or show(comparison.result(), tolerance)
    if output is not None:
        print(f"kept        {output}\nnext: cylconn info {output}")
    else:
        other = ", or compare it with the recorded one with --compare" if comparison is None else ""
        print(f"next: keep the run with -o NAME{other}")
    return well


def show(topics: list[Topic], tolerance: float) -> bool:
    """Print the comparison; False if outputs diverge."""
    for topic in topics:
        result = "identical" if not topic.different else f"{topic.different} differ"
        missing = f", {topic.only_recorded} only recorded" if topic.only_recorded else ""
        more = f", {topic.only_replayed} only replayed" if topic.only_replayed else ""
        print(f"{topic.name}: {topic.same + topic.different} compared, {result}{missing}{more}")
        for d in topic.differences[:_SHOWN]:
            mark = "BEYOND" if d.beyond else "within"
            print(
                f"  {mark}  {d.field}: at most {d.worst:.3g} ({d.relative:.1e} of its size), first "
                f"at {d.first * 1e-9:.6f} s: recorded {d.recorded}, replayed {d.replayed}"
            )
        if len(topic.differences) > _SHOWN:
            print(f"  and {len(topic.differences) - _SHOWN} more fields")
        if topic.not_compared:
            print(f"  not compared: fields {topic.not_compared}")
    print(verdict(topics, tolerance))
    return agree(topics)
