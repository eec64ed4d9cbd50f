"""A demonstration: the payload flown in simulation as processes, and the pictures it leaves."""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, Image

from ftp_dent_ros.capture.source import write_rendered
from ftp_dent_ros.coding.images import image_from_message
from ftp_dent_ros.demonstration.appraisal import clouds_of
from ftp_dent_ros.errors import ConfigurationError, FtpDentError
from ftp_dent_ros.files import find, write_atomically, write_png
from ftp_dent_ros.fleet import side_by_side
from ftp_dent_ros.nodes.settings import fitted
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.recording.reader import Bag
from ftp_dent_ros.rig.rig import Rig, read_rig
from ftp_dent_ros.ros.messages import stamp_to_ns
from ftp_dent_ros.ros.qos import DIAGNOSTICS, IMAGES, POSES
from ftp_dent_ros.simulation.surface import Surface
from ftp_dent_ros.simulation.world import World, read_world
from ftp_dent_ros.supervision.configuration import read_configuration
from ftp_dent_ros.supervision.executables import EXECUTABLES, OPTIONAL
from ftp_dent_ros.supervision.processes import Processes, ProcessLog, Program
from ftp_dent_ros.supervision.transport import free_domain

# Until everything is discovered and the clocks are matched, on a slow and busy machine.
_READY_S = 120.0
_SETTLED_S = 1.0
# Until camera and autopilot are known to all, whole seconds, twice what a busy machine takes. On
# one that takes longer the first photographs are left out, or have no pose.
_START_S = 6
_CAMERA = 'camera_capture'
_RECORDER = 'recorder'
_AUTOPILOT = 'simulated_autopilot'


class FlightError(FtpDentError):
    """The payload did not come to life, or one of its processes ended."""


def simulation_parameters(configuration: str, start_ns: int = 0) -> dict[str, Any]:
    """Blocks of a configuration, with a free port and the start of the flight filled in."""
    entries = read_configuration(configuration)
    missing = set(EXECUTABLES) - OPTIONAL - {entry.name for entry in entries}
    if missing:
        raise ConfigurationError(
            f'{configuration}: has no {" and no ".join(sorted(missing))}: name the '
            'configuration of a whole simulated payload, as shipped:simulation.yaml is'
        )
    entries = fitted(entries)
    parameters = {entry.name: {**entry.parameters, **entry.absolute} for entry in entries}
    port = _free_port()
    parameters['mavlink_bridge']['address'] = f'udpin:127.0.0.1:{port}'
    parameters['simulated_autopilot']['address'] = f'udpout:127.0.0.1:{port}'
    parameters['simulated_autopilot']['start_ns'] = start_ns
    parameters[_CAMERA]['simulation.start_ns'] = start_ns
    return {name: {'ros__parameters': values} for name, values in parameters.items()}


def render_ahead(
    blocks: dict[str, Any], folder: Path, count: int, progress: Callable[[], Any]
) -> None:
    """Render the first photographs of a flight on all cores, for the camera to take in flight.

    Parameters
    ----------
    blocks : dict
        From `simulation_parameters`; the camera's block then names the folder.
    folder : Path
    count : int
    progress : callable
        Called after each photograph.
    """
    folder.mkdir()
    camera, projector = (
        blocks[name]['ros__parameters'] for name in (_CAMERA, 'pattern_publisher')
    )
    files = camera['simulation.scene'], camera['rig'], projector['pattern']
    render = partial(_render, files, camera['rate'], folder)
    for _, outcome in side_by_side(render, range(count), os.cpu_count() or 1):
        if isinstance(outcome, Exception):
            raise outcome
        progress()
    camera['simulation.ahead'] = str(folder)


@lru_cache(maxsize=1)
def _simulated(files: tuple[str, str, str]) -> tuple[World, Rig, NDArray[np.uint8]]:
    scene, rig, pattern = files
    return read_world(scene), read_rig(find(rig)), read_pattern(find(pattern)).draw()


def _render(files: tuple[str, str, str], rate: float, folder: Path, number: int) -> None:
    world, rig, projected = _simulated(files)
    photograph = world.photograph(rig, projected, number * round(1e9 / rate))
    write_rendered(folder, number, photograph)


