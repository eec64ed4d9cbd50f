"""``ftp-dent preflight``: whether a running payload is fit to take off with."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.time import Time

from ftp_dent_ros.calibration.preflight import NO, OK, WARN, Finding, examine, sharpness
from ftp_dent_ros.dents.dent import SmallestDent as Smallest
from ftp_dent_ros.errors import CameraError, ConfigurationError
from ftp_dent_ros.files import find, nearest_folder
from ftp_dent_ros.parameters import flat
from ftp_dent_ros.pattern.drawn import pattern_from_image
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.ros.photographer import Photographer
from ftp_dent_ros.ros.qos import DIAGNOSTICS
from ftp_dent_ros.ros.session import session
from ftp_dent_ros.supervision.configuration import NodeEntry, read_configuration

# No projector is later, nanoseconds.
_SETTLED_NS = 200_000_000
# Tries until a picture shows what is projected, and the contrast from which on it shows fringes.
_RETAKES, _FRINGES = 5, 0.3
# Every node tells its state once a second; within so many seconds of its start it has (s).
_HEARD = 10.0
# A stamp is that old at most when its photograph arrives, seconds.
_LATEST = 2.0
_LEVEL = {OK: '  ok ', WARN: 'WARN ', NO: 'NO GO'}
# Last state of every node, and its time, ns.
States = dict[str, tuple[int, DiagnosticStatus]]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument('configuration', metavar='CONFIG.yaml', help='of the running payload')
    parser.add_argument(
        '--bags', type=Path, default=Path(), metavar='DIR', help='where bags will go; default: .'
    )


def run(arguments: argparse.Namespace) -> int:
    """Check, say, and judge: 0 go, 1 no go."""
    entries = {entry.executable: entry for entry in read_configuration(arguments.configuration)}
    for name in ('pattern_publisher', 'camera_capture', 'reconstruction'):
        if name not in entries:
            raise ConfigurationError(f'{arguments.configuration}: runs no {name}: add it')
    namespace = entries['reconstruction'].namespace
    remap = ['-r', f'__ns:={namespace}'] if namespace != '/' else []
    with session('preflight', remap) as (node, stop):
        states = _listen(node)
        photographer = Photographer(node, stop)
        try:
            photographer.waited_for(lambda: all(_heard(states, entries)), _HEARD)
            size = photographer.projector_size()
            findings = _photographs(photographer, size, entries)
            # What a node said before it saw the pattern tells nothing of it now.
            end = photographer.now_ns()
            photographer.waited_for(lambda: all(_heard(states, entries, end)), _HEARD)
        except CameraError as reason:
            findings = [Finding('payload', NO, str(reason))]
        finally:
            photographer.close()
    findings += _nodes(states, entries)
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


def _photographs(
    photographer: Photographer, size: tuple[int, int], entries: Mapping[str, NodeEntry]
) -> list[Finding]:
    pattern = pattern_from_image(photographer.projected())
    rig = read_rig(find(_parameter(entries['reconstruction'], 'rig', '')))
    pattern.check_fits(rig.projector)
    stride = int(_parameter(entries['reconstruction'], 'stride', Settings().stride))
    reconstructor = Reconstructor(rig, pattern, Settings(stride=stride))
    white, _ = photographer.photograph(
        photographer.show(_even(size, 254)) + _SETTLED_NS, colour=True
    )
    shown = photographer.show(_even(size, 0)) + _SETTLED_NS
    black = _retaken(photographer, shown, lambda image: image.mean() < white.mean())
    drawn = pattern.draw()
    shown = photographer.show(drawn) + _SETTLED_NS
    _retaken(photographer, shown, lambda image: sharpness(white, black, image, drawn) >= _FRINGES)
    fringes, ages = [], []
    # For the flicker.
    for _ in range(6):
        image, stamp_ns = photographer.photograph(shown, colour=True)
        ages.append((photographer.now_ns() - stamp_ns) / 1e9)
        fringes.append(image)
    exposure = float(_parameter(entries['camera_capture'], 'device.exposure', 0.0))
    smallest = _smallest(entries.get('dent_inspector'))
    findings = examine(rig, pattern, white, black, fringes, reconstructor, exposure, smallest)
    simulated = _parameter(entries['camera_capture'], 'source', '') == 'simulation'
    return [*findings, _clock(float(np.median(ages)), simulated)]


def _clock(age: float, simulated: bool) -> Finding:
    """Whether the stamps are of this computer's clock, by how old they are when they arrive."""
    text = f'photographs are {1e3 * age:.0f} ms old when they arrive'
    if simulated and age >= 0:
        return Finding('clock', OK, f"{text}, rendered by this computer's own clock")
    if -0.01 <= age <= _LATEST:
        return Finding('clock', OK, text)
    advice = 'set the clock of the camera and of this computer alike, and let nothing else run'
    return Finding('clock', NO, f'{text}: {advice}')


