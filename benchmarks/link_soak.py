"""Ten minutes of all that goes wrong on a link, with the bridge's own process at its end.

    python benchmarks/link_soak.py [--minutes 10]

A vehicle moves on a known path; clouds ask for its pose all the time. In every minute there are
15 s of 5,000 hostile messages a second (noise, cut, forged, impossible, of other vehicles), a link
that is lost for 20 s, and a reboot. Printed are every tag's error, how soon each event is told in
the diagnostics and recovered from, and the process's memory and load.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

from hostile_mavlink import hostile  # noqa: E402
from hovering_autopilot import HoveringAutopilot, Wire  # noqa: E402

from ftp_dent_ros.cloud.cloud import Cloud  # noqa: E402
from ftp_dent_ros.ros.messages import cloud_to_message, stamp_to_ns  # noqa: E402
from ftp_dent_ros.ros.qos import CLOUDS, POSES  # noqa: E402
from ftp_dent_ros.supervision.transport import free_domain  # noqa: E402

LOCAL = '127.0.0.1'
FLOOD = 5000
# Seconds of each minute.
FLOODED, LOST, BACK, REBOOT = (2, 17), 20, 40, 50
SILENT_AT_BOOT = 1.2
# Whole milliseconds of a stamp at 1.5 m/s, doubt of the clock, and the interpolation.
RIGHT = 0.005


class Vehicle(HoveringAutopilot):
    """Swings north and south about its `north`, at up to 1.5 m/s."""

    def where(self, stamp: int) -> float:
        """North at a UNIX time in nanoseconds, metres."""
        return self.motion((stamp - self._boot) / 1e6)[0]

    def motion(self, boot_ms: float) -> tuple[float, ...]:
        phase = boot_ms / 2e3
        north, speed = self._north + 3 * math.sin(phase), 1.5 * math.cos(phase)
        return north, 2.0, -1.0, speed, 0.0, 0.0


def flood(port: int) -> None:
    """Send the enemy's messages until killed."""
    enemies, end = hostile(random.Random(1)), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    pool = [data for data, _ in zip(enemies, range(20_000), strict=False) if not changes(data)]
    begin, sent = time.monotonic(), 0
    while True:
        while sent < (time.monotonic() - begin) * FLOOD:
            end.sendto(pool[sent % len(pool)], (LOCAL, port))
            sent += 1
        time.sleep(0.002)


def changes(data: bytes) -> bool:
    """Whether it is a sound report in the vehicle's name, which nobody could tell for forged."""
    return data[5:7] == b'\x01\x01' and int.from_bytes(data[7:10], 'little') in (24, 193, 230)


