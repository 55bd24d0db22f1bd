"""Prepare .venv for a target of the Makefile: ROS 2 wheels, tools, this package (editable).

The first run needs the network. Later runs compare a fingerprint of the build inputs and do
nothing, or build again offline. Standard library only.
"""

import hashlib
import json
import os
import re
import subprocess
import sys
import threading
import time
import venv
from pathlib import Path

import toolchain

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STAMP = VENV / "prepared.json"
PLACE = VENV / "place"  # written when the environment is complete
LOG = VENV / "prepare.log"
BUILD_FILES = ("CMakeLists.txt", "package.xml", "pyproject.toml", "setup.py")
BUILD_FOLDERS = ("cmake", "config", "dashboards", "launch", "models", "msg")
EXTRAS = {  # extras of setup.py to install for each target
    "demo": ("demo",),
    "docs": ("docs",),
    "test": ("demo", "docs", "test"),
    "bench": ("demo", "bench", "peers"),
}

COMPILED = ("bench", "test")  # purposes that use every method; demo compiles what it needs


class PrepareError(Exception):
    """The environment cannot be prepared; the text is one sentence for the user."""


def fingerprint() -> str:
    """Hash all files that an installation copies or builds; Python sources are used in place."""
    files = [ROOT / name for name in BUILD_FILES]
    for folder in BUILD_FOLDERS:
        files += sorted(path for path in (ROOT / folder).rglob("*") if path.suffix != ".pyc")
    digest = hashlib.sha256()
    for path in files:
        if path.is_file():
            digest.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()


def build_requirements() -> list[str]:
    """Read [build-system] requires: plain strings, and Python 3.10 has no tomllib."""
    text = (ROOT / "pyproject.toml").read_text()
    block = re.search(r"^requires = \[(.*?)^\]", text, re.DOTALL | re.MULTILINE)
    if block is None:
        raise PrepareError("pyproject.toml has no [build-system] requires")
    return re.findall(r'"([^"]+)"', block[1])


def step(what: str, *command: str) -> None:
    """Run a command with its output in the log; print its purpose and the elapsed time."""
    started = time.monotonic()
    done = threading.Event()
    live = sys.stdout.isatty()

    def show() -> None:
        while not done.wait(1.0):
            print(f"\r  {what} … {time.monotonic() - started:.0f} s", end="", flush=True)

    print(f"  {what} …", end="" if live else "\n", flush=True)
    ticker = threading.Thread(target=show, daemon=True)
    if live:
        ticker.start()
    with LOG.open("a") as log:
        log.write(f"\n$ {' '.join(command)}\n")
        log.flush()
        code = subprocess.run(command, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT).returncode
    done.set()
    if live:
        ticker.join()
        print(f"\r  {what}: {time.monotonic() - started:.0f} s   ")
    if code:
        raise PrepareError(diagnosis(LOG.read_text().rsplit("\n$ ", 1)[-1]))


def compile_physics() -> None:
    """Compile the kernels into the user's cache, with their own progress."""
    print("  compiled physics …")
    command = (str(VENV / "bin" / "cylconn"), "compile")
    if subprocess.run(command, cwd=ROOT).returncode:
        print("  the physics could not be compiled now: the first start compiles it")


def diagnosis(output: str) -> str:
    """Return the reason why pip failed in one sentence, if its output contains it."""
    compiling = re.search(
        r"CMake Error.*\n(?:\s*\S.*\n)*|.*\berror: .*\.(?:c|cpp|h|hpp)\b.*", output
    )
    refused = re.search(r"cylconn_ros cannot be built: .*", output)
    if refused:
        return f"{refused[0]}\n{compiling[0] if compiling else ''}(full log: {LOG})"
    unreachable = (
        "Failed to establish a new connection|Temporary failure in name resolution|timed out"
    )
    if re.search(f"{unreachable}|NewConnectionError|NameResolutionError", output):
        return "the package index cannot be reached; the first run needs the network"
    tail = "\n".join(output.strip().splitlines()[-12:])
    return f"pip failed:\n{tail}\n(full log: {LOG.relative_to(ROOT)})"


def stamp() -> dict:
    """Return fingerprint and purposes of the last completed preparation."""
    return json.loads(STAMP.read_text()) if STAMP.exists() else {}


def environment_version() -> str:
    """Version of the Python in .venv; empty if .venv is unusable and must be created again.

    Reasons: an upgrade of the system's Python, an interrupted creation, or a move of the clone
    (scripts contain the path of their installation).
    """
    if not PLACE.exists() or PLACE.read_text() != str(VENV):
        return ""
    ask = "import sys; print('{}.{}'.format(*sys.version_info))"
    try:
        answer = subprocess.run([PYTHON, "-I", "-c", ask], capture_output=True, text=True)
    except OSError:
        return ""
    return answer.stdout.strip()


def make_environment() -> None:
    """Create .venv if it is missing, broken or of another Python than requested."""
    wanted = "{}.{}".format(*sys.version_info)
    present = environment_version()
    if present and (present == wanted or not os.environ.get("PYTHON")):
        return
    missing = toolchain.missing_for_environment()
    if missing:
        raise PrepareError(toolchain.explain(missing))
    print(f"Preparing .venv with Python {wanted}; this first run needs the network.")
    venv.create(VENV, clear=True, with_pip=True)
    PLACE.write_text(str(VENV))


def prepare(purpose: str) -> None:
    """Update .venv for `purpose`, a key of EXTRAS."""
    make_environment()
    done = stamp()
    current = fingerprint()
    if done.get("fingerprint") == current and purpose in done["purposes"]:
        return
    STAMP.unlink(missing_ok=True)
    LOG.unlink(missing_ok=True)
    pip = (str(PYTHON), "-m", "pip", "--disable-pip-version-check", "install")
    purposes = {*EXTRAS[purpose], *done.get("purposes", ())}
    step("build tools of ROS 2", *pip, *build_requirements())
    editable = f".[{','.join(sorted(purposes))}]"
    step("messages, package and dependencies", *pip, "--no-build-isolation", "-e", editable)
    if purpose in COMPILED:
        compile_physics()
    done = {"fingerprint": current, "purposes": sorted(purposes)}
    STAMP.write_text(json.dumps(done))


def main() -> int:
    """Prepare for the purpose named on the command line."""
    try:
        prepare(sys.argv[1])
    except PrepareError as failure:
        print(f"\nCannot prepare the environment: {failure}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ninterrupted", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
