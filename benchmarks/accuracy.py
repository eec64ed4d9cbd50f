"""Accuracy of a method on simulated photographs, scene by scene.

python benchmarks/accuracy.py [--method least-squares] [--code contrast] [--only fuselage]
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scenes import PATTERN, SCENES, Scene
from tqdm import tqdm

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import RefusedFrameError
from ftp_dent_ros.pattern.pattern import CODES, Pattern
from ftp_dent_ros.profilometry import METHODS, UNWRAPPINGS, Reconstructor, Settings

COLUMNS = (
    *('coverage %', 'outside', 'MAE', 'p95', 'max', 'bias', 'dent MAE', 'dent bias'),
    *('error/sigma', 'below 4 %'),
)


def figures(scene: Scene, settings: Settings, pattern: Pattern) -> list[str]:
    """A row of the table; distances to the true surface in millimetres."""
    try:
        photograph = scene.photograph(pattern=pattern)
        measured = Reconstructor(scene.rig, pattern, settings).measure(photograph)
    except RefusedFrameError as reason:
        return [f'refused: {reason.reason}']
    cloud = measured.cloud
    lit = scene.lit()[:: settings.stride, :: settings.stride]
    points = cloud.points[cloud.valid].astype(float)
    error = 1e3 * scene.surface.distance(points)
    on_dent = error[scene.on_dents(points)]
    distances = (
        np.abs(error).mean(),
        np.percentile(np.abs(error), 95),
        np.abs(error).max(),
        error.mean(),
        np.abs(on_dent).mean(),
        on_dent.mean(),
    )
    coverage = 100 * (cloud.valid & lit).sum() / lit.sum()
    outside = str((cloud.valid & ~lit).sum())
    return [
        f'{coverage:.1f}',
        outside,
        *(f'{distance:.4f}' for distance in distances),
        *_normalised(scene, cloud, settings.stride),
    ]


def _normalised(scene: Scene, cloud: Cloud, stride: int) -> tuple[str, str]:
    """Root mean square of all points' errors over their sigma, and the share below 4, per cent."""
    rays = scene.rig.camera.rays(scene.rig.camera.pixel_grid())[::stride, ::stride]
    error = cloud.points[..., 2] - scene.surface.intersect(rays)
    ratio = error * np.linalg.norm(rays, axis=-1) / cloud.sigma
    ratio = ratio[np.isfinite(ratio)]
    if not len(ratio):
        return '', ''
    below = 100 * (np.abs(ratio) < 4).mean()
    return f'{np.sqrt(np.mean(ratio**2)):.2f}', f'{below:.1f}'


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--method', choices=tuple(METHODS), default=Settings().method)
    parser.add_argument('--unwrapping', choices=UNWRAPPINGS, default='itoh')
    parser.add_argument('--code', choices=CODES, default=PATTERN.code)
    parser.add_argument('--stride', type=int, default=1)
    parser.add_argument('--only', default='', help='part of the names of the scenes wanted')
    arguments = parser.parse_args()
    settings = Settings.chosen(
        arguments.method,
        arguments.stride,
        unwrapping=arguments.unwrapping,
    )
    pattern = replace(PATTERN, code=arguments.code)
    wanted = [scene for scene in SCENES if arguments.only in scene.name]
    rows = [
        (scene.name, *figures(scene, settings, pattern)) for scene in tqdm(wanted, unit='scene')
    ]
    print(f'{settings.method}, code {pattern.code}, stride {settings.stride}; millimetres')
    for name, *values in [('', *COLUMNS), *rows]:
        print(f'{name:32}' + ''.join(f'{value:>12}' for value in values))


if __name__ == '__main__':
    main()
