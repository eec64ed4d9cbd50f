"""Ten minutes of kills and stops of a payload's processes, under load and hostile messages.

    python benchmarks/fault_run.py [--minutes 10] [--seed 1] [--load 2]

``ftp-dent up`` runs the simulated payload. Its processes, and itself, are killed (SIGKILL) or
stopped for some seconds (SIGSTOP) in random order, each as soon as dents are published of a
photograph that was taken after the fault before; meanwhile busy loops take the processor, and
messages that cannot be come on every topic and on the autopilot's port. Every cloud, tag and dent
is held against the truth. Exit status 1 if one was wrong, a recovery took longer than 10 s, or
memory grew.

A recovery is work for the processor, most of it Python's start. A probe measures how much of the
processor one more thread gets, of what the busy loops leave: where others on the machine take more
than half of that, a longer recovery is told, and held against nobody.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from hostile_messages import TOPICS, hostile_message
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import PointCloud2
from tqdm import tqdm

from ftp_dent_ros.cli.demo import BOUNDS
from ftp_dent_ros.coding.messages import dents_from_message
from ftp_dent_ros.demonstration.appraisal import mean_absolute
from ftp_dent_ros.demonstration.flight import simulation_parameters
from ftp_dent_ros.dents.dent import KINDS
from ftp_dent_ros.errors import CloudError
from ftp_dent_ros.ros.messages import (
    cloud_from_message,
    covariance_from_message,
    ns_to_stamp,
    pose_from_message,
    stamp_to_ns,
)
from ftp_dent_ros.ros.qos import CLOUDS, DENTS, DIAGNOSTICS, LATCHED, POSES
from ftp_dent_ros.simulation.truth import true_dents, true_index
from ftp_dent_ros.simulation.world import World, read_world
from ftp_dent_ros.supervision.transport import free_domain

LONGEST_RECOVERY = 10.0
# Of what the busy loops leave: with less, others have the processor and a recovery is no measure.
_LEAST_SHARE = 0.5
# A recovery that takes longer than that is none, seconds.
_GIVEN_UP = 60.0
_LONGEST_STOP = 6.0
_HOSTILE_PERIOD = 0.2
# Beyond so many of its own stated standard deviations a tag or a dent's depth is wrong; a tag also
# so far off, metres: the scene's autopilot errs by 0.07 at most.
_DEVIATIONS, _FAR_OFF = 4.0, 0.1
# Memory of all processes at the end, over that after the first minute.
_GROWTH, _GROWTH_MB = 1.1, 50.0
_EVERY = 4
# Kinds that are told as dents; the others are told as something that is none.
_DENTS = ('dent', 'crease', 'gouge')
_UP = 'up'


@dataclass
class Findings:
    """What came, and what of it was wrong."""

    counts: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    worst: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    false: Counter[str] = field(default_factory=Counter)
    rivets: Counter[str] = field(default_factory=Counter)
    refused: dict[str, str] = field(default_factory=dict)

    def check(self, what: str, value: float, bound: float, stamp_ns: int) -> None:
        """Count one of `what`; it is wrong above `bound`, or if it is NaN."""
        self.counts[what] += 1
        self.worst[what] = max(self.worst[what], value)
        if not value <= bound:
            self.wrong.append(f'{what} of {stamp_ns / 1e9:.3f}: {value:.4g} (bound {bound:g})')


class Witness:
    """Sees all that the payload publishes, and sends what it should refuse."""

    def __init__(self, world: World, rng: random.Random) -> None:
        self.findings = Findings()
        self.last_dents = self._last_cloud = 0
        self._world, self._rng = world, rng
        self._truth = [true for true in true_dents(world.surface) if true.depth > 0]
        self._sent: dict[str, set[int]] = defaultdict(set)
        self._due = time.monotonic()
        self._node = rclpy.create_node('witness')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        subscribe = self._node.create_subscription
        subscribe(PointCloud2, 'points', self._on_points, CLOUDS)
        subscribe(PointCloud2, 'tagged/points', self._on_tagged, CLOUDS)
        subscribe(PoseWithCovarianceStamped, 'tagged/pose', self._on_pose, POSES)
        subscribe(PointCloud2, 'dents', self._on_dents, DENTS)
        subscribe(PointCloud2, 'dents/list', self._on_list, LATCHED)
        subscribe(DiagnosticArray, '/diagnostics', self._on_state, DIAGNOSTICS)
        self._enemies = {
            name: self._node.create_publisher(
                kind, name, LATCHED if name.startswith('projector') else 5
            )
            for name, kind in TOPICS.items()
        }

    def spin(self, seconds: float = 0.05) -> None:
        """Take what has come for so long, and send a hostile message now and then."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)
            if time.monotonic() > self._due:
                self._due = time.monotonic() + _HOSTILE_PERIOD
                stamp_ns = time.time_ns() - self._rng.randrange(10**9)
                topic, message = hostile_message(self._rng, stamp_ns)
                if topic == 'tagged/camera_pose' and self._last_cloud:
                    # In the place of the one that is about to come.
                    message.header.stamp = ns_to_stamp(self._last_cloud)
                self._sent[topic].add(stamp_ns)
                self._enemies[topic].publish(message)
                self.findings.counts['hostile messages'] += 1

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()

    def _stamp(self, message, topic: str, *sources: str) -> int:
        """Stamp of a message; 0 if it is our own. What came of our own is wrong."""
        stamp_ns = stamp_to_ns(message.header.stamp)
        if stamp_ns in self._sent[topic]:
            return 0
        for source in sources:
            if stamp_ns in self._sent[source]:
                self.findings.wrong.append(f'{topic} of what was wrong on {source}')
        return stamp_ns

    def _on_points(self, message: PointCloud2) -> None:
        if stamp_ns := self._stamp(message, 'points', 'camera/image_raw'):
            self._last_cloud = stamp_ns
            points = cloud_from_message(message).points[::_EVERY, ::_EVERY]
            error = self._world.seen_surface(stamp_ns).distance(points)
            self.findings.check('clouds', mean_absolute(error), BOUNDS['camera_mae_mm'], stamp_ns)

    def _on_tagged(self, message: PointCloud2) -> None:
        if stamp_ns := self._stamp(message, 'tagged/points', 'points', 'camera/image_raw'):
            points = cloud_from_message(message).points[::_EVERY, ::_EVERY]
            error = self._world.surface.distance(points)
            self.findings.check(
                'clouds in the map', mean_absolute(error), BOUNDS['map_mae_mm'], stamp_ns
            )

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        if stamp_ns := self._stamp(message, 'tagged/pose', 'points', 'camera/image_raw'):
            pose, true = pose_from_message(message.pose.pose), self._world.base_pose(stamp_ns)
            covariance = covariance_from_message(message.pose.covariance)
            off = pose.translation - true.translation
            turn = (pose.rotation * true.rotation.inv()).as_rotvec()
            deviations = np.abs([*off, *turn]) / np.sqrt(np.diag(covariance))
            self.findings.check('tags (mm)', 1e3 * np.linalg.norm(off), 1e3 * _FAR_OFF, stamp_ns)
            self.findings.check('tags (sd)', deviations.max(), _DEVIATIONS, stamp_ns)

    def _on_dents(self, message: PointCloud2) -> None:
        self.last_dents = max(
            self.last_dents, self._stamp(message, 'dents', 'tagged/points', 'points')
        )

    def _on_list(self, message: PointCloud2) -> None:
        try:
            dents = dents_from_message(message)
        except CloudError as error:
            self.findings.wrong.append(f'dents/list: {error}')
            return
        stamp_ns = stamp_to_ns(message.header.stamp)
        for dent in dents[dents['is_cut'] == 0]:
            place = np.array([dent[axis] for axis in 'xyz'])
            index, kind = self._true_index(place, dent), KINDS[dent['kind']]
            if index is None:
                where = ', '.join(f'{value:.3f}' for value in place)
                size = f'{1e3 * dent["depth"]:.3f} +- {1e3 * dent["depth_uncertainty"]:.3f} mm'
                found = self.findings.rivets if self._on_rivet(place) else self.findings.false
                found[f'{kind} at {where} m, {size}'] += 1
                continue
            off = abs(float(dent['depth']) - self._truth[index].depth)
            deviations = off / float(dent['depth_uncertainty'])
            self.findings.check(f'{kind}s in lists (mm)', 1e3 * off, np.inf, stamp_ns)
            self.findings.check(f'{kind}s in lists (sd)', deviations, _DEVIATIONS, stamp_ns)

    def _true_index(self, place: np.ndarray, dent: np.void) -> int | None:
        """The true dent at a place; else one as deep, as far off as the autopilot may err."""
        index = true_index(place, self._truth)
        if index is not None:
            return index
        most = _DEVIATIONS * float(dent['depth_uncertainty'])
        alike = [
            (float(np.linalg.norm(true.position - place)), number)
            for number, true in enumerate(self._truth)
            if abs(true.depth - float(dent['depth'])) <= most
        ]
        apart, number = min(alike, default=(np.inf, -1))
        return number if apart <= _FAR_OFF else None

    def _on_rivet(self, place: np.ndarray) -> bool:
        """Whether a rivet's head is within its own radius of a place."""
        for panel in self._world.surface.panels:
            x, y, _ = panel.pose.inverse().apply(place)
            near = panel.near(np.array([x]), np.array([y])).rivets
            if any(np.hypot(each.x - x, each.y - y) < 2 * each.radius for each in near):
                return True
        return False

    def _on_state(self, message: DiagnosticArray) -> None:
        for status in message.status:
            for item in status.values:
                if item.key.startswith('refused: ') or item.key == 'failed':
                    self.findings.refused[f'{status.name}, {item.key}'] = item.value


