"""What is asked of the middleware, where nobody else has asked for anything."""

from __future__ import annotations

import os
from pathlib import Path

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"  # where Fast DDS finds a file of profiles
_IN_PLACE = "DEFAULT_FASTRTPS_PROFILES.xml"  # what it reads from the working directory besides
OURS = Path(__file__).with_name("writers.xml")


def prefer_quiet_writers() -> None:
    """Let Fast DDS read ``ros/writers.xml`` in this process, which says what for.

    Not where a profile is named already, or stands in the working directory. To be called before
    the first context; other middlewares do not notice.
    """
    if not Path(_IN_PLACE).exists() and OURS.is_file():
        os.environ.setdefault(PROFILE, str(OURS))
