"""Tables of the coverage study in Markdown."""

from __future__ import annotations

from cylconn_ros.bench.common.results import Findings, Measurement
from cylconn_ros.bench.identification.coverage import MUJOCO, OTHER, OURS

Cases = dict[str, dict[str, dict[str, Measurement]]]
NOT_PARAMETERS = ("withheld", "time")


def text(findings: Findings) -> str:
    """Return coverage by case, and the comparison with least squares."""
    cases: Cases = {}
    for one in findings.measurements:
        cases.setdefault(one.case, {}).setdefault(one.subject, {})[one.quantity] = one
    return "\n".join([*_coverage(cases), "", *_comparison(cases)])


def _coverage(cases: Cases) -> list[str]:
    lines = [
        "| friction, noise | inside the 95 % interval (of draws with an estimate) | withheld |",
        "|---|---|---|",
    ]
    for case, subjects in cases.items():
        found = subjects[OURS]
        cells = [
            f"{name} {100.0 * one.value:.0f} % ({one.count})"
            for name, one in found.items()
            if name not in NOT_PARAMETERS
        ]
        withheld = found["withheld"]
        share = f"{round(withheld.value * withheld.count)} of {withheld.count}"
        lines.append(f"| {case} | {', '.join(cells) or 'no estimate'} | {share} |")
    return lines


def _comparison(cases: Cases) -> list[str]:
    names = (OURS, OTHER, MUJOCO)
    lines = [
        f"| friction, noise | {' | '.join(f'mu of {name}' for name in names)} | CPU time |",
        "|---|---|---|---|---|",
    ]
    for case, subjects in cases.items():
        if OTHER not in subjects:
            continue
        cells = []
        for subject in names:
            one = subjects.get(subject, {}).get("coefficient")
            missing = "withheld" if subject == OURS else "–"
            cells.append(
                missing
                if one is None
                else f"{one.note}; inside {100.0 * one.value:.0f} % of {one.count}"
            )
        times = [f"{subjects[name]['time'].value:.2g} s" for name in names if name in subjects]
        lines.append(f"| {case} | {' | '.join(cells)} | {', '.join(times)} |")
    return lines
