"""What a node's process opens, and whom it meets."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

from ftp_dent_ros.pattern.file import write_pattern
from ftp_dent_ros.pattern.pattern import Pattern

STRANGER = """
import rclpy, sys, time
rclpy.init()
node = rclpy.create_node('stranger')
end = time.monotonic() + 3.0
while time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
print(*node.get_node_names())
"""


def addresses_of(pid):
    """Local addresses of the UDP and TCP sockets of a process, IPv4 as hexadecimal digits."""
    inodes = set()
    for link in Path(f'/proc/{pid}/fd').iterdir():
        with contextlib.suppress(FileNotFoundError):  # it opens and closes others meanwhile
            inodes.add(str(link.readlink()).removeprefix('socket:[').rstrip(']'))
    found = set()
    for table in ('udp', 'udp6', 'tcp', 'tcp6'):
        for line in Path(f'/proc/{pid}/net/{table}').read_text().splitlines()[1:]:
            words = line.split()
            if words[9] in inodes:
                found.add(words[1].partition(':')[0])
    return found


def test_a_confined_node_opens_the_loopback_alone_and_meets_no_stranger(ros, tmp_path):
    write_pattern(tmp_path / 'pattern.yaml', Pattern(640, 400, 16.0, 320.0))
    node = ros.start('pattern_publisher', pattern=tmp_path / 'pattern.yaml')
    ros.until(ros.diagnostics('pattern_publisher'))
    # 127.0.0.1, and the group in which participants look for each other, on the loopback.
    assert addresses_of(node.pid) == {'0100007F', '0100FFEF'}
    own = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'ROS_AUTOMATIC_DISCOVERY_RANGE')
    environment = {name: value for name, value in os.environ.items() if name not in own}
    run = [sys.executable, '-c', STRANGER]
    names = subprocess.run(run, env=environment, capture_output=True, text=True, timeout=60).stdout
    assert 'stranger' in names.split()
    assert 'pattern_publisher' not in names.split()
