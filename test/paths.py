"""Folders of the checkout that tests read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "cylconn_ros"
CONFIG = ROOT / "config"
BAGS = ROOT / "bags"