class Payload:
    """``ftp-dent up`` and its processes."""

    def __init__(self, configuration: Path, logs: Path) -> None:
        self._command = [
            *(sys.executable, '-m', 'ftp_dent_ros.cli.main', 'up', str(configuration)),
            *('--log-dir', str(logs)),
        ]
        self._log = logs / 'up.log'
        self.start()

    def start(self) -> None:
        """Start it, as whatever supervises it would."""
        with self._log.open('a') as log:
            self._up = subprocess.Popen(self._command, stdout=log, stderr=subprocess.STDOUT)

    def keep(self) -> None:
        """Start it again if it has ended."""
        if self._up.poll() is not None:
            self.start()

    def pids(self) -> dict[str, int]:
        """Process ids by name, of `_UP` too."""
        try:
            children = Path(f'/proc/{self._up.pid}/task/{self._up.pid}/children').read_text()
        except OSError:
            return {}
        found = {_UP: self._up.pid}
        for pid in map(int, children.split()):
            words = _read(f'/proc/{pid}/cmdline').split('\0')
            # Behind -m: a module of its own, or the nodes' and then its name.
            name = next((word for word in words if word.startswith('ftp_dent_ros.')), '')
            if name == 'ftp_dent_ros.nodes':
                name = words[words.index(name) + 1]
            if name:
                found[name.rpartition('.')[2]] = pid
        return found

    def memory(self) -> float:
        """Resident memory of all processes without what they share, MB."""
        pages = 0
        for pid in self.pids().values():
            words = _read(f'/proc/{pid}/statm').split()
            pages += int(words[1]) - int(words[2]) if words else 0
        return pages * os.sysconf('SC_PAGE_SIZE') / 1e6

    def stop(self) -> None:
        """End it."""
        self._up.send_signal(signal.SIGINT)
        self._up.wait(60)


