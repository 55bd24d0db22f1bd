"""Search for bytes that break the node, led by the branches they reach; needs pip install atheris.

python scripts/fuzz.py cdr|scene [arguments of atheris: -max_total_time=600 DIR]
"""

import importlib
import sys
import tempfile
from pathlib import Path
from typing import Any

LED_BY = ["cylconn_ros.ros", "cylconn_ros.connector", "yaml"]  # not by what is compiled


def main() -> None:
    """Let atheris search until it is told to end."""
    root = Path(__file__).resolve().parent.parent
    sys.path[:0] = [str(root), str(root / "test")]
    atheris: Any = importlib.import_module("atheris")
    with atheris.instrument_imports(include=LED_BY):
        fuzzing = importlib.import_module("fuzzing")
    what = sys.argv.pop(1)
    with tempfile.TemporaryDirectory() as folder:
        atheris.Setup(sys.argv, fuzzing.targets(Path(folder))[what])
        atheris.Fuzz()


if __name__ == "__main__":
    main()
