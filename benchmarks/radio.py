"""What of the payload's topics reaches the ground over radios, and how late.

python benchmarks/radio.py [--radios 100M 10M 2M 256k 57.6k] [--plain [TOPIC]] [--seconds 40]
                           [--outage 60] [--restart payload|ground] [--grounds 1] [--keys]
                           [--stream] [--bag BAG]

The payload (real nodes in simulation) and the ground are two network namespaces, joined by a
simulated radio: it takes root. With `--bag` a recorded flight (``ftp-dent demo`` keeps its own in
``bag``) takes the simulation's place, at two clouds a second, which it does not render on two
cores. With `--plain` there is neither downlink nor ground station, but a
subscriber of tagged/preview, or another topic, on the ground. A delay is from a message's arrival
at a subscriber aboard to that at one on the ground.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import yaml
from simulated_radio import Conditions, Joined, Site, joined_sites
from timing import processor_time

from ftp_dent_ros import files
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.supervision.transport import profile

RADIOS = {
    '100M': Conditions(100e6, 0.005, 0.001, 0.001),
    '10M': Conditions(10e6, 0.020, 0.002, 0.005),
    '2M': Conditions(2e6, 0.050, 0.005, 0.02, burst=3),
    '256k': Conditions(256e3, 0.100, 0.01, 0.05, burst=2),
    '57.6k': Conditions(57.6e3, 0.200, 0.02, 0.05, burst=2),
}
CLOUD, POSE = 'sensor_msgs/msg/PointCloud2', 'geometry_msgs/msg/PoseWithCovarianceStamped'
TOPICS = {
    'points': CLOUD,
    'tagged/points': CLOUD,
    'tagged/preview': CLOUD,
    'preview/points': CLOUD,
    'camera/image_raw': 'sensor_msgs/msg/Image',
    'tagged/pose': POSE,
    'dents': CLOUD,
    'dents/list': CLOUD,
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}
_CLOUDS_A_SECOND = 2.0
PREVIEW_OF = {'preview/points': 'points', 'tagged/preview': 'tagged/points'}


def listen(output: Path, names: list[str]) -> None:
    """Write topic, stamp and arrival of every message, a line each, until SIGINT."""
    import struct

    import rclpy
    from rclpy.qos import QoSProfile

    from ftp_dent_ros.coding.messages import message_class
    from ftp_dent_ros.ros.qos import CLOUDS, LATCHED

    rclpy.init()
    node = rclpy.create_node('listener')
    with output.open('w', buffering=1) as file:

        def take(name):
            def write(data):
                seconds, nanoseconds = struct.unpack_from('<iI', data, 4)
                stamp = seconds * 10**9 + nanoseconds
                file.write(f'{name} {stamp} {time.time_ns()}\n')

            return write

        for name in names:
            large = name in ('points', 'tagged/points', 'camera/image_raw')
            qos = LATCHED if name == 'dents/list' else CLOUDS if large else QoSProfile(depth=100)
            node.create_subscription(message_class(TOPICS[name]), name, take(name), qos, raw=True)
        node.create_timer(0.5, lambda: None)  # Without one a signal may not be noticed.
        try:
            rclpy.spin(node)
        except BaseException:
            return


class Run:
    """Processes of one row, and what they wrote."""

    def __init__(self, arguments: argparse.Namespace, joined: Joined, folder: Path) -> None:
        self.arguments, self.joined, self.folder = arguments, joined, folder
        self.stack = ExitStack()
        self.processes: dict[str, subprocess.Popen] = {}
        self.environment = dict(os.environ)
        self.environment.pop('ROS_AUTOMATIC_DISCOVERY_RANGE', None)
        self.environment.update(self.stack.enter_context(profile()))
        self.environment.update(OPENBLAS_NUM_THREADS='1', OMP_NUM_THREADS='1')

    def start(self, name: str, site: Site, domain: int, *words: str) -> None:
        log = (self.folder / f'{name}.log').open('a')
        self.processes[name] = subprocess.Popen(
            site.command([sys.executable, *words]),
            env={**self.environment, 'ROS_DOMAIN_ID': str(domain)},
            stdout=log,
            stderr=log,
        )

    def listen(self, name: str, site: Site, domain: int, topics: list[str]) -> None:
        path = str(self.folder / f'{name}.txt')
        self.start(name, site, domain, str(Path(__file__).resolve()), '--listen', path, *topics)

    def stop(self, name: str, with_signal: int = signal.SIGINT) -> None:
        process = self.processes.pop(name)
        process.send_signal(with_signal)
        process.wait(30)

    def close(self) -> None:
        for name in list(self.processes):
            self.stop(name, signal.SIGTERM)
        self.stack.close()

    def arrivals(self, name: str) -> dict[str, dict[int, list[float]]]:
        """Times of each stamp of each topic, seconds."""
        found: dict[str, dict[int, list[float]]] = {}
        path = self.folder / f'{name}.txt'
        for line in path.read_text().splitlines() if path.exists() else ():
            words = line.split()
            if len(words) == 3:
                found.setdefault(words[0], {}).setdefault(int(words[1]), []).append(
                    int(words[2]) / 1e9
                )
        return found

    def link(self) -> list[str]:
        if self.arguments.keys:
            return ['-p', f'keys:={json.dumps(str(self.folder / "keys"))}']
        return ['-p', 'open:=true']

    def address(self) -> str:
        return f'{"tcp/" if self.arguments.stream else ""}{self.joined.drone.address}:7447'

    def start_downlink(self) -> None:
        self.start(
            'downlink',
            self.joined.drone,
            1,
            *('-m', 'ftp_dent_ros.nodes', 'downlink', '--ros-args', *self.link()),
            *('-p', 'address:=0.0.0.0:7447', '-p', f'spool.folder:={self.folder}/spool'),
        )

    def start_station(self, number: int) -> None:
        self.start(
            f'ground_station{number}',
            self.joined.ground,
            2 + number,
            *('-m', 'ftp_dent_ros.nodes', 'ground_station', '--ros-args', *self.link()),
            *('-p', f'address:={self.address()}', '-p', f'station:=g{number}'),
        )


def flight(bag: Path) -> tuple[list[str], float]:
    """Arguments that replay a bag at two clouds a second, and how long that takes, seconds."""
    opened = open_bag(bag)
    came = [each.log_time_ns for each in opened.messages(['/points'])]
    seconds, count = (came[-1] - came[0]) / 1e9, len(came) - 1
    speed = _CLOUDS_A_SECOND * seconds / count
    topics = [topic.name for topic in opened.topics if topic.name != '/skin']
    words = ['replay', str(bag), '--rate', f'{speed:.4f}', '--topics', *topics]
    return words, count / _CLOUDS_A_SECOND


def payload(folder: Path) -> Path:
    """The shipped simulation, its dents listed all the time."""
    blocks = yaml.safe_load(files.find('shipped:simulation.yaml').read_text())
    blocks['dent_inspector']['ros__parameters']['always'] = True
    path = folder / 'payload.yaml'
    path.write_text(yaml.safe_dump(blocks))
    return path


def measure(arguments: argparse.Namespace, radio: str, folder: Path) -> dict[str, object]:
    """Run one row and print its table."""
    with joined_sites(RADIOS[radio]) as joined:
        run = Run(arguments, joined, folder)
        aboard = ['points', 'camera/image_raw', 'tagged/pose', 'dents', 'dents/list']
        if arguments.keys:
            from ftp_dent_ros.ground.link import make_keys

            make_keys(folder / 'keys')
        try:
            ground = [name for name in TOPICS if name not in ('tagged/points', 'tagged/preview')]
            if arguments.plain:
                aboard = ['points', 'tagged/points', 'dents']
                ground = [arguments.plain]
                run.listen('ground0', joined.ground, 1, ground)
            else:
                for number in range(arguments.grounds):
                    run.listen(f'ground{number}', joined.ground, 2 + number, ground)
                    run.start_station(number)
            run.listen('aboard', joined.drone, 1, aboard)
            time.sleep(3)
            if not arguments.plain:
                run.start_downlink()
            seconds = arguments.seconds
            if arguments.bag is None:
                words = ['up', str(payload(folder))]
            else:
                time.sleep(
                    5
                )  # Until the ground is heard: a flight is not as long as that of `up`.
                words, most = flight(arguments.bag)
                seconds = min(seconds, most - 3)
            run.start('payload', joined.drone, 1, '-m', 'ftp_dent_ros.cli.main', *words)
            begun = 1 if arguments.bag else 4
            while len(run.arrivals('aboard').get('points', {})) < begun:
                time.sleep(0.1)
            begin = time.time()
            used = 0.0 if arguments.plain else processor_time(run.processes['downlink'].pid)
            before = joined.ground.traffic()[0]
            disturb(run, radio, seconds)
            load = 0.0
            if not arguments.plain and 'downlink' in run.processes:
                load = (processor_time(run.processes['downlink'].pid) - used) / (
                    time.time() - begin
                )
            carried = (joined.ground.traffic()[0] - before) * 8 / (time.time() - begin)
            end = time.time()
            run.stop('payload')
            time.sleep(arguments.drain)
            return report(run, radio, begin, end, load, carried)
        finally:
            run.close()


def disturb(run: Run, radio: str, seconds: float) -> None:
    """Let the row's time pass, with what is to go wrong in it."""
    joined = run.joined
    time.sleep(seconds / 2)
    if run.arguments.outage:
        joined.set(Conditions(outage=True))
        time.sleep(run.arguments.outage)
        joined.set(RADIOS[radio])
    if run.arguments.restart == 'payload':
        run.stop('downlink', signal.SIGKILL)
        run.start_downlink()
    elif run.arguments.restart == 'ground':
        run.stop('ground_station0', signal.SIGKILL)
        run.start_station(0)
    time.sleep(seconds / 2)


