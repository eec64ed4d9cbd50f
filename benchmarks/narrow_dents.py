"""Dents of two to five fringes' width at every phase of the fringes: errors, and over sigma.

Each photograph has up to 22 dents on a skin 0.6 to 1.2 m away, clean or dirty, under light that
falls as Lambert's law says or evenly.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from kind_figures import METHODS, measured_dent, reconstructor, visible
from kind_scenes import CAMERA, PATTERN, KindScene, by_contour, make_rig, scene, skin
from tqdm import tqdm

from ftp_dent_ros.pattern.pattern import CODES
from ftp_dent_ros.simulation import Dirt, Paint
from ftp_dent_ros.simulation.dents import SMOOTH, Cap, Gaussian, RaisedCosine

SHAPES = {'gaussian': Gaussian(), 'smooth': SMOOTH, 'cosine': RaisedCosine(), 'cap': Cap()}
# What light and skin are like.
KINDS: dict[str, dict] = {
    'matt': {},
    'even light': {'shading': False},
    'dirt of 10 %': {'dirt': 0.10},
    'dirt of 25 %': {'dirt': 0.25},
    'even, dirt 25 %': {'dirt': 0.25, 'shading': False},
    'speckle of 10 %': {'speckle_contrast': 0.1},
    'daylight': {'ambient': 1.0, 'exposure': 0.45},
}
_FOCAL = 1890.0  # of the projector, its pixels
_MOST, _TRIES = 22, 4000
_APART = 0.85  # of the sum of two widths
_STRIDE = 2
# Points of a dent are within half its width; those of the skin no less than so many away.
_WITHIN, _BESIDE = 0.5, 21


def narrow(seed: int, shapes: list[str], dirt: float = 0.0, **light) -> KindScene:
    """A skin full of narrow dents."""
    rng = np.random.default_rng([4711, seed])
    distance = rng.uniform(0.6, 1.2)
    scale = distance / 0.8
    rig = make_rig(distance, 0.24 * scale, CAMERA, _FOCAL)
    fringe = PATTERN.period_px / _FOCAL * distance
    places: list[tuple[float, float, float]] = []
    dents = []
    for _ in range(_TRIES):
        if len(places) == _MOST:
            break
        x, y = rng.uniform(-0.17, 0.15) * scale, rng.uniform(-0.075, 0.075) * scale
        width = rng.uniform(2, 5) * fringe
        if all(math.hypot(x - a, y - b) > (width + w) * _APART for a, b, w in places):
            places.append((x, y, width))
            depth = float(np.clip(width * rng.uniform(0.01, 0.05), 0.1e-3, 1.5e-3))
            length, turn = width * rng.uniform(1, 1.3), rng.uniform(0, 3)
            shape = SHAPES[shapes[rng.integers(len(shapes))]]
            dents.append(by_contour(x, y, length, width, depth, turn, shape))
    marks = (Dirt(dirt, seed=int(rng.integers(1 << 30))),) if dirt else ()
    panel = skin(rng, distance, dents=tuple(dents), paint=Paint(marks=marks))
    return scene(panel, rig=rig, **light)


@dataclass
class Errors:
    """Of the points of a kind, millimetres and over sigma, and of the dents' centres."""

    inside: list = field(default_factory=list)
    beside: list = field(default_factory=list)
    centres: list = field(default_factory=list)

    def add(self, photographed: KindScene, seed: int, method: str) -> None:
        """Measure a photograph."""
        measure = reconstructor(photographed.rig, photographed.pattern, method, _STRIDE).measure
        cloud = measure(photographed.photograph(seed)).cloud
        truth = photographed.truth(_STRIDE)
        camera = photographed.rig.camera
        skin = camera.rays(camera.pixel_grid())[::_STRIDE, ::_STRIDE] * truth.depth[..., None]
        dents = visible(photographed, truth, _STRIDE)
        near = np.zeros(truth.depth.shape, bool)
        for dent in dents:
            near |= np.linalg.norm(skin - dent.position, axis=-1) < _WITHIN * dent.width
            centre = measured_dent(photographed, dent, cloud, _STRIDE)
            if math.isfinite(centre.cloud_error):
                self.centres.append((centre.cloud_error, centre.cloud_sigma, centre.depth))
        error = 1e3 * (cloud.points[..., 2] - truth.depth) * truth.along_ray
        both = np.stack([error, error / (1e3 * cloud.sigma)], axis=-1)
        on = cloud.valid & truth.lit
        away = cv2.dilate(near.view(np.uint8), np.ones((_BESIDE, _BESIDE))) == 0
        self.inside.append(both[on & near])
        self.beside.append(both[on & away])

    def row(self) -> list[str]:
        """Figures of all photographs."""
        inside, beside = np.concatenate(self.inside), np.concatenate(self.beside)
        error, sigma, depth = np.array(self.centres).T
        centre = np.abs(error / sigma)
        kept = (np.abs(error) < 0.03 * depth) | (centre < 2)
        return [
            f'{_rms(inside[:, 0]):.4f}',
            f'{_rms(inside[:, 1]):.2f}',
            f'{100 * np.mean(np.abs(inside[:, 1]) < 4):.1f}',
            f'{np.abs(beside[:, 0]).mean():.4f}',
            f'{_rms(beside[:, 1]):.2f}',
            f'{100 * np.mean(error / depth):+.1f}',
            f'{_rms(centre):.2f}',
            f'{centre.max():.1f}',
            f'{np.count_nonzero(kept)}/{len(kept)}',
        ]


COLUMNS = 'rms', 'z', '<4, %', 'skin MAE', 'skin z', 'centre %', 'z', 'worst', '3% or 2u'


def _rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--only', default='', help='part of the name of a kind')
    parser.add_argument('--shapes', nargs='+', choices=SHAPES, default=list(SHAPES))
    parser.add_argument('--seeds', type=int, default=2, help='photographs a kind')
    parser.add_argument('--first-seed', type=int, default=0)
    parser.add_argument('--method', choices=METHODS, default='default')
    parser.add_argument('--code', choices=CODES, default='stripe', help='of the pattern')
    arguments = parser.parse_args()
    chosen = {name: light for name, light in KINDS.items() if arguments.only in name}
    if not chosen:
        parser.error(f'no kind has {arguments.only!r} in its name: give one of {", ".join(KINDS)}')
    print(f'{arguments.method}, code {arguments.code}')
    print('millimetres, and errors over sigma (z), in dents and beside')
    print(f'{"":18}' + ''.join(f'{column:>10}' for column in COLUMNS))
    for name, light in chosen.items():
        errors = Errors()
        seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
        for seed in tqdm(seeds, desc=name, unit='photograph', leave=False):
            photographed = narrow(seed, arguments.shapes, **light)
            pattern = replace(photographed.pattern, code=arguments.code)
            errors.add(replace(photographed, pattern=pattern), seed, arguments.method)
        print(f'{name:18}' + ''.join(f'{value:>10}' for value in errors.row()))


if __name__ == '__main__':
    main()
