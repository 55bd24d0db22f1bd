"""What nodes ask of Fast DDS, and that it does so."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped
from paths import CONFIG

from cylconn_ros.ros import middleware

ROOM = middleware.OURS.parent
SPACE = "{http://www.eprosima.com}"
SENDS = """
import os, sys, time
from pathlib import Path
from cylconn_ros.ros.middleware import prefer_quiet_writers
if sys.argv[1] == "ours":
    prefer_quiet_writers()
import rclpy
from geometry_msgs.msg import WrenchStamped
rclpy.init()
node = rclpy.create_node("sends")
publisher = node.create_publisher(WrenchStamped, "wrench", 50)
while not publisher.get_subscription_count():
    time.sleep(0.01)
def awoken():
    found = 0
    for task in Path("/proc/self/task").iterdir():
        if (task / "comm").read_text().startswith("dds.ev"):
            lines = (task / "status").read_text().splitlines()
            found += sum(int(one.split()[1]) for one in lines if one.startswith("voluntary"))
    return found
time.sleep(0.5)
before = awoken()
for _ in range(400):
    publisher.publish(WrenchStamped())
    time.sleep(0.0001)
print("awoken", awoken() - before)
"""


def writers(file: Path) -> str:
    """What a file of profiles says of writers, as text."""
    (found,) = ElementTree.parse(file).getroot().iter(f"{SPACE}data_writer")
    assert found.attrib["is_default_profile"] == "true"
    return "".join(ElementTree.tostring(found, encoding="unicode").split())


def test_profiles_say_the_same_of_writers():
    ours = writers(middleware.OURS)
    assert writers(ROOM / "loopback.xml") == ours
    assert writers(CONFIG / "fastdds_many.xml") == ours


def test_a_profile_of_the_users_comes_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(middleware.PROFILE, "mine.xml")
    middleware.prefer_quiet_writers()
    assert os.environ[middleware.PROFILE] == "mine.xml"
    monkeypatch.delenv(middleware.PROFILE)
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").touch()
    middleware.prefer_quiet_writers()
    assert middleware.PROFILE not in os.environ
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").unlink()
    middleware.prefer_quiet_writers()
    assert Path(os.environ[middleware.PROFILE]) == middleware.OURS


@pytest.mark.parametrize(("whose", "few"), [("ours", True), ("fast dds", False)])
def test_messages_do_not_wake_the_middlewares_clock(whose, few, peer):
    """Counted, not timed: how often its thread of timers slept while 400 messages went out."""
    peer.collect(WrenchStamped, "wrench")
    environment = {k: v for k, v in os.environ.items() if k != middleware.PROFILE}
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    run = [sys.executable, "-c", SENDS, whose]
    with subprocess.Popen(run, env=environment, stdout=subprocess.PIPE, text=True) as sending:
        peer.spin_until(lambda: sending.poll() is not None, "400 messages")
        assert sending.stdout is not None
        awoken = int(sending.stdout.read().split()[1])
    assert (awoken < 200) == few, awoken