def report(
    run: Run, radio: str, begin: float, end: float, load: float, carried: float
) -> dict[str, object]:
    aboard = run.arrivals('aboard')
    result: dict[str, object] = {'radio': radio, 'downlink %': round(100 * load, 1)}
    print(f'\n{radio}: downlink {100 * load:.1f} % of a core, {carried / 1e3:.0f} kbit/s carried')
    late = [min(t) - s / 1e9 for s, t in aboard.get('points', {}).items() if begin < min(t) < end]
    rate = len(late) / (end - begin)
    after = '' if run.arguments.bag else f', {np.median(late):.3f} s after the exposure (median)'
    print(f'  aboard: points {rate:.2f} Hz{after}')
    for number in range(run.arguments.grounds):
        there = run.arrivals(f'ground{number}')
        print(f'  {"topic":18} {"given":>6} {"came":>6} {"twice":>6} {"median":>8} {"95 %":>8}')
        for name in TOPICS:
            source = aboard.get(PREVIEW_OF.get(name, name), {})
            given = {s: min(t) for s, t in source.items() if begin < min(t) < end}
            came = there.get(name, {})
            if not came or (not given and name != '/diagnostics'):
                continue
            if name == '/diagnostics':
                print(f'  {name:18} {"":>6} {sum(map(len, came.values())):6}')
                continue
            delays = [min(came[s]) - t for s, t in given.items() if s in came]
            twice = sum(len(came[s]) - 1 for s in given if s in came)
            middle = f'{np.median(delays):8.3f} {np.percentile(delays, 95):8.3f}' if delays else ''
            print(f'  {name:18} {len(given):6} {len(delays):6} {twice:6} {middle}')
            result[f'{number} {name}'] = len(given), len(delays), middle.split()
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--radios', nargs='+', choices=RADIOS, default=list(RADIOS))
    parser.add_argument('--plain', nargs='?', const='tagged/preview', choices=TOPICS)
    parser.add_argument('--seconds', type=float, default=40.0)
    parser.add_argument('--drain', type=float, default=10.0)
    parser.add_argument('--outage', type=float, default=0.0)
    parser.add_argument('--restart', choices=('payload', 'ground'))
    parser.add_argument('--grounds', type=int, default=1)
    parser.add_argument('--keys', action='store_true')
    parser.add_argument('--stream', action='store_true', help='by TCP instead of datagrams')
    parser.add_argument('--bag', type=Path, help='a recorded flight instead of the simulation')
    parser.add_argument('--logs', type=Path, help='a folder that keeps the logs')
    parser.add_argument('--listen', nargs='+', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.listen:
        listen(Path(arguments.listen[0]), arguments.listen[1:])
        return
    for radio in arguments.radios:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name) if arguments.logs is None else arguments.logs / radio
            folder.mkdir(parents=True, exist_ok=True)
            measure(arguments, radio, folder)


if __name__ == '__main__':
    main()
