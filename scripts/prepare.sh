#!/bin/sh
# Prepare the local environment with a suitable Python (or PYTHON=...): prepare.sh demo|test|bench|docs
cd "$(dirname -- "$0")/.." || exit 1

usable='import sys
sys.path.insert(0, "scripts")
import toolchain
sys.exit(bool(toolchain.missing_for_environment()))'
supported='import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))'

# The first Python that meets all requirements; else the first of a supported version, which reports what is missing.
for check in "$usable" "$supported"; do
    for python in ${PYTHON:+"$PYTHON"} ${PYTHON:-python3 python3.12 python3.11 python3.13 python3.10}; do
        if "$python" -B -c "$check" 2>/dev/null; then
            exec "$python" -B scripts/prepare.py "$@"
        fi
    done
done

echo "cylconn_ros needs Python 3.10, 3.11, 3.12 or 3.13${PYTHON:+; $PYTHON is another version}." >&2
echo "On Debian or Ubuntu: sudo apt install python3 python3-venv python3-dev g++" >&2
exit 1