def _retaken(
    photographer: Photographer, shown: int, right: Callable[[NDArray[np.uint8]], bool]
) -> NDArray[np.uint8]:
    """Photograph of what is shown; a projector or a camera that is late gets some tries more."""
    for _ in range(_RETAKES):
        image, _ = photographer.photograph(shown, colour=True)
        if right(image):
            break
    return image


def _listen(node: Node) -> States:
    """Last state of every node and its time (ns), by its name, as they come."""
    states: States = {}

    def on_array(array: DiagnosticArray) -> None:
        stamp = Time.from_msg(array.header.stamp).nanoseconds
        states.update({status.name: (stamp, status) for status in array.status})

    node.create_subscription(DiagnosticArray, '/diagnostics', on_array, DIAGNOSTICS)
    return states


def _heard(states: States, entries: Mapping[str, NodeEntry], since_ns: int = 0) -> Iterable[bool]:
    """Of every node that tells its state, whether it has since a moment."""
    telling = (e.name for e in entries.values() if e.executable != 'simulated_autopilot')
    return (name in states and states[name][0] >= since_ns for name in telling)


def _nodes(states: States, entries: Mapping[str, NodeEntry]) -> list[Finding]:
    findings = []
    for entry in entries.values():
        if entry.executable == 'simulated_autopilot':
            continue
        if entry.name not in states:
            findings.append(Finding(entry.name, NO, 'says nothing: is it running?'))
            continue
        _, state = states[entry.name]
        verdict = OK
        if state.level == DiagnosticStatus.ERROR:
            verdict = NO
        elif state.level == DiagnosticStatus.WARN and 'projector/show' not in state.message:
            verdict = NO if entry.executable == 'mavlink_bridge' else WARN
        findings.append(Finding(entry.name, verdict, state.message))
    return findings


def _disk(folder: Path) -> Finding:
    free = shutil.disk_usage(nearest_folder(folder / 'bag')).free
    minutes = free / 15e6 / 60
    # A flight's bag takes some 15 MB a second: half an hour, ten minutes.
    verdict = OK if free > 27e9 else WARN if free > 9e9 else NO
    return Finding('disk', verdict, f'{free / 1e9:.0f} GB free, some {minutes:.0f} minutes of bag')


def _parameter(entry: NodeEntry, name: str, default: Any) -> Any:
    """A parameter of an entry, written flat or nested."""
    for block in (entry.absolute, entry.parameters, entry.shared):
        values = dict(flat(block))
        if name in values:
            return values[name]
    return default


def _smallest(entry: NodeEntry | None) -> Smallest:
    """The smallest dent that the payload looks for."""
    if entry is None:
        return Smallest()
    return Smallest(
        **{
            each.name: float(_parameter(entry, each.name, each.default))
            for each in fields(Smallest)
        }
    )


def _even(size: tuple[int, int], level: int) -> np.ndarray:
    return np.full((size[1], size[0], 3), level, np.uint8)
