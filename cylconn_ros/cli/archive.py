"""Work through many recordings: one task a recording, one row of results a recording.

ACTION is what is done with each: replay (and compare with the recorded outputs), identify, laws or
info. BAGS are recordings, folders with recordings at any depth, patterns such as 'runs/*/bag',
manifests (@list.txt, a recording a line), or fsspec addresses of these. A recording that cannot be
read is a row with its error, and the others are done. The same command with the same folder
resumes.

--against compares with an earlier result: the exit code is then 1 if an output of a recording
changed or a recording is missing, and the changes are listed. Without it, it is 1 if a recording
did not pass.

For example: cylconn archive replay recordings/ -o tonight --against last_night

Next: open tonight/page.html, or query tonight/rows with pandas or DuckDB.
"""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

import cylconn_ros
from cylconn_ros.cli import scenes, study_options
from cylconn_ros.cli.identify import known_parameter
from cylconn_ros.cli.progress import Progress
from cylconn_ros.errors import CommandError

if TYPE_CHECKING:
    from cylconn_ros.study.dataset import Dataset

ACTIONS = ("replay", "identify", "laws", "info")
_LISTED = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("action", choices=ACTIONS, metavar="ACTION", help=", ".join(ACTIONS))
    parser.add_argument("bags", nargs="+", metavar="BAGS", help="recordings, as above")
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", required=True, help="dataset of the results"
    )
    parser.add_argument(
        "--against", metavar="FOLDER", help="earlier result to compare with; list what changed"
    )
    parser.add_argument(
        "--tolerance", type=float, default=0.0, metavar="T",
        help="relative difference of outputs that is accepted (0: none)",
    )  # fmt: skip
    scenes.add_set(parser)
    parser.add_argument(
        "--known", type=known_parameter, action="append", default=[], metavar="NAME[=VALUE]",
        help="of identify: do not estimate preload, overlap or radius",
    )  # fmt: skip
    parser.add_argument("--no-page", action="store_true", help="write no page.html")
    study_options.add_engine(parser)


def run(options: argparse.Namespace) -> int:
    """Work through the recordings; 1 if one did not pass, or with --against if one changed."""
    from cylconn_ros.study.archive.bags import find_bags
    from cylconn_ros.study.dataset import Dataset
    from cylconn_ros.study.executors import engine
    from cylconn_ros.study.run import run as work

    task, given = _task(options)
    before = Dataset.existing(options.against) if options.against else None
    rows = find_bags(options.bags)
    dataset = Dataset(options.output)
    dataset.begin(
        {
            "kind": f"archive {options.action}",
            "version": cylconn_ros.__version__,
            "options": json.dumps(given),
            "rows": len(rows),
            "columns": list(rows.columns),
            "values": rows.digest(),
            "outputs": list(task.outputs),
            "chunk": options.chunk or 1,
        }
    )
    with engine(options.scheduler, options.workers) as used:
        print(f"{options.action:<11} {len(rows)} recordings; {used.name}")
        with Progress(f"archive {options.action}", unit="recordings") as bar:
            outcome = work(task, rows, dataset, used, bar)
    print("\n".join(study_options.describe(outcome, "recording")))
    passed = _report(dataset)
    changed, new = _compare(before, dataset, options)
    if not options.no_page:
        from cylconn_ros.study.archive.page import archive_page

        page = archive_page(dataset, changed, new)
        print(f"page        {dataset.write_page('page.html', page)}")
    print(f"kept        {dataset.address}/rows")
    return int(bool(changed) if changed is not None else not passed)


def _task(options: argparse.Namespace) -> tuple[Any, dict[str, Any]]:
    """Return the task, and the options that its results follow from."""
    from cylconn_ros.study.archive import tasks

    if options.set and options.action != "replay":
        raise CommandError("--set belongs to replay")
    if options.known and options.action != "identify":
        raise CommandError("--known belongs to identify")
    if options.action == "replay":
        changes = scenes.changed_parameters(options.set)
        given = {"set": changes, "tolerance": options.tolerance}
        return tasks.ReplayTask(changes, options.tolerance), given
    if options.action == "identify":
        known = dict(options.known)
        return tasks.IdentifyTask(known), {"known": known}
    return (tasks.LawsTask() if options.action == "laws" else tasks.InfoTask()), {}


def _report(dataset: Dataset) -> bool:
    """Print the recordings that did not pass; False if there are some."""
    rows = dataset.table(["bag", "status", "error", "passed", "problem"]).to_pylist()
    bad = [row for row in rows if not row["passed"]]
    print(f"passed      {len(rows) - len(bad)} of {len(rows)}")
    for row in bad[:_LISTED]:
        why = row["error"] or row["problem"]
        print(f"  {'FAILED' if row['status'] != 'ok' else 'BAD':<9} {row['bag']}: {why}")
    if len(bad) > _LISTED:
        print(f"  and {len(bad) - _LISTED} more")
    return not bad


def _compare(
    before: Dataset | None, now: Dataset, options: argparse.Namespace
) -> tuple[list[Any] | None, list[str]]:
    """Print what changed against an earlier result."""
    if before is None:
        return None, []
    from cylconn_ros.study.archive.compare import added, changes

    found, new = changes(before, now, options.tolerance), added(before, now)
    bags = len({one.bag for one in found})
    print(f"against     {before.address}: {bags} recordings changed, {len(new)} new")
    print("\n".join(f"  CHANGED   {one}" for one in found))
    return found, new
