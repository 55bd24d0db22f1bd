"""Default Fast DDS profile, used unless the user set one."""

from __future__ import annotations

import os
from pathlib import Path

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"  # path of a Fast DDS profile file
_IN_DIRECTORY = "DEFAULT_FASTRTPS_PROFILES.xml"  # read by Fast DDS from the working directory
DEFAULT_PROFILE = Path(__file__).with_name("writers.xml")


def use_default_profile() -> None:
    """Make Fast DDS read ``ros/writers.xml`` (its purpose is explained there) in this process.

    Does nothing if the user set a profile file or the working directory contains one. Call it
    before the first context is created. Other middlewares ignore the setting.
    """
    if not Path(_IN_DIRECTORY).exists() and DEFAULT_PROFILE.is_file():
        os.environ.setdefault(PROFILE_VARIABLE, str(DEFAULT_PROFILE))
