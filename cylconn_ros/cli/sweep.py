"""Run many variants of a scene; each run becomes one row of a Parquet dataset.

SCENE is a parameter file or the name of a bundled scene. Each --vary is an axis; rows are all
combinations:
  --vary friction.coefficient=0.1:0.5:50          50 values at equal distances (…:log: equal ratios)
  --vary method=impulse,penalty                   a list
  --vary body_b.com=@points.csv                   a value, or a vector, a line of a file
  --vary @table.csv                               columns named by the header vary together
  --sample 10000 --distribution friction.coefficient=normal:0.2:0.02 --vary body_b.mass=1.9:2.3
                                                  random points; LOW:HIGH is uniform
All rows are checked before the first run. A run that fails is a row, too. The same command with the
same folder resumes; --row N runs one row again and keeps it as a recording. The exit code is 1 if a
row failed. docs/scale explains the dataset and how to query it.

For example: cylconn sweep demo --vary friction.coefficient=0.1:0.5:50 --duration 1 -o study

Next: open study/page.html, or query study/rows with pandas or DuckDB.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cylconn_ros.cli import scenes, study_options
from cylconn_ros.cli.progress import Progress
from cylconn_ros.errors import CommandError, StudyError
from cylconn_ros.scene.scene import load_all
from cylconn_ros.study.dataset import STUDY, Dataset
from cylconn_ros.study.rows import Axis, Rows, read_axis
from cylconn_ros.study.sampling import DESIGNS, read_correlation
from cylconn_ros.study.variants import Variants


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "scene", metavar="SCENE", help="parameter file or name of a scene; with --row the dataset"
    )
    parser.add_argument(
        "--vary", action="append", default=[], metavar="AXIS", help="an axis, as above"
    )
    parser.add_argument(
        "--sample", type=study_options.positive, default=0, metavar="N", help="random points"
    )
    parser.add_argument(
        "--distribution", action="append", default=[], metavar="NAME=KIND:…",
        help="normal:MEAN:SD[:LOW:HIGH], lognormal:MEDIAN:SD[:LOW:HIGH], uniform:LOW:HIGH or "
        "triangular:LOW:MODE:HIGH; one component of a vector as body_b.com[1]",
    )  # fmt: skip
    parser.add_argument(
        "--correlation", action="append", default=[], metavar="NAME,NAME=R",
        help="of two distributions",
    )  # fmt: skip
    parser.add_argument("--design", choices=DESIGNS, default="latin", help="of the points (latin)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of the design (1)")
    parser.add_argument(
        "--outputs", action="append", default=[], metavar="NAME[,NAME…]",
        help="columns: stop_time, jam, flags, … or FIELD.REDUCTION, as normal_force.max; "
        "default: a selection",
    )  # fmt: skip
    scenes.add_overrides(parser)
    scenes.add_set(parser)
    parser.add_argument(
        "-o", "--output", metavar="FOLDER", help="dataset, or the recording of --row"
    )
    parser.add_argument(
        "--row", type=int, metavar="N", help="run a row of the dataset SCENE again, whole"
    )
    parser.add_argument("--no-page", action="store_true", help="write no page.html")
    study_options.add_engine(parser)


def run(options: argparse.Namespace) -> int:
    """Run the sweep, or one row again; 1 if a row failed."""
    if options.output is None:
        raise CommandError("-o FOLDER is missing: where the results go")
    if options.row is not None:
        return _one(options)
    from cylconn_ros.study.executors import engine
    from cylconn_ros.study.outputs import DEFAULT
    from cylconn_ros.study.sweep import Simulation, into_dataset

    variants = _variants(options)
    rows = _rows(options)
    named = [name.strip() for text in options.outputs for name in text.split(",")]
    task = Simulation(variants, None, tuple(named) or DEFAULT)
    task.outputs  # noqa: B018 (raises for a name that does not exist)
    with engine(options.scheduler, options.workers) as used:
        print(f"sweep       {len(rows)} rows of {', '.join(rows.columns)}; {used.name}")
        with (
            Progress("check") as checking,
            Progress(f"sweep {Path(options.scene).stem}", unit="runs") as bar,
        ):
            found = into_dataset(
                task, rows, options.output, used,
                chunk=options.chunk, progress=bar, checking=checking,
            )  # fmt: skip
    print("\n".join(study_options.describe(found.outcome, "run")))
    print(f"kept        {found.dataset.address}/rows")
    failed = _failed(found.dataset)
    if not options.no_page:
        print(f"page        {_page(found.dataset)}")
    print(f"next: cylconn sweep {options.output} --row 0 -o RUN runs one row again")
    return 1 if failed else 0


def _variants(options: argparse.Namespace) -> Variants:
    if (Path(options.scene) / STUDY).is_file():
        raise CommandError(f"{options.scene} is a dataset: give --row N, or the scene to sweep")
    path = scenes.find(options.scene)
    return Variants(scenes.all_overridden(path, load_all(path), options))


def _rows(options: argparse.Namespace) -> Rows:
    """The table of the command line: axes, and a random design."""
    from cylconn_ros.study.sweep import sweep_rows

    axes: list[Axis] = []
    distributions: dict[str, str] = {}
    for text in options.vary:
        name, _, values = text.partition("=")
        if options.sample and values.count(":") == 1 and not values.startswith("@"):
            distributions[name.strip()] = f"uniform:{values}"
        else:
            axes.append(read_axis(text))
    for text in options.distribution:
        name, equals, values = text.partition("=")
        if not equals or name.strip() in distributions:
            raise StudyError(f"--distribution {text}: must be NAME=KIND:…, each name once")
        distributions[name.strip()] = values
    if distributions and not options.sample:
        raise StudyError("--distribution needs --sample N")
    return sweep_rows(
        axes, distributions, options.sample,
        correlations=[read_correlation(text) for text in options.correlation],
        design=options.design, seed=options.seed,
    )  # fmt: skip


def _failed(dataset: Dataset) -> int:
    """Number of failed rows of a dataset; prints the first error."""
    from pyarrow import compute

    table = dataset.table(["row", "status", "error"])
    bad = table.filter(compute.not_equal(table["status"], "ok"))
    if len(bad):
        first = bad.slice(0, 1).to_pylist()[0]
        print(f"            row {first['row']}: {first['error']}")
    return len(bad)


def _page(dataset: Dataset) -> str:
    """Write the page of the results; returns its address."""
    from cylconn_ros.study.page import sweep_page

    return dataset.write_page("page.html", sweep_page(dataset))


def _one(options: argparse.Namespace) -> int:
    """Run one row again and keep it."""
    from cylconn_ros.cli import simulate_several
    from cylconn_ros.cli.simulate import keep
    from cylconn_ros.simulation.run import Run
    from cylconn_ros.study.sweep import Sweep

    output = Path(options.output)
    if output.exists():
        raise CommandError(f"{output} exists; a run is never overwritten")
    found = Sweep(Dataset.existing(options.scene))
    result = found.run(options.row)
    if isinstance(result, Run):
        keep(result, result.scene, output)
    else:
        simulate_several.record(result, found.scenes(options.row), output)
    for name, value in found.dataset.row(options.row).items():
        print(f"{name:<32}{value}")
    print(f"kept        {output}\nnext: cylconn report {output}")
    return 0
