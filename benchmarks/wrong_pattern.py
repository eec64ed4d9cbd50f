"""Photographs that do not belong to the pattern file: is that told, with both numbers?

python benchmarks/wrong_pattern.py [--seeds 3] [--method default] [--stride 2] [--code contrast]

A line a case: refused (with the sentence), or what the cloud is worth. "Both numbers" are the
period that the file tells and that which is seen, within 3 %. Of coded fringes whose file tells
the zero whole fringes elsewhere, the cloud must be the right one: not a pixel differs.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from kind_figures import METHODS, reconstructor
from kind_scenes import PATTERN, KindScene, scene, skin
from numpy.typing import NDArray
from tqdm import tqdm

from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.pattern.pattern import CODES, Pattern

PERIODS = 7.0, 8.0, 9.0, 9.5, 10.3, 11.0, 12.0, 13.0, 20.0
# Projector pixels that the stripe is told to be away from where it is.
MOVED = -100.0, -20.0, -5.0, 5.0, 20.0, 100.0


def scaled(pixels: NDArray[np.uint8], factor: float) -> NDArray[np.uint8]:
    """What a panel of the same size shows of an image that its projector scales."""
    height, width = pixels.shape[:2]
    turn = np.array(
        [[factor, 0, 0.5 * (1 - factor) * width], [0, factor, 0.5 * (1 - factor) * height]]
    )
    return cv2.warpAffine(pixels, turn, (width, height), flags=cv2.INTER_LINEAR)


def cases(one: KindScene, seed: int) -> Iterator[tuple[str, NDArray[np.uint8], Pattern]]:
    """Photograph and the pattern that is told."""
    pattern, image = one.pattern, one.photograph(seed)
    yield 'right', image, pattern
    for period in PERIODS:
        yield f'period {period:g} for 10', image, replace(pattern, period_px=period)
    for shift in (-10.0, *MOVED, 10.0):
        told = replace(pattern, stripe_center_px=pattern.stripe_center_px + shift)
        yield f'stripe {shift:+g} px', image, told
    mirrored = {
        'image mirrored': image[:, ::-1],
        'image upside down': image[::-1],
        'image turned': image[::-1, ::-1],
    }
    if pattern.code == 'stripe':
        mirrored |= {
            'red and blue swapped': image[..., ::-1],
            'stripe green': image[..., [1, 0, 2]],
            'grey': np.repeat(image[..., :1], 3, axis=2),
        }
    for name, other in mirrored.items():
        yield name, np.ascontiguousarray(other), pattern
    across = pattern.draw()
    sideways = np.zeros_like(across)
    side = min(across.shape[:2])
    sideways[:side, :side] = across[:side, 280 : 280 + side].transpose(1, 0, 2)
    for name, projected in (
        ('projected mirrored', across[:, ::-1]),
        ('projected upside down', across[::-1]),
        ('projected half round', across[::-1, ::-1]),
        ('projected turned', sideways),
        ('scaled 1280 to 1366', scaled(across, 1366 / 1280)),
        ('scaled 1366 to 1280', scaled(across, 1280 / 1366)),
    ):
        renderer = type(one.renderer())(one.rig, np.ascontiguousarray(projected), one.photometry)
        yield name, renderer.render(one.surface), pattern


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
            for period in (told.period_px, one.pattern.period_px)
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
    parser.add_argument('--code', default='stripe', choices=CODES)
    arguments = parser.parse_args()
    for seed in range(arguments.seeds):
        told = replace(PATTERN, code=arguments.code)
        one = scene(skin(np.random.default_rng(seed)), pattern=told)
        for name, image, told in tqdm(list(cases(one, seed)), leave=False):
            result = outcome(one, image, told, arguments.method, arguments.stride)
            tqdm.write(f'{seed} {name:24}{result}')


if __name__ == '__main__':
    main()