class Soak:
    """The bridge's process, the vehicle and what came of them."""

    def __init__(self, port: int, node: subprocess.Popen[bytes]) -> None:
        self.port, self.node = port, node
        self.ros = rclpy.create_node('link_soak')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.ros)
        self.points = self.ros.create_publisher(PointCloud2, 'points', CLOUDS)
        self.ros.create_subscription(PoseWithCovarianceStamped, 'tagged/pose', self._tag, POSES)
        self.ros.create_subscription(DiagnosticArray, '/diagnostics', self._diagnose, 10)
        self.flights: list[tuple[int, Vehicle]] = []
        self.errors: list[float] = []
        self.last_tag = 0
        self.values: dict[str, str] = {}
        self.verdict = ''
        self.boot()

    def boot(self) -> None:
        end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        end.bind((LOCAL, 0))
        north = 20.0 * len(self.flights)
        vehicle = Vehicle(Wire(end, (LOCAL, self.port)), north=north)
        self.flights.append((time.time_ns(), vehicle))

    @property
    def vehicle(self) -> Vehicle:
        return self.flights[-1][1]

    def _tag(self, message: PoseWithCovarianceStamped) -> None:
        stamp = stamp_to_ns(message.header.stamp)
        flown = [vehicle for begin, vehicle in self.flights if begin <= stamp]
        north = message.pose.pose.position.y
        self.errors.append(abs(north - flown[-1].where(stamp)) if flown else math.inf)
        self.last_tag = max(self.last_tag, stamp)

    def _diagnose(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == 'mavlink_bridge':
                self.values = {item.key: item.value for item in status.values}
                self.verdict = status.message

    def run(self, until: float) -> None:
        """Ask for poses until a steady time."""
        point = Cloud(np.zeros((1, 1, 3), np.float32), np.ones((1, 1), np.float32))
        due = time.monotonic()
        while (now := time.monotonic()) < until:
            if now >= due:
                stamp = time.time_ns() - 200_000_000
                self.points.publish(cloud_to_message(point, stamp, 'camera_optical_frame'))
                due += 0.1
            self.executor.spin_once(timeout_sec=0.02)

    def seconds_until(self, condition, limit: float = 15.0) -> float:
        begin = time.monotonic()
        while not condition():
            if time.monotonic() - begin > limit:
                return math.inf
            self.run(time.monotonic() + 0.03)
        return time.monotonic() - begin

    def recovery(self) -> float:
        """Seconds until a cloud of after now has been tagged."""
        now = time.time_ns()
        return self.seconds_until(lambda: self.last_tag > now)


def minute(soak: Soak) -> dict[str, float]:
    """One minute of it: how soon each event was told, and how soon recovered from."""
    begin, times = time.monotonic(), {}
    soak.run(begin + FLOODED[0])
    enemy = multiprocessing.Process(target=flood, args=(soak.port,), daemon=True)
    before, messages = len(soak.errors), heard(soak)
    enemy.start()
    soak.run(begin + FLOODED[1])
    enemy.kill()
    enemy.join()
    times['tags_in_flood'] = (len(soak.errors) - before) / (FLOODED[1] - FLOODED[0])
    soak.run(begin + LOST)
    times['flood_rate'] = (heard(soak) - messages) / (FLOODED[1] - FLOODED[0])
    soak.vehicle.silent = True
    times['loss_told'] = soak.seconds_until(lambda: 'silent' in soak.verdict)
    soak.run(begin + BACK)
    soak.vehicle.silent = False
    times['loss_recovered'] = soak.recovery()
    soak.run(begin + REBOOT)
    restarts = soak.values['clock restarts']
    soak.vehicle.close()
    soak.run(time.monotonic() + SILENT_AT_BOOT)
    soak.boot()
    now = time.time_ns()
    times['reboot_told'] = soak.seconds_until(lambda: soak.values['clock restarts'] != restarts)
    behind = (time.time_ns() - now) / 1e9
    times['reboot_recovered'] = behind + soak.seconds_until(lambda: soak.last_tag > now)
    soak.run(begin + 60)
    return times


def heard(soak: Soak) -> int:
    """How much has come, good or bad."""
    ours, others = 'messages', ('messages of others', 'messages in its name from elsewhere')
    return sum(int(soak.values[key]) for key in (ours, *others, 'bytes that are no message'))


def resident(pid: int) -> float:
    """Memory of a process, MB."""
    with open(f'/proc/{pid}/statm') as file:
        return int(file.read().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6


def cpu(pid: int) -> float:
    """Processor time of a process, seconds."""
    with open(f'/proc/{pid}/stat') as file:
        fields = file.read().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=int, default=10)
    minutes = parser.parse_args().minutes
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOCAL, 0))
        port = probe.getsockname()[1]
    with free_domain() as domain:
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain), 'PYTHONPATH': str(ROOT)}
        node = subprocess.Popen(
            [
                *(sys.executable, '-m', 'ftp_dent_ros.nodes', 'mavlink_bridge', '--ros-args'),
                *('-p', f'address:=udpin:{port}', '-p', 'queue_size:=50'),
                *('--log-level', 'mavlink_bridge:=fatal'),
            ],
            env=environment,
        )
        rclpy.init(args=[], domain_id=domain)
        soak = Soak(port, node)
        try:
            print(f'first tag after {soak.recovery():.1f} s')
            for number in range(1, minutes + 1):
                used = cpu(node.pid)
                times = minute(soak)
                text = ', '.join(f'{key} {value:.1f}' for key, value in times.items())
                wrong = sum(error > RIGHT for error in soak.errors)
                print(
                    f'{number:3d} min: {resident(node.pid):.1f} MB, load '
                    f'{(cpu(node.pid) - used) / 0.6:.0f} %, {len(soak.errors)} tags, '
                    f'{wrong} wrong, {text}',
                    flush=True,
                )
        finally:
            soak.vehicle.close()
            node.send_signal(signal.SIGINT)
            status = node.wait(10)
            rclpy.try_shutdown()
    print(f'largest error of a tag {1e3 * max(soak.errors):.1f} mm, exit status {status}')
    refusals = {k: int(v) for k, v in soak.values.items() if k.startswith('refused: ')}
    print('refusals', refusals)
    return status


if __name__ == '__main__':
    sys.exit(main())
