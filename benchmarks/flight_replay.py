"""Plays a recorded flight over UDP, in real time, into the bridge's own process; prints a table.

    python benchmarks/flight_replay.py [FLIGHT.tlog] [--begin S] [--end S]
                                       [--loss 0.05] [--bursts 0.1] [--foreign]

The log (of pymavlink's kind, with SIM_STATE as ground truth) is played as the vehicle would: its
packets at their times, TIMESYNC answered on its own boot clock. For every second record of the
truth a cloud of one point is published with that stamp, 0.2 s late, as after a reconstruction;
every tag is compared with the truth and with the log's own samples. What the bridge adds is the
first row of the table; the last rows are the autopilot's own errors. The link can be made to lose
packets, to hold them up in bursts, and to bring another vehicle's.
"""

from __future__ import annotations

import argparse
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT)]

from flight_player import Disturbance, FlightPlayer  # noqa: E402
from recorded_flight import Errors, Flight, compare, own_poses  # noqa: E402

from ftp_dent_ros.cloud.cloud import Cloud  # noqa: E402
from ftp_dent_ros.navigation import frames  # noqa: E402
from ftp_dent_ros.navigation.trust import is_ready  # noqa: E402
from ftp_dent_ros.ros.messages import (  # noqa: E402
    cloud_from_message,
    cloud_to_message,
    pose_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, POSES  # noqa: E402
from ftp_dent_ros.supervision.transport import free_domain  # noqa: E402

SHIPPED = ROOT / 'test' / 'data' / 'flight' / 'copter_flight_square.tlog.xz'
LATENCY_NS = 200_000_000
# Of the truth's records every second has a cloud: 12.5 Hz.
EVERY = 2
MOUNT = [0.1, 0.0, 0.0]


class Watcher:
    """The other end of the bridge's topics."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('flight_replay')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.points = self.node.create_publisher(PointCloud2, 'points', CLOUDS)
        self.tags: dict[int, PoseWithCovarianceStamped] = {}
        self.clouds: dict[int, PointCloud2] = {}
        self.stream: list[PoseStamped] = []
        self.delays: list[float] = []
        self.values: dict[str, str] = {}
        subscribe = self.node.create_subscription
        subscribe(PoseWithCovarianceStamped, 'tagged/pose', self._on_tag, QoSProfile(depth=100))
        # Deep, for it shares the machine with all that it watches.
        subscribe(PointCloud2, 'tagged/points', self._on_cloud, QoSProfile(depth=100))
        subscribe(PoseStamped, 'mavlink/pose', self._on_pose, POSES)
        subscribe(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)

    def _on_tag(self, message: PoseWithCovarianceStamped) -> None:
        stamp = stamp_to_ns(message.header.stamp)
        self.tags[stamp] = message
        self.delays.append((time.time_ns() - stamp - LATENCY_NS) / 1e9)

    def _on_cloud(self, message: PointCloud2) -> None:
        self.clouds[stamp_to_ns(message.header.stamp)] = message

    def _on_pose(self, message: PoseStamped) -> None:
        self.stream.append(message)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == 'mavlink_bridge':
                self.values = {item.key: item.value for item in status.values}
                self.values['verdict'] = status.message

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=min(left, 0.05))


def play(
    flight: Flight,
    begin: float,
    end: float,
    port: int,
    watcher: Watcher,
    disturbance: Disturbance,
) -> dict[int, int]:
    """Stamps of the clouds that were published, with the times of the recording."""
    point = Cloud(np.zeros((1, 1, 3), np.float32), np.ones((1, 1), np.float32))
    asked = {}
    with FlightPlayer(flight, ('127.0.0.1', port), begin, end, disturbance) as player:
        shift = player.shift()
        first = flight.times[0]
        for at in flight.truth().times[::EVERY]:
            if not begin <= (at - first) / 1e9 <= end:
                continue
            stamp = at + shift
            watcher.spin((stamp + LATENCY_NS - time.time_ns()) / 1e9)
            watcher.points.publish(cloud_to_message(point, stamp, 'camera_optical_frame'))
            asked[stamp] = at
            if len(asked) % 125 == 0:
                print(f'{(at - first) / 1e9:6.1f} s  {watcher.values.get("verdict", "")}')
        watcher.spin(3.0)
        heard = Counter(
            (m.get_srcSystem(), m.get_srcComponent(), m.get_type()) for m in player.received
        )
    print('\nsent by the bridge:', dict(heard))
    return asked


def report(flight: Flight, asked: dict[int, int], watcher: Watcher, cpu: float) -> None:
    truth = flight.truth()
    row = {at: index for index, at in enumerate(truth.times)}
    stamps = [stamp for stamp in asked if stamp in watcher.tags]
    times = [asked[stamp] for stamp in stamps]
    rows = [row[at] for at in times]
    poses = [pose_from_message(watcher.tags[stamp].pose.pose) for stamp in stamps]
    against_truth = compare(poses, truth.position[rows], truth.attitude[rows])
    against_log = compare(poses, *own_poses(flight, times))
    own = compare_own(flight, times, truth.position[rows], truth.attitude[rows])
    speed = np.array([np.hypot(m.vn, m.ve) for _, m in flight.of('SIM_STATE')])[rows]
    texts = flight.of('STATUSTEXT')
    aligned = [at for at, m in texts if 'in-flight yaw alignment complete' in m.text]
    after = np.array(times) > (aligned[0] if aligned else 0)

    first = flight.times[0]
    ready = [
        at for at, m in flight.of('EKF_STATUS_REPORT') if is_ready('EKF_STATUS_REPORT', m.flags)
    ]
    print(f'clouds {len(asked)}, tagged {len(stamps)}, with tagged points {len(watcher.clouds)}')
    print(f'estimator ready at {(ready[0] - first) / 1e9:.3f} s, first tag at', end=' ')
    print(f'{(times[0] - first) / 1e9:.3f} s, tags before it {sum(at < ready[0] for at in times)}')
    print(f'poses on mavlink/pose {len(watcher.stream)}, node CPU {cpu:.1f} s')
    print(f'tag after the cloud: {describe(watcher.delays)}')
    off = [
        np.abs(
            cloud_from_message(watcher.clouds[stamp]).points[0, 0] - pose.apply(np.array(MOUNT))
        ).max()
        for stamp, pose in zip(stamps, poses, strict=True)
        if stamp in watcher.clouds
    ]
    print(f'point of a tagged cloud against its pose: at most {1e3 * max(off):.4f} mm\n')
    print(f'{"":42}{"n":>6}{"north":>22}{"east":>22}{"down":>22}{"attitude":>22}')
    print(f'{"":48}' + 4 * f'{"rms     95 %      max":>22}')
    for name, errors, mask in (
        ("tags against the log's own samples", against_log, after | True),
        ('tags against the truth', against_truth, after | True),
        ('  after the in-flight yaw alignment', against_truth, after),
        ('  and slower than 0.3 m/s', against_truth, after & (speed < 0.3)),
        ("log's own samples against the truth", own, after | True),
        ('  after the in-flight yaw alignment', own, after),
    ):
        print_row(name, errors.within(mask))
    near = np.linalg.norm(against_log.position, axis=1) < 0.03
    right = near & (against_log.angle < 0.3)
    print(f"\ntags within 3 cm and 0.3 deg of the log's own: {right.sum()} of {len(right)}")
    others = (~near & (against_log.angle > 10)).sum()
    others_streamed = sum(abs(pose.pose.position.y) > 25 for pose in watcher.stream)
    print(f'poses of another vehicle: {others} tags, {others_streamed} of the stream')
    sure = ratios(watcher, stamps, truth.position[rows], truth.attitude[rows]) < 2
    print(f'errors against the truth within two standard deviations: {100 * sure.mean():.1f} %')
    inside = np.all(np.abs(against_truth.position) < [0.05, 0.05, 0.15], axis=1)
    print(
        f'\nafter the alignment {100 * inside[after].mean():.1f} % of the tags are within '
        f'5, 5, 15 cm and {100 * (against_truth.angle[after] < 1.5).mean():.1f} % within 1.5 deg\n'
    )
    for key, value in watcher.values.items():
        print(f'{key:32} {value}')


def ratios(
    watcher: Watcher, stamps: list[int], position: np.ndarray, attitude: np.ndarray
) -> np.ndarray:
    """Errors against the truth by the standard deviations that the tags tell; shape (n, 6)."""
    rows = []
    for stamp, place, turn in zip(stamps, position, attitude, strict=True):
        message = watcher.tags[stamp].pose
        pose = pose_from_message(message.pose)
        true = Rotation.from_quat(frames.enu_attitude(turn))
        off = (pose.rotation * true.inv()).as_rotvec()
        error = np.concatenate([pose.translation - frames.enu_from_ned(place), off])
        rows.append(np.abs(error) / np.sqrt(np.diag(np.reshape(message.covariance, (6, 6)))))
    return np.array(rows)


def compare_own(
    flight: Flight, times: list[int], position: np.ndarray, attitude: np.ndarray
) -> Errors:
    own_position, own_attitude = own_poses(flight, times)
    dot = np.abs(np.sum(own_attitude * attitude, axis=1)).clip(0, 1)
    return Errors(own_position - position, np.degrees(2 * np.arccos(dot)))


def describe(seconds: Iterable[float]) -> str:
    values = 1e3 * np.array(list(seconds))
    return '{:.0f} ms median, {:.0f} ms 95 %, {:.0f} ms at most'.format(
        *np.percentile(values, [50, 95, 100])
    )


def print_row(name: str, errors: Errors) -> None:
    (rms, rms_angle), (p95, p95_angle), (most, most_angle) = (
        errors.rms(),
        errors.largest(95),
        errors.largest(),
    )
    cells = [
        f'{1e2 * a:7.2f}{1e2 * b:7.2f}{1e2 * c:7.2f} '
        for a, b, c in zip(rms, p95, most, strict=True)
    ]
    angle = f'{rms_angle:7.3f}{p95_angle:7.3f}{most_angle:7.3f}'
    print(f'{name:42}{len(errors.angle):6}' + ''.join(cells) + angle)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('log', type=Path, nargs='?', default=SHIPPED)
    parser.add_argument('--begin', type=float, default=0.0, help='seconds since its start')
    parser.add_argument('--end', type=float, default=1e6)
    parser.add_argument('--loss', type=float, default=0.0, help='share of packets lost')
    parser.add_argument(
        '--bursts', type=float, default=0.0, help='longest delay in bursts, seconds'
    )
    parser.add_argument('--foreign', action='store_true', help='another vehicle on the same port')
    arguments = parser.parse_args()
    flight = Flight.read(arguments.log)
    disturbance = Disturbance(arguments.loss, arguments.bursts, 2 if arguments.foreign else 0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('127.0.0.1', 0))
        port = probe.getsockname()[1]
    with free_domain() as domain:
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain), 'PYTHONPATH': str(ROOT)}
        parameters = ['--ros-args', '-p', f'address:=udpin:127.0.0.1:{port}']
        parameters += ['-p', 'queue_size:=50']
        node = subprocess.Popen(
            [sys.executable, '-m', 'ftp_dent_ros.nodes', 'mavlink_bridge', *parameters],
            env=environment,
        )
        try:
            rclpy.init(args=[], domain_id=domain)
            watcher = Watcher()
            while not watcher.points.get_subscription_count():
                watcher.spin(0.1)
            asked = play(flight, arguments.begin, arguments.end, port, watcher, disturbance)
        finally:
            node.send_signal(signal.SIGINT)
            status = node.wait(10)
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    report(flight, asked, watcher, usage.ru_utime + usage.ru_stime)
    print(f'{"exit status of the node":32} {status}')
    watcher.executor.shutdown()
    watcher.node.destroy_node()
    rclpy.try_shutdown()
    return status


if __name__ == '__main__':
    sys.exit(main())
