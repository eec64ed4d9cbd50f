"""Methods on photographs that this project did not make: real ones, and other renderers'.

python benchmarks/real_photographs.py [--only lion] [--method default] [--shared FOLDER]

The photographs stand in a folder beside the project, and are passed over where they are not:
``real/*`` with ``truth.npz`` (z at every pixel), ``eval/scenes/*`` with ``gt_depth.npz`` (z, what
is lit and what is near an edge at every second pixel) and ``scene.json`` (dents).
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from kind_figures import METHODS, reconstructor
from numpy.typing import NDArray
from tqdm import tqdm

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.photograph.file import read_photograph
from ftp_dent_ros.rig.rig import Rig, read_rig
from ftp_dent_ros.simulation.truth import match_truth

COLUMNS = 'cover', 'outside', 'MAE', 'p95', '>0.1', '>1', 'z', '<4', 'edge z', '<4', 'scale mm'


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph with its truth on every `stride`-th pixel."""

    name: str
    image: Path
    rig: Path
    pattern: Path
    stride: int
    depth: NDArray[np.float64]
    lit: NDArray[np.bool_]
    edge: NDArray[np.bool_]
    dents: list[dict]


def photographs(shared: Path) -> Iterator[Photograph]:
    """All that the folder holds."""
    for truth in sorted(shared.glob('real/*/truth.npz')):
        folder = truth.parent
        depth = np.load(truth)['z'].astype(float)
        for image in sorted(folder.glob('image_*.png')):
            pattern = folder / image.name.replace('image', 'pattern').replace('.png', '.yaml')
            lit = np.isfinite(depth)
            edge = _near_edge(lit)
            name = f'{folder.name} {image.stem[6:]}'
            yield Photograph(name, image, folder / 'rig.yaml', pattern, 1, depth, lit, edge, [])
    for truth in sorted(shared.glob('eval/scenes/*/gt_depth.npz')):
        folder = truth.parent
        arrays = np.load(truth)
        dents = json.loads((folder / 'scene.json').read_text())['dents']
        yield Photograph(
            folder.name,
            folder / 'image.png',
            folder / 'rig.yaml',
            folder / 'pattern.yaml',
            int(arrays['step']),
            arrays['z'].astype(float),
            arrays['valid'],
            arrays['edge'],
            dents,
        )


