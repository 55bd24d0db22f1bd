"""Coverage-guided search for input bytes that break a decoder; requires ``pip install atheris``.

python scripts/fuzz.py cdr|scene [arguments of atheris: -max_total_time=600 DIR]
"""

import importlib
import sys
import tempfile
from pathlib import Path
from typing import Any

# Packages whose branches guide the search; compiled code cannot be instrumented.
INSTRUMENTED = ["cylconn_ros.messages", "cylconn_ros.scene", "yaml"]


def main() -> None:
    """Run atheris until its time or number of runs is reached."""
    root = Path(__file__).resolve().parent.parent
    sys.path[:0] = [str(root), str(root / "test")]
    atheris: Any = importlib.import_module("atheris")
    with atheris.instrument_imports(include=INSTRUMENTED):
        fuzzing = importlib.import_module("fuzzing")
    target = sys.argv.pop(1)
    with tempfile.TemporaryDirectory() as folder:
        atheris.Setup(sys.argv, fuzzing.targets(Path(folder))[target])
        atheris.Fuzz()


if __name__ == "__main__":
    main()