def _read(path: str) -> str:
    try:
        return Path(path).read_text()
    except OSError:
        return ''


class Probe:
    """How much of the processor one more thread gets, of what the busy loops leave to it."""

    def __init__(self, load: int) -> None:
        self._fair = min(1.0, (os.cpu_count() or 1) / (load + 1))
        self._cpu, self._wall = (multiprocessing.Value('d', 0.0) for _ in range(2))
        self._process = multiprocessing.Process(target=self._run, daemon=True)
        self._process.start()

    def times(self) -> tuple[float, float]:
        """Processor and wall time of the probe's work so far, seconds."""
        return self._cpu.value, self._wall.value

    def share(self, before: tuple[float, float]) -> float:
        """What it got since then, of what it should; at most 1."""
        cpu, wall = (now - then for now, then in zip(self.times(), before, strict=True))
        return min(1.0, cpu / wall / self._fair) if wall else 1.0

    def kill(self) -> None:
        """End it."""
        self._process.kill()

    def _run(self) -> None:
        # Long enough for the scheduler to let others in, seldom enough to be no load itself.
        while True:
            cpu, wall = time.process_time(), time.monotonic()
            while time.process_time() < cpu + 0.02:
                pass
            self._cpu.value += time.process_time() - cpu
            self._wall.value += time.monotonic() - wall
            time.sleep(0.2)


