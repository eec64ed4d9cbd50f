"""Scenes of many kinds under the pattern that is told: none may be refused for another one.

python benchmarks/right_pattern.py [--scenes 100] [--first 0] [--method least-squares] [--ratio 1]
                                    [--code contrast] [--moved 5]

Rigs, distances, tilts of up to 40 degrees, radii, steps and panels whose rims run straight along
the fringes are drawn at random, a scene a seed. With --ratio the pattern is told with so many
times its period, with --moved with its zero so many pixels elsewhere: then the scenes that are
not refused are those of which one photograph cannot tell; "remarked" if that is said, "off its
rows" if the light is farther beside its epipolar lines than a true rig and pattern bring it.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ftp_dent_ros.errors import OtherPatternError, RefusedFrameError
from ftp_dent_ros.evaluation.scenes import PATTERN, make_rig
from ftp_dent_ros.pattern.pattern import CODES, Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.profilometry.rig_alarm import off
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation import Dent, Panel, Photometry, Renderer, Surface

CAMERA = 960, 600


def draw(
    rng: np.random.Generator, pattern: Pattern
) -> tuple[str, Rig, Surface, NDArray[np.uint8]]:
    """Kind of the scene, its rig, surface and photograph."""
    distance = rng.uniform(0.4, 1.4)
    field = rng.uniform(0.35, 0.75)  # what the camera sees, of its distance
    rig = make_rig(
        distance * rng.uniform(0.95, 1.05),
        distance * rng.uniform(0.2, 0.45),
        (*CAMERA, CAMERA[0] / field),
        PATTERN.width / rng.uniform(0.45, 0.8),
    )
    kind = rng.choice(['wide', 'panel', 'along the fringes', 'step', 'cylinder'])
    tilt = rng.uniform(-0.25, 0.25, 2)
    if rng.random() < 0.4:
        tilt[rng.integers(2)] = rng.choice([-1, 1]) * math.radians(rng.uniform(20, 40))
    roll, x, y = 0.0, 0.0, 0.0
    half = np.array([3.0, 3.0])
    if kind == 'panel':
        half = field * distance * rng.uniform(0.12, 0.5, 2)
        roll = rng.uniform(-0.3, 0.3)
        x, y = rng.uniform(-0.03, 0.03, 2)
    elif kind == 'along the fringes':
        # Upright rims, to the left and the right of the stripe, as far from it or not.
        half = np.array([field * distance * rng.uniform(0.12, 0.5), rng.choice([0.1, 3.0])])
        tilt[0], x = 0.0, rng.choice([0.0, rng.uniform(-0.03, 0.03)])
    radius = rng.uniform(0.8, 3.0) if kind == 'cylinder' else 0.0
    spread = field * distance
    dent = Dent(0.1 * spread, 0.05 * spread, 0.12 * spread, 0.08 * spread, 0.002)
    pose = Pose.from_rpy((*tilt, roll), (x, y, distance))
    panel = Panel(pose, (-half[0], half[0], -half[1], half[1]), radius, dents=(dent,))
    panels = [panel]
    if kind == 'step':
        edge = spread * rng.uniform(0.1, 0.3)
        behind = Pose.from_rpy((*tilt, roll), (x, y, distance + rng.uniform(0.001, 0.03)))
        panels = [
            replace(panel, extent=(-3.0, edge, -3.0, 3.0)),
            replace(panel, pose=behind, extent=(edge, 3.0, -3.0, 3.0), dents=()),
        ]
    surface = Surface(tuple(panels))
    light = Photometry(reference_distance=distance, ambient=rng.choice([0.0, 0.1]))
    return kind, rig, surface, Renderer(rig, pattern.draw(), light).render(surface, rng)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--scenes', type=int, default=100)
    parser.add_argument('--first', type=int, default=0)
    parser.add_argument('--method', default='least-squares')
    parser.add_argument('--ratio', type=float, default=1.0)
    parser.add_argument('--code', choices=CODES, default='stripe')
    parser.add_argument('--moved', type=float, default=0.0, help='pixels')
    arguments = parser.parse_args()
    true = replace(PATTERN, code=arguments.code)
    told = replace(
        true,
        period_px=true.period_px * arguments.ratio,
        stripe_center_px=true.stripe_center_px + arguments.moved,
    )
    counts: dict[str, Counter[str]] = {}
    for seed in tqdm(range(arguments.first, arguments.first + arguments.scenes), leave=False):
        kind, rig, surface, image = draw(np.random.default_rng(seed), true)
        try:
            reconstructor = Reconstructor(rig, told, Settings(arguments.method, stride=2))
            measured = reconstructor.measure(image)
            cloud = measured.cloud
            error = np.abs(surface.distance(cloud.points[cloud.valid].astype(float)))
            outcome = 'right' if np.median(error) < 1e-3 else 'wrong cloud'
            outcome += '' if measured.coverage.confirmed else ', remarked'
            check = measured.epipolar
            outcome += ', off its rows' if check and check.seen and off([check]) else ''
        except OtherPatternError as reason:
            outcome = reason.reason
            tqdm.write(f'{seed} {kind}: {reason}')
        except RefusedFrameError as reason:
            outcome = reason.reason
        except Exception as defect:
            outcome = f'defect ({type(defect).__name__})'
        counts.setdefault(kind, Counter())[outcome] += 1
    for kind, outcomes in sorted(counts.items()):
        print(f'{kind:18}', '; '.join(f'{times} {name}' for name, times in outcomes.items()))


if __name__ == '__main__':
    main()
