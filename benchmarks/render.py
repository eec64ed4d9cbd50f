"""Time to render a photograph of the shipped rig, 1280 x 720, on one core.

python benchmarks/render.py [--repeats 9]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import read_rig
from ftp_dent_ros.simulation import Dent, Paint, Panel, Renderer, Rivet, Surface
from ftp_dent_ros.simulation.world import read_world

AHEAD = Pose(Rotation.from_euler('xyz', [0.02, -0.03, 0.0]), np.array([0, 0, 0.8]))
EXTENT = (-1.0, 1.0, -1.0, 1.0)
DENTS = (Dent(0.02, 0.01, 0.1, 0.08, 0.003), Dent(-0.09, -0.04, 0.06, 0.04, 0.002, 0.5))
RIVETS = tuple(Rivet(0.025 * i, 0.09) for i in range(-14, 15))


def median_time(work: Callable[[int], object], repeats: int) -> float:
    """Seconds; the first time, which fills caches, is left out."""
    times = []
    for index in range(repeats + 1):
        start = time.perf_counter()
        work(index)
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--repeats', type=int, default=9)
    repeats = parser.parse_args().repeats
    cv2.setNumThreads(1)
    rig, pattern = (
        read_rig(find('shipped:rig.yaml')),
        read_pattern(find('shipped:pattern.yaml')).draw(),
    )
    renderer = Renderer(rig, pattern)
    rng = np.random.default_rng(0)
    surfaces = {
        'flat': Surface((Panel(AHEAD, EXTENT),)),
        'cylinder, 2 dents, 29 rivets, gloss': Surface(
            (Panel(AHEAD, EXTENT, 2.0, Paint(roughness=0.3), DENTS, RIVETS),)
        ),
    }
    results = {
        name: median_time(lambda _, surface=surface: renderer.render(surface, rng), repeats)
        for name, surface in surfaces.items()
    }
    world = read_world('shipped:scene.yaml')
    results['shipped scene as the simulated camera flies by'] = median_time(
        lambda index: world.photograph(rig, pattern, index * 1_700_000_000), repeats
    )
    for name, seconds in results.items():
        print(f'{name:50}{1e3 * seconds:6.0f} ms')


if __name__ == '__main__':
    main()