def _spin_for_ever() -> None:
    for _ in itertools.count():
        pass


def fault(payload: Payload, witness: Witness, rng: random.Random, names: list[str]) -> str:
    """Kill or stop one process; what was done, after it is over."""
    if not names:
        names += [f'{how} {name}' for how in ('kill', 'stop') for name in payload.pids()]
        names.append('none')
        rng.shuffle(names)
    what = names.pop()
    if what == 'none':
        return what
    how, _, name = what.partition(' ')
    pid = payload.pids().get(name)
    if pid is None:
        return ''
    if how == 'kill':
        os.kill(pid, signal.SIGKILL)
        return what
    os.kill(pid, signal.SIGSTOP)
    end = time.monotonic() + rng.uniform(0.5, _LONGEST_STOP)
    while time.monotonic() < end:
        witness.spin()
    try:
        os.kill(pid, signal.SIGCONT)
    except ProcessLookupError:
        return ''
    return what


def recovery(payload: Payload, witness: Witness, limit: float = _GIVEN_UP) -> float:
    """Seconds until dents are published of a photograph that is taken from now on."""
    start, start_ns = time.monotonic(), time.time_ns()
    while witness.last_dents <= start_ns:
        payload.keep()
        witness.spin()
        if time.monotonic() - start > limit:
            return float('inf')
    return time.monotonic() - start


def run(payload: Payload, witness: Witness, probe: Probe, rng: random.Random, minutes: float):
    """Faults until the time is over: each recovery's seconds and share, and memory by minute."""
    times: dict[str, list[tuple[float, float]]] = defaultdict(list)
    memory: list[float] = []
    first = recovery(payload, witness, 2 * _GIVEN_UP)
    if first == float('inf'):
        raise SystemExit('the payload does not come to life: see its logs')
    names: list[str] = []
    start = time.monotonic()
    with tqdm(total=round(60 * minutes), unit='s', desc='faults', dynamic_ncols=True) as bar:
        while (passed := time.monotonic() - start) < 60 * minutes:
            bar.update(round(passed) - bar.n)
            what = fault(payload, witness, rng, names)
            if what:
                before = probe.times()
                seconds = recovery(payload, witness)
                times[what].append((seconds, probe.share(before)))
            if len(memory) < passed // 60:
                # All run again, and have done some work.
                memory.append(payload.memory())
            witness.spin(rng.uniform(0.2, 2.0))
    return times, memory