def _near_edge(lit: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Within about two fringes of 30 pixels of the rim."""
    return cv2.erode(lit.astype(np.uint8), np.ones((121, 121), np.uint8)) == 0


def row(one: Photograph, method: str) -> tuple[list[str], list[str]]:
    """Cells of the table, and lines about the dents; distances in millimetres."""
    rig, pattern = read_rig(one.rig), read_pattern(one.pattern)
    try:
        measurement = reconstructor(rig, pattern, method, one.stride).measure(
            read_photograph(one.image)
        )
    except FtpDentError as reason:
        return [str(reason)], []
    cloud = measurement.cloud
    rays = rig.camera.rays(rig.camera.pixel_grid(one.stride))
    along = np.linalg.norm(rays, axis=-1)
    on = cloud.valid & one.lit
    cosine = _cosine(one, rays) if one.dents else np.ones_like(along)
    error = (cloud.points[..., 2] - one.depth) * along
    size = np.abs(error * cosine if one.dents else error / along)[on]
    cells = [
        f'{100 * on.sum() / one.lit.sum():.1f}',
        str((cloud.valid & ~one.lit).sum()),
        f'{1e3 * size.mean():.4f}',
        f'{1e3 * np.percentile(size, 95):.3f}',
        f'{100 * (size > 1e-4).mean():.2f}%',
        f'{100 * (size > 1e-3).mean():.2f}%',
    ]
    for part in (on, on & one.edge):
        ratio = (error / cloud.sigma)[part]
        ratio = ratio[np.isfinite(ratio)]
        if len(ratio):
            cells += [
                f'{np.sqrt(np.mean(ratio**2)):.2f}',
                f'{100 * (np.abs(ratio) < 4).mean():.1f}',
            ]
        else:
            cells += ['', '']
    cells.append(f'{1e3 * np.nanmedian(cloud.resolution[on]):.1f}' if on.any() else '')
    return cells, list(dent_lines(one, cloud, rig)) if one.dents else []


def _cosine(one: Photograph, rays: NDArray) -> NDArray[np.float64]:
    """Between ray and normal, so that errors along rays become distances to the skin."""
    points = rays * one.depth[..., None]
    normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    with np.errstate(invalid='ignore'):
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    cosine = np.abs(np.sum(normal * rays, axis=-1)) / np.linalg.norm(rays, axis=-1)
    return np.nan_to_num(cosine, nan=1.0)


def dent_lines(one: Photograph, cloud: Cloud, rig: Rig) -> Iterator[str]:
    """A line a dent: the cloud at its bottom, and the inspection; then what is false."""
    try:
        found = inspect(cloud)
    except FtpDentError as reason:
        yield str(reason)
        return
    everything = [m for m in (*found.dents, *found.others) if m.kind != 'step']
    places = [np.array([dent[axis] for axis in 'xyz']) for dent in one.dents]
    reaches = [_reach(dent) for dent in one.dents]
    pairs = match_truth([m.position for m in everything], places, reaches)
    grid = np.array(one.depth.shape)[::-1]
    for index, (dent, place) in enumerate(zip(one.dents, places, strict=True)):
        column, line = np.rint(rig.camera.project(place) / one.stride).astype(int)
        if not (0 <= column < grid[0] and 0 <= line < grid[1] and one.lit[line, column]):
            continue
        window = slice(max(line - 2, 0), line + 3), slice(max(column - 2, 0), column + 3)
        off = 1e3 * (cloud.points[..., 2][window] - one.depth[window])
        sigma = 1e3 * np.sqrt(np.mean(cloud.sigma[window] ** 2))
        at = f'{np.nanmean(off):+.3f} ({sigma:.3f})' if np.isfinite(off).any() else 'not measured'
        text = 'not found'
        if index in pairs:
            best = everything[pairs[index]]
            text = f'{best.kind}: ' + ', '.join(
                f'{name} {1e3 * value.value - dent[key]:+.3f} ({1e3 * value.uncertainty:.3f})'
                for name, value, key in (
                    ('depth', best.depth, 'depth_mm'),
                    ('length', best.length, 'length10_mm'),
                    ('width', best.width, 'width10_mm'),
                )
            )
        size = f'{dent["depth_mm"]:.2f} x {dent["length10_mm"]:.0f} x {dent["width10_mm"]:.0f}'
        yield f'{size}: cloud {at}; {text}'
    for index, m in enumerate(everything):
        if index in pairs.values():
            continue
        where = np.round(1e3 * m.position[:2]).astype(int).tolist()
        depth = f'{1e3 * m.depth.value:.3f}+-{1e3 * m.depth.uncertainty:.3f}'
        yield f'FALSE {m.kind} {depth} at {where}'


def _reach(dent: dict) -> float:
    return max(0.010, dent['length_mm'] / 2e3) if math.isfinite(dent['length_mm']) else 0.010


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--only', default='', help='part of the names wanted')
    parser.add_argument('--method', action='append', choices=METHODS)
    parser.add_argument(
        '--shared', type=Path, default=Path(__file__).resolve().parents[2] / 'shared'
    )
    arguments = parser.parse_args()
    wanted = [one for one in photographs(arguments.shared) if arguments.only in one.name]
    if not wanted:
        print(f'{arguments.shared} holds no such photographs: nothing is measured')
        return
    print(f'{"millimetres":36}' + ''.join(f'{column:>9}' for column in COLUMNS))
    for one in tqdm(wanted, unit='photograph', leave=False):
        for method in arguments.method or METHODS:
            cells, lines = row(one, method)
            tqdm.write(f'{one.name:18}{method:18}' + ''.join(f'{cell:>9}' for cell in cells))
            for line in lines:
                tqdm.write(f'{"":17}{line}')


if __name__ == '__main__':
    main()
