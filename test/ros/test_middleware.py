"""Default Fast DDS profile: consistent files, user settings first, and its effect."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from geometry_msgs.msg import WrenchStamped
from paths import CONFIG

from cylconn_ros.ros import middleware

PROFILES = middleware.DEFAULT_PROFILE.parent
NAMESPACE = "{http://www.eprosima.com}"
PUBLISH = """
import os, sys, time
from pathlib import Path
from cylconn_ros.ros.middleware import use_default_profile
if sys.argv[1] == "default":
    use_default_profile()
import rclpy
from geometry_msgs.msg import WrenchStamped
rclpy.init()
node = rclpy.create_node("publisher")
publisher = node.create_publisher(WrenchStamped, "wrench", 50)
while not publisher.get_subscription_count():
    time.sleep(0.01)
def wakeups():
    found = 0
    for task in Path("/proc/self/task").iterdir():
        if (task / "comm").read_text().startswith("dds.ev"):
            lines = (task / "status").read_text().splitlines()
            found += sum(int(one.split()[1]) for one in lines if one.startswith("voluntary"))
    return found
time.sleep(0.5)
before = wakeups()
for _ in range(400):
    publisher.publish(WrenchStamped())
    time.sleep(0.0001)
print("wakeups", wakeups() - before)
"""


def writers(file: Path) -> str:
    """Default writer profile of a file, as text."""
    (found,) = ElementTree.parse(file).getroot().iter(f"{NAMESPACE}data_writer")
    assert found.attrib["is_default_profile"] == "true"
    return "".join(ElementTree.tostring(found, encoding="unicode").split())


def test_writer_profiles_are_the_same_in_all_files():
    expected = writers(middleware.DEFAULT_PROFILE)
    assert writers(PROFILES / "loopback.xml") == expected
    assert writers(CONFIG / "fastdds_many.xml") == expected


def test_profile_of_the_user_takes_precedence(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(middleware.PROFILE_VARIABLE, "mine.xml")
    middleware.use_default_profile()
    assert os.environ[middleware.PROFILE_VARIABLE] == "mine.xml"
    monkeypatch.delenv(middleware.PROFILE_VARIABLE)
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").touch()
    middleware.use_default_profile()
    assert middleware.PROFILE_VARIABLE not in os.environ
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").unlink()
    middleware.use_default_profile()
    assert Path(os.environ[middleware.PROFILE_VARIABLE]) == middleware.DEFAULT_PROFILE


@pytest.mark.parametrize(("profile", "few"), [("default", True), ("fast dds", False)])
def test_messages_do_not_wake_the_timer_thread(profile, few, peer):
    """Count the context switches of the timer thread while 400 messages are published."""
    peer.collect(WrenchStamped, "wrench")
    environment = {k: v for k, v in os.environ.items() if k != middleware.PROFILE_VARIABLE}
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    run = [sys.executable, "-c", PUBLISH, profile]
    with subprocess.Popen(run, env=environment, stdout=subprocess.PIPE, text=True) as publishing:
        peer.spin_until(lambda: publishing.poll() is not None, "400 messages")
        assert publishing.stdout is not None
        wakeups = int(publishing.stdout.read().split()[1])
    assert (wakeups < 200) == few, wakeups