def fly(
    folder: Path,
    blocks: dict[str, Any],
    clouds: int,
    meanwhile: Callable[[], None],
    progress: Callable[[int], None],
    say: Callable[[str], None],
) -> Path:
    """Fly until so many clouds are tagged; ends with all that was photographed being tagged.

    Parameters
    ----------
    folder : Path
        Takes the configuration, the processes' logs and the bag.
    blocks : dict
        From `simulation_parameters`; the start of the flight is written into them.
    clouds : int
        Tagged clouds to wait for.
    meanwhile : callable
        Called once, while the processes come to life.
    progress : callable
        Called with the number of tagged clouds so far.
    say : callable
        Called with a line for the user.

    Returns
    -------
    Path
        The bag.

    Raises
    ------
    FlightError
        The payload did not come to life, or a process ended; its last words are in the message.
    """
    configuration, bag, logs = folder / 'payload.yaml', folder / 'bag', folder / 'log'

    def programs() -> dict[str, Program]:
        configuration.write_text(yaml.safe_dump(blocks, sort_keys=False), encoding='utf-8')
        return {entry.name: entry.program for entry in read_configuration(configuration)}

    record = ('-m', 'ftp_dent_ros.cli.main', 'record', '--all', '--output', str(bag))
    first = {**programs(), _RECORDER: Program(_RECORDER, (sys.executable, *record))}
    with (
        free_domain(),
        open(os.devnull, 'w') as quiet,
        ProcessLog(tuple(first), folder=logs, terminal=quiet) as log,
        Processes(log.show) as processes,
        _observer(processes, logs) as observer,
    ):
        say(f'starting {len(first)} processes')
        for name, program in first.items():
            if name not in (_CAMERA, _AUTOPILOT):
                processes.start(program)
        meanwhile()
        observer.until(observer.is_ready, 'reconstruction is not ready')
        # The photographs are of the flight's first seconds: it starts when all can be there.
        start_ns = time.time_ns() + _START_S * 1_000_000_000
        blocks[_CAMERA]['ros__parameters']['simulation.start_ns'] = start_ns
        blocks[_AUTOPILOT]['ros__parameters']['start_ns'] = start_ns
        last = programs()
        for name in (_AUTOPILOT, _CAMERA):
            processes.start(last[name])
        say('the pattern is projected: photographing')
        while observer.tagged < clouds:
            observer.wait_for_another()
            progress(observer.tagged)
        processes.stop(_CAMERA)
        observer.drain()
        progress(observer.tagged)
        processes.stop(_RECORDER)
    return bag


class _Observer:
    """Counts what the payload does, from a context of its own."""

    def __init__(self, node: Any, executor: Any, processes: Processes, logs: Path) -> None:
        self.tagged = self._last_image = self._last_tagged = 0
        self._executor, self._processes, self._logs = executor, processes, logs
        node.create_subscription(CameraInfo, '/camera/camera_info', self._on_image, IMAGES)
        node.create_subscription(PoseWithCovarianceStamped, '/tagged/pose', self._on_tagged, POSES)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_state, DIAGNOSTICS)
        self._state: dict[str, bytes] = {}

    def until(self, condition: Callable[[], bool], trouble: str) -> None:
        """Spin until `condition`; a process that ends or a timeout raises `FlightError`."""
        end = time.monotonic() + _READY_S
        while not condition():
            self._executor.spin_once(timeout_sec=0.1)
            for ended in self._processes.ended():
                log = self._logs / f'{ended.program.name}.log'
                words = ['none', *log.read_text(errors='replace').strip().splitlines()]
                raise FlightError(f'{ended}; its last words: {words[-1]}')
            if time.monotonic() > end:
                raise FlightError(f'{trouble} within {_READY_S:g} s: see the logs in {self._logs}')

    def is_ready(self) -> bool:
        """Whether the reconstruction knows the pattern, and waits for images."""
        return self._state.get('reconstruction') == DiagnosticStatus.OK

    def wait_for_another(self) -> None:
        """Wait until one more cloud is tagged."""
        before = self.tagged
        self.until(lambda: self.tagged > before, 'no more tagged clouds')

    def drain(self) -> None:
        """Wait until the last photograph's cloud is tagged; what is missing then is lost."""
        with suppress(FlightError):
            # The last photograph itself may still be on its way here.
            self._pause()
            self.until(lambda: self._last_tagged >= self._last_image, 'it is not tagged')
            # A cloud takes longer to the recorder than its pose does to here.
            self._pause()

    def _pause(self) -> None:
        end = time.monotonic() + _SETTLED_S
        self.until(lambda: time.monotonic() > end, 'time stands still')

    def _on_state(self, message: DiagnosticArray) -> None:
        self._state |= {status.name: status.level for status in message.status}

    def _on_image(self, message: CameraInfo) -> None:
        self._last_image = stamp_to_ns(message.header.stamp)

    def _on_tagged(self, message: PoseWithCovarianceStamped) -> None:
        self.tagged += 1
        self._last_tagged = stamp_to_ns(message.header.stamp)


@contextmanager
def _observer(processes: Processes, logs: Path) -> Iterator[_Observer]:
    context = rclpy.Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)
    node = rclpy.create_node('demonstration', context=context)
    executor.add_node(node)
    try:
        yield _Observer(node, executor, processes, logs)
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


