"""``ftp-dent preflight``: whether a running payload is fit to take off with."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from rclpy.time import Time

from ftp_dent_ros.calibration.preflight import NO, OK, WARN, Finding, examine
from ftp_dent_ros.cli import argument
from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.errors import CameraError, ConfigurationError
from ftp_dent_ros.files import nearest_folder
from ftp_dent_ros.nodes.settings import settings_of
from ftp_dent_ros.pattern.drawn import pattern_from_image
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.ros.photographer import Photographer
from ftp_dent_ros.ros.qos import DIAGNOSTICS
from ftp_dent_ros.ros.session import session
from ftp_dent_ros.supervision.configuration import NodeEntry, read_configuration
from ftp_dent_ros.supervision.executables import SIMULATED_AUTOPILOT

# No projector is later, nanoseconds.
_SETTLED_NS = 200_000_000
# Every node tells its state once a second; within so many seconds of its start it has (s).
_HEARD = 10.0
# A stamp is that old at most when its photograph arrives, seconds.
_LATEST = 2.0
_LEVEL = {OK: '  ok ', WARN: 'WARN ', NO: 'NO GO'}
# Last state of every node, and its time, ns.
States = dict[str, tuple[int, DiagnosticStatus]]


ARGUMENTS = (
    argument('configuration', metavar='CONFIG.yaml', help='of the running payload'),
    argument(
        '--bags', type=Path, default=Path(), metavar='DIR', help='where bags will go; default: .'
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Check, say, and judge: 0 go, 1 no go."""
    entries = {entry.executable: entry for entry in read_configuration(arguments.configuration)}
    for name in ('pattern_publisher', 'camera_capture', 'reconstruction'):
        if name not in entries:
            raise ConfigurationError(f'{arguments.configuration}: runs no {name}: add it')
    # Every other tells its state.
    telling = {e.name: e for e in entries.values() if e.executable != SIMULATED_AUTOPILOT}
    namespace = entries['reconstruction'].namespace
    remap = ['-r', f'__ns:={namespace}'] if namespace != '/' else []
    with (
        session('preflight', remap) as (node, stop),
        closing(Photographer(node, stop, colour=True)) as photographer,
    ):
        states = _listen(node)
        photographer.delay_ns = _SETTLED_NS
        try:
            photographer.waited_for(lambda: _heard(states, telling), _HEARD)
            findings = _photographs(photographer, entries)
            # What a node said before it saw the pattern tells nothing of it now.
            end = photographer.now_ns()
            photographer.waited_for(lambda: _heard(states, telling, end), _HEARD)
        except CameraError as reason:
            findings = [Finding('payload', NO, str(reason))]
    findings += [_judged(entry, states) for entry in telling.values()]
    findings.append(_disk(arguments.bags))
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        print(f'{_LEVEL[finding.verdict]}  {finding.name:{width}}  {finding.text}')
    reasons = [finding for finding in findings if finding.verdict == NO]
    if reasons:
        print(f'\nNO GO: {reasons[0].name}: {reasons[0].text}')
        return 1
    print('\nGO')
    return 0


def _photographs(photographer: Photographer, entries: Mapping[str, NodeEntry]) -> list[Finding]:
    width, height = photographer.projector_size()
    pattern = pattern_from_image(photographer.projected())
    camera, reconstruction = (
        settings_of(entries[name]) for name in ('camera_capture', 'reconstruction')
    )
    rig = reconstruction.rig
    if rig is None:
        where = entries['reconstruction'].file
        raise ConfigurationError(f'{where}: reconstruction has no rig: set the parameter rig')
    pattern.check_fits(rig.projector)
    reconstructor = Reconstructor(rig, pattern, Settings(stride=reconstruction.stride))
    even = (np.full((height, width, 3), level, np.uint8) for level in (254, 0))
    white, black = map(photographer.take, even)
    photographer.take(pattern.draw())
    fringes, ages = [], []
    # For the flicker.
    for _ in range(6):
        image, stamp_ns = photographer.photograph(0)
        ages.append((photographer.now_ns() - stamp_ns) / 1e9)
        fringes.append(image)
    exposure, smallest = camera.exposure, SmallestDent()
    if 'dent_inspector' in entries:
        given = settings_of(entries['dent_inspector'])
        smallest = SmallestDent(given.smallest_depth, given.smallest_width)
    findings = examine(rig, pattern, white, black, fringes, reconstructor, exposure, smallest)
    return [*findings, _clock(float(np.median(ages)), camera.source == 'simulation')]


def _clock(age: float, simulated: bool) -> Finding:
    """Whether the stamps are of this computer's clock, by how old they are when they arrive."""
    text = f'photographs are {1e3 * age:.0f} ms old when they arrive'
    # What is simulated takes its time, by this computer's own clock.
    if age >= 0 if simulated else -0.01 <= age <= _LATEST:
        return Finding('clock', OK, text)
    advice = 'set the clock of the camera and of this computer alike, and let nothing else run'
    return Finding('clock', NO, f'{text}: {advice}')


def _listen(node: Node) -> States:
    """Last state of every node and its time (ns), by its name, as they come."""
    states: States = {}

    def on_array(array: DiagnosticArray) -> None:
        stamp = Time.from_msg(array.header.stamp).nanoseconds
        states.update({status.name: (stamp, status) for status in array.status})

    node.create_subscription(DiagnosticArray, '/diagnostics', on_array, DIAGNOSTICS)
    return states


def _heard(states: States, names: Iterable[str], since_ns: int = 0) -> bool:
    """Whether every node has published its state since a moment."""
    return all(name in states and states[name][0] >= since_ns for name in names)


def _judged(entry: NodeEntry, states: States) -> Finding:
    """What a node says of itself."""
    if entry.name not in states:
        return Finding(entry.name, NO, 'says nothing: is it running?')
    _, state = states[entry.name]
    verdict = OK
    if state.level == DiagnosticStatus.ERROR:
        verdict = NO
    elif state.level == DiagnosticStatus.WARN and 'projector/show' not in state.message:
        verdict = NO if entry.executable == 'mavlink_bridge' else WARN
    return Finding(entry.name, verdict, state.message)


def _disk(folder: Path) -> Finding:
    free = shutil.disk_usage(nearest_folder(folder / 'bag')).free
    minutes = free / 15e6 / 60
    # A flight's bag takes some 15 MB a second: half an hour, ten minutes.
    verdict = OK if free > 27e9 else WARN if free > 9e9 else NO
    return Finding('disk', verdict, f'{free / 1e9:.0f} GB free, some {minutes:.0f} minutes of bag')
