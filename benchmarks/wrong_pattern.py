"""Photographs that do not belong to the pattern file: is that told, with both numbers?

python benchmarks/wrong_pattern.py [--seeds 3] [--method default] [--stride 2]

A line a case: refused (with the sentence), or what the cloud is worth. "Both numbers" are the
period that the file tells and that which is seen, within 3 %.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from kind_figures import METHODS, reconstructor
from kind_scenes import PATTERN, KindScene, scene, skin
from numpy.typing import NDArray
from tqdm import tqdm

from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.pattern import Pattern

PERIODS = 7.0, 8.0, 9.0, 9.5, 10.3, 11.0, 12.0, 13.0, 20.0
# Projector pixels that the stripe is told to be away from where it is.
MOVED = -100.0, -20.0, -5.0, 5.0, 20.0, 100.0


def cases(one: KindScene, seed: int) -> Iterator[tuple[str, NDArray[np.uint8], Pattern]]:
    """Photograph and the pattern that is told."""
    image = one.photograph(seed)
    yield 'right', image, PATTERN
    for period in PERIODS:
        yield f'period {period:g} for 10', image, replace(PATTERN, period_px=period)
    for shift in MOVED:
        told = replace(PATTERN, stripe_center_px=PATTERN.stripe_center_px + shift)
        yield f'stripe {shift:+g} px', image, told
    mirrored = {
        'image mirrored': image[:, ::-1],
        'image upside down': image[::-1],
        'image turned': image[::-1, ::-1],
        'red and blue swapped': image[..., ::-1],
        'stripe green': image[..., [1, 0, 2]],
        'grey': np.repeat(image[..., :1], 3, axis=2),
    }
    for name, other in mirrored.items():
        yield name, np.ascontiguousarray(other), PATTERN
    across = np.ascontiguousarray(PATTERN.draw()[: PATTERN.height])
    sideways = np.zeros_like(across)
    side = min(across.shape[:2])
    sideways[:side, :side] = across[:side, 280 : 280 + side].transpose(1, 0, 2)
    for name, projected in (
        ('projected mirrored', across[:, ::-1]),
        ('projected turned', sideways),
    ):
        renderer = type(one.renderer())(one.rig, np.ascontiguousarray(projected), one.photometry)
        yield name, renderer.render(one.surface), PATTERN


def outcome(
    one: KindScene, image: NDArray[np.uint8], told: Pattern, method: str, stride: int
) -> str:
    """What became of it."""
    try:
        cloud = reconstructor(one.rig, told, method, stride).measure(image).cloud
    except FtpDentError as reason:
        numbers = [float(text) for text in re.findall(r'\d+\.?\d*', str(reason))]
        both = all(
            any(abs(n / period - 1) < 0.03 for n in numbers)
            for period in (told.period_px, PATTERN.period_px)
        )
        return f'refused{", both numbers" if both else ""}: {reason}'
    if not cloud.valid.any():
        return 'a cloud of no points'
    error = 1e3 * one.surface.distance(cloud.points[cloud.valid].astype(float))
    depth = cloud.points[..., 2][cloud.valid]
    return (
        f'CLOUD of {cloud.valid.mean():.0%}, MAE {np.abs(error).mean():.3f} mm, '
        f'z {depth.min():.3f} to {depth.max():.3f} m'
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seeds', type=int, default=1)
    parser.add_argument('--method', default='default', choices=METHODS)
    parser.add_argument('--stride', type=int, default=2)
    arguments = parser.parse_args()
    for seed in range(arguments.seeds):
        one = scene(skin(np.random.default_rng(seed)))
        for name, image, told in tqdm(list(cases(one, seed)), leave=False):
            result = outcome(one, image, told, arguments.method, arguments.stride)
            tqdm.write(f'{seed} {name:24}{result}')


if __name__ == '__main__':
    main()