# What the payload promises in this simulation: how many, and millimetres. A busy machine may leave
# photographs out, which is shown.
BOUNDS = {
    'images_lost': 0,
    'tagged_clouds_lost': 0,
    'camera_mae_mm': 0.1,
    # By the autopilot's poses, which err as a real one's: 7 cm and 1.1 degrees at most.
    'map_mae_mm': 100.0,
    'skin_mae_mm': 0.1,
    'clouds_not_inspected': 0,
    'dents_missed': 0,
    'sightings_missed': 0,
    'dents_false': 0,
}


def view_3d(
    path: Path,
    points: NDArray[np.float64],
    dent_depth: NDArray[np.float64],
    flight: Sequence[Pose],
) -> None:
    """Draw tagged points and the drone's path in the map.

    Parameters
    ----------
    path : Path
        Where the picture goes.
    points : ndarray, shape (n, 3)
        Points in ``map`` (ENU), metres.
    dent_depth : ndarray, shape (n,)
        How far each point lies behind the undented skin, metres: its colour.
    flight : sequence of Pose
        Poses of ``base_link`` in ``map``, in the order of time.
    """
    positions = np.array([pose.translation for pose in flight])
    forward = np.array([pose.rotation.apply((1, 0, 0)) for pose in flight])
    figure = Figure(figsize=(10, 4.8))
    # Matplotlib's annotations know of no third dimension.
    axes: Any = figure.add_axes((0.0, 0.0, 0.88, 0.95), projection='3d', computed_zorder=False)
    limit = float(np.percentile(dent_depth, 99.9)) * 1e3
    colours = axes.scatter(
        *points.T, c=dent_depth * 1e3, s=0.6, cmap='turbo', vmin=-0.1, vmax=limit, linewidths=0
    )
    axes.plot(*positions.T, color='black', linewidth=1.2, label="the drone's path and nose")
    axes.quiver(*positions.T, *(0.12 * forward).T, color='black', linewidth=0.6)
    every = np.concatenate([points, positions])
    axes.set_box_aspect(np.maximum(np.ptp(every, axis=0), 0.2), zoom=1.7)
    axes.set(xlabel='east, m', ylabel='north, m', zlabel='up, m')
    axes.locator_params(axis='z', nbins=3)
    figure.suptitle('The skin by its own poses, coloured by depth behind the undented one')
    # From behind the drone, a little to the side and above.
    behind = np.degrees(np.arctan2(*-forward.mean(axis=0)[[1, 0]]))
    axes.view_init(elev=18, azim=behind + 30)
    axes.legend(loc='upper left', bbox_to_anchor=(0.05, 0.95))
    scale = figure.add_axes((0.9, 0.2, 0.015, 0.6))
    figure.colorbar(colours, cax=scale, label='depth, mm')
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=110)


def write_results(bag: Bag, world: World, poses: Mapping[int, Pose], folder: Path) -> None:
    """Write pictures of a recorded flight into `folder`: its middle photograph, and its skin.

    `poses` are the cameras' by the skin, put onto the true one, by the clouds' stamps.
    """
    photographs = list(bag.messages(['/camera/image_raw']))
    message = deserialize_message(photographs[len(photographs) // 2].data, Image)
    write_png(folder / 'camera.png', image_from_message(message)[..., ::-1])
    every = []
    for stamp, cloud in clouds_of(bag):
        if stamp in poses:
            points = cloud.points[cloud.valid].astype(np.float64)
            # As many points as a 3-D picture of this size can show.
            step = max(1, len(points) * len(poses) // 120_000)
            every.append(poses[stamp].apply(points[::step]))
    skin = np.concatenate(every)
    undented = Surface(tuple(replace(panel, dents=()) for panel in world.surface.panels))
    flight = [world.base_pose(stamp) for stamp in poses]
    view_3d(folder / 'view_3d.png', skin, undented.distance(skin), flight)


#: The figures as people read them, a line each: those that matter most first.
SUMMARY = """\
exposure to tagged cloud  {latency_median_ms:.0f} ms median, {latency_maximum_ms:.0f} ms at most
dents in view             {dents}, missed {dents_missed}, false {dents_false}
largest error of a dent   depth {depth_error_mm:.3f} mm, length {length_error_mm:.2f} mm, \
width {width_error_mm:.2f} mm
error of the clouds       {camera_mae_mm:.4f} mm mean, worst cloud {camera_mae_worst_mm:.4f} mm
error of the joined skin  {skin_mae_mm:.4f} mm mean, worst cloud {skin_mae_worst_mm:.4f} mm
by the autopilot's poses  {map_mae_mm:.1f} mm mean, worst cloud {map_mae_worst_mm:.1f} mm
images                    {images}, lost {images_lost}
clouds                    {clouds}, not inspected {clouds_not_inspected}; left out because this \
machine was busy {clouds_lost}
tagged clouds             {tagged_clouds}, lost {tagged_clouds_lost}
sightings of dents        {sightings}, missed {sightings_missed}
listed as others          {others}
parts of the skin         {skin_parts}"""
