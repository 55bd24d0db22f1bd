"""The checks of `make test`: formatter, linter, types, tests; then one line of result each."""

import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CHECKS = {
    "format": ("ruff", "format", "--check", "--quiet", "--diff"),
    "lint": ("ruff", "check", "--quiet"),
    "types": ("mypy", "--no-error-summary"),
    "tests": ("pytest", "-q"),
}


def main() -> int:
    """Run every check; return 0 only if all pass. Further arguments go to pytest."""
    results = []
    for name, command in CHECKS.items():
        arguments = sys.argv[1:] if name == "tests" else []
        print(f"{name}: {' '.join([*command, *arguments])}", flush=True)
        started = time.monotonic()
        code = subprocess.run([sys.executable, "-m", *command, *arguments], cwd=ROOT).returncode
        results.append((name, code, time.monotonic() - started))
    print()
    for name, code, seconds in results:
        print(f"  {'passed' if code == 0 else 'FAILED'}  {name:8}{seconds:6.0f} s")
    return int(any(code for _, code, _ in results))


if __name__ == "__main__":
    sys.exit(main())