def report(times, memory: list[float], findings: Findings) -> list[str]:
    """Print the tables; what was not as it should be."""
    every = [each for pairs in times.values() for each in pairs]
    share = statistics.median(share for _, share in every)
    print(f'\nshare of the processor that others left: {share:.2f} (median)')
    print(f'\n{"seconds to recover":32}{"times":>7}{"median":>9}{"longest":>9}{"share":>9}')
    for what, pairs in sorted(times.items()):
        median = statistics.median(seconds for seconds, _ in pairs)
        longest, at = max(pairs)
        print(f'{what:32}{len(pairs):7}{median:9.1f}{longest:9.1f}{at:9.2f}')
    print(f'\n{"held against the truth":32}{"number":>7}{"worst":>9}')
    for what, worst in findings.worst.items():
        print(f'{what:32}{findings.counts[what]:7}{worst:9.4f}')
    print(f'{"hostile messages":32}{findings.counts["hostile messages"]:7}')
    print(f'memory by minute (MB): {", ".join(f"{each:.0f}" for each in memory)}')
    troubles = list(findings.wrong)
    for what, count in findings.false.items():
        line = f'nothing is there: {what}, in {count} lists'
        if what.startswith(_DENTS):
            troubles.append(line)
        else:
            print(line)
    for what, count in findings.rivets.items():
        line = f'on a rivet: {what}, in {count} lists'
        if what.startswith(_DENTS):
            troubles.append(line)
        else:
            print(line)
    troubles += [
        f'recovery from {what}: {seconds:.1f} s at a share of {share:.2f}'
        for what, pairs in times.items()
        for seconds, share in pairs
        if seconds > LONGEST_RECOVERY and (share >= _LEAST_SHARE or seconds == float('inf'))
    ]
    late = sum(seconds > LONGEST_RECOVERY for seconds, _ in every)
    print(f'recoveries of more than {LONGEST_RECOVERY:g} s: {late}')
    if len(memory) > 1 and memory[-1] > _GROWTH * memory[0] + _GROWTH_MB:
        troubles.append(f'memory grew from {memory[0]:.0f} to {memory[-1]:.0f} MB')
    for name, value in sorted(findings.refused.items()):
        if name.endswith('failed') and value != '0':
            print(f'{name}: {value}')
    for trouble in troubles[:20]:
        print(f'WRONG: {trouble}')
    print(f'{len(every) - len(times.get("none", ()))} faults, {len(troubles)} troubles')
    return troubles


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--minutes', type=float, default=10.0)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--load', type=int, default=os.cpu_count(), help='busy loops')
    parser.add_argument('--keep', type=Path, help='folder to which the logs are copied')
    arguments = parser.parse_args()
    rng = random.Random(arguments.seed)
    blocks = simulation_parameters('shipped:simulation.yaml', time.time_ns())
    parameters = {name: block['ros__parameters'] for name, block in blocks.items()}
    parameters['dent_inspector']['always'] = True
    camera = parameters['camera_capture']
    # The simulation of a photograph takes more of the processor than all the rest.
    camera['rate'] = 1.0
    world = read_world(camera['simulation.scene'], camera['simulation.start_ns'])
    loops = [multiprocessing.Process(target=_spin_for_ever) for _ in range(arguments.load)]
    with tempfile.TemporaryDirectory(prefix='fault_run.') as folder:
        configuration = Path(folder) / 'payload.yaml'
        configuration.write_text(yaml.safe_dump(blocks))
        logs = Path(folder) / 'log'
        logs.mkdir()
        with free_domain():
            rclpy.init(args=[])
            payload, witness = Payload(configuration, logs), Witness(world, rng)
            probe = Probe(arguments.load)
            for loop in loops:
                loop.start()
            try:
                times, memory = run(payload, witness, probe, rng, arguments.minutes)
            finally:
                for each in (*loops, probe):
                    each.kill()
                payload.stop()
                witness.close()
                rclpy.try_shutdown()
                if arguments.keep:
                    shutil.copytree(logs, arguments.keep, dirs_exist_ok=True)
    return bool(report(times, memory, witness.findings))


if __name__ == '__main__':
    sys.exit(main())
