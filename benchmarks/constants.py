"""What becomes of the results when a constant of profilometry/ is doubled, one after the other.

python benchmarks/constants.py [--only denoising] [--write docs/method.md]

Each row: the change of the mean absolute error (per cent), of the coverage (points of a hundred)
and of the root mean square of the errors over their sigma (per cent), each on the scene where it
is largest. Constants of modules for coded fringes are doubled under those. `--write`
puts value and changes into the tables of a page, and names the constants that are missing there.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import importlib.machinery
import importlib.util
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import ftp_dent_ros
from ftp_dent_ros.errors import RefusedFrameError
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.rig.rig import Lens, Rig
from ftp_dent_ros.simulation import Dent, Dirt, Paint, Panel, Photometry, Renderer, Surface
from ftp_dent_ros.simulation.dents import Gaussian

PACKAGE = 'ftp_dent_ros.profilometry'
FOLDER = Path(ftp_dent_ros.__file__).parent / 'profilometry'
DEPTH = 0.65
PATTERN = Pattern(640, 480, 13.0, 320.0)
CODED = replace(PATTERN, code='contrast')
# Modules some constants of which matter under coded fringes alone.
OF_CODE = (
    'rows_check',
    'least_squares/code/',
    *('least_squares/fit/coded_start', 'least_squares/fit/surface_fit'),
    *('least_squares/fringe_orders/choices', 'least_squares/fringe_orders/coded_surfaces'),
    'least_squares/fringe_orders/doubted_pieces',
    *('least_squares/fringe_orders/numbering', 'least_squares/fringe_orders/pieces'),
)
# Not free: numbers that follow from a definition, and what the reader of a table reads.
EXACT = {
    *('_TURN', '_SQUARES', '_INSIDE', '_BESIDE', '_BETWEEN'),
    *('IN_LUMA', 'IN_MOSAIC', '_REMARKABLE', '_WEIGHTS', '_SUMS', 'DIM'),
}


def lens(focal: float, k1: float) -> Lens:
    matrix = np.array([[focal, 0, 322.5], [0, focal + 2, 237.5], [0, 0, 1]])
    return Lens(640, 480, matrix, np.array([k1, 0.0, 0.0, 0.0, 0.0]))


RIG = Rig(
    lens(1000.0, -0.1),
    lens(1150.0, -0.04),
    Rotation.from_euler('y', 0.3).as_matrix(),
    np.array([-0.2, 0.005, 0.03]),
)


@dataclass(frozen=True, eq=False)
class Scene:
    """A photograph of panels, and the truth."""

    name: str
    panels: tuple[Panel, ...]
    light: Photometry
    pattern: Pattern

    @cached_property
    def image(self) -> NDArray[np.uint8]:
        renderer = Renderer(RIG, self.pattern.draw(), self.light)
        return renderer.render(Surface(self.panels), np.random.default_rng(1))

    @cached_property
    def rays(self) -> NDArray[np.float64]:
        return RIG.camera.rays(RIG.camera.pixel_grid())

    @cached_property
    def depth(self) -> NDArray[np.float64]:
        return Surface(self.panels).intersect(self.rays)

    @cached_property
    def lit(self) -> NDArray[np.bool_]:
        points = self.rays * self.depth[..., None]
        u, v = np.moveaxis(RIG.projector.project(RIG.to_projector(points)), -1, 0)
        inside = (u > 0) & (u < self.pattern.width - 1)
        return inside & (v > 0) & (v < self.pattern.height - 1)

    def figures(self, cloud) -> NDArray[np.float64]:
        """Mean absolute error along z (mm), coverage (%), and errors over sigma (rms)."""
        error = cloud.points[..., 2] - self.depth
        seen = np.isfinite(error)
        ratio = error * np.linalg.norm(self.rays, axis=-1) / cloud.sigma
        ratio = ratio[np.isfinite(ratio)]
        return np.array(
            [
                1e3 * np.abs(error[seen]).mean(),
                100 * (seen & self.lit).sum() / self.lit.sum(),
                np.sqrt(np.mean(ratio**2)) if len(ratio) else np.nan,
            ]
        )


def panel(extent: float, distance: float = DEPTH, **parts) -> Panel:
    pose = Pose.from_rpy((0.02, 0.05, 0.0), (0.004, -0.003, distance))
    dents = (
        Dent(0.02, -0.01, length=0.06, width=0.04, depth=0.002, angle=0.4),
        Dent(-0.05, 0.03, length=0.025, width=0.02, depth=0.0006, shape=Gaussian()),
    )
    return Panel(pose, (-extent, extent, -extent, extent), dents=dents, **parts)


def light(**values: Any) -> Photometry:
    return Photometry(reference_distance=DEPTH, **values)


def scenes(pattern: Pattern) -> list[Scene]:
    """A small panel, a dirty livery, a step beside glare, and noise."""
    livery = Paint((0.8, 0.7, 0.7), (0.8, 0.6, 0.06), (0.3, 0.3, 0.35), marks=(Dirt(0.1, seed=3),))
    front = panel(0.4)
    front = Panel(front.pose, (-0.4, 0.06, -0.4, 0.4), dents=front.dents)
    behind = panel(0.4, DEPTH + 0.02)
    behind = Panel(behind.pose, (0.06, 0.4, -0.4, 0.4))
    daylight = light(exposure=0.3, ambient=1.0, speckle_contrast=0.1, full_well=6000.0)
    return [
        Scene('panel', (panel(0.09),), light(), pattern),
        Scene(
            'livery',
            (panel(0.4, paint=livery),),
            light(camera_gamma=1.8, bayer=True, jpeg_quality=90),
            pattern,
        ),
        Scene('step', (front, behind), light(exposure=1.4), pattern),
        Scene('noise', (panel(0.4),), daylight, pattern),
    ]


def constants(source: str) -> Iterator[tuple[str, str]]:
    """Names of a module's constants, and their values as they are written."""
    for node in ast.parse(source).body:
        if not isinstance(node, ast.Assign):
            continue
        target = node.targets[0]
        pairs = (
            zip(target.elts, node.value.elts, strict=True)
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
            else [(target, node.value)]
        )
        for one, value in pairs:
            if isinstance(one, ast.Name) and one.id.strip('_').isupper() and _numeric(value):
                yield one.id, ast.unparse(value)


def _numeric(value: ast.expr) -> bool:
    kinds = (ast.Dict, ast.JoinedStr, ast.List)
    parts = list(ast.walk(value))
    text = any(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in parts)
    number = any(
        isinstance(part, ast.Constant) and isinstance(part.value, (int, float)) for part in parts
    )
    return number and not text and not isinstance(value, kinds)


def twice(value):
    """Twice a number, or each of several."""
    return tuple(2 * one for one in value) if isinstance(value, tuple) else 2 * value


class _Doubling(importlib.machinery.SourceFileLoader):
    """Loads a module in which one constant is doubled as soon as it is assigned."""

    def __init__(self, name: str, path: str, constant: str) -> None:
        super().__init__(name, path)
        self._constant = constant

    def get_code(self, fullname):
        tree = ast.parse(self.get_data(self.path))
        for index, node in enumerate(tree.body):
            names = {
                each.id
                for target in (node.targets if isinstance(node, ast.Assign) else ())
                for each in ast.walk(target)
                if isinstance(each, ast.Name)
            }
            if self._constant in names:
                extra = f'from {__name__} import twice as __twice\n{self._constant} = '
                extra += f'__twice({self._constant})'
                tree.body[index + 1 : index + 1] = ast.parse(extra).body
                break
        ast.fix_missing_locations(tree)
        return compile(tree, self.path, 'exec')


@dataclass(frozen=True)
class _Finder:
    module: str
    path: Path
    constant: str

    def find_spec(self, name, path=None, target=None):
        if name != self.module:
            return None
        loader = _Doubling(name, str(self.path), self.constant)
        return importlib.util.spec_from_file_location(name, self.path, loader=loader)


def reconstructor(pattern: Pattern, choices: dict, finder: _Finder | None = None):
    """A reconstructor of modules loaded afresh."""
    for name in [name for name in sys.modules if name.startswith(PACKAGE)]:
        del sys.modules[name]
    try:
        if finder is not None:
            sys.meta_path.insert(0, finder)
        module = importlib.import_module(PACKAGE)
        return module.Reconstructor(RIG, pattern, module.Settings(**choices))
    finally:
        if finder is not None:
            sys.meta_path.remove(finder)


def choices_for(module: str) -> dict:
    """Settings under which a module's constants matter."""
    if module == 'settings':
        return {'method': 'virtual-reference', 'unwrapping': 'estrada'}
    if module.startswith('fourier') or module == 'carrier':
        return {'method': 'virtual-reference'}
    return {}


def figures(method, scene: Scene) -> NDArray[np.float64]:
    """Figures of a scene, NaN if it is refused."""
    try:
        return scene.figures(method.measure(scene.image).cloud)
    except RefusedFrameError:
        return np.full(3, np.nan)


def measured(choices: dict, wanted: list[Scene], finder: _Finder | None = None):
    """Figures of each scene, or the name of the error that a constant leads to."""
    try:
        method = reconstructor(wanted[0].pattern, choices, finder)
        return np.array([figures(method, scene) for scene in wanted])
    except Exception as reason:  # is a result too
        return type(reason).__name__


def change(before, after) -> str:
    """The largest changes, as the tables have them."""
    if isinstance(after, str):
        return f'fails ({after})'
    lost = np.isnan(after[:, 1]) & ~np.isnan(before[:, 1])
    both = ~np.isnan(after[:, 1]) & ~np.isnan(before[:, 1])
    parts = []
    if both.any():
        one, other = before[both], after[both]
        parts = [
            _share(other[:, 0] / one[:, 0] - 1),
            _signed(_largest(other[:, 1] - one[:, 1]), 1),
        ]
        if np.isfinite(one[:, 2]).any():
            parts.append(_share(other[:, 2] / one[:, 2] - 1))
    if lost.any():
        return ', '.join([' / '.join(parts)] * bool(parts) + [f'{lost.sum()} of 4 refused'])
    return 'none' if set(parts) == {'0'} else ' / '.join(parts)


def _largest(moved: NDArray) -> float:
    moved = moved[np.isfinite(moved)]
    return float(moved[np.abs(moved).argmax()]) if len(moved) else 0.0


def _share(moved: NDArray) -> str:
    """Change in per cent, or the factor if that is large."""
    largest = _largest(moved)
    return f'x {1 + largest:.0f}' if largest > 9 else _signed(100 * largest, 0)


def _signed(value: float, digits: int) -> str:
    return f'{value:+.{digits}f}' if round(value, digits) else '0'


def tables(only: str) -> list[tuple[str, str, str, str]]:
    """Module, constant, value and changes."""
    seen = {pattern.code: scenes(pattern) for pattern in (PATTERN, CODED)}
    found = []
    for path in sorted(FOLDER.rglob('*.py')):
        module = path.relative_to(FOLDER).with_suffix('').as_posix()
        if only in module:
            found += [(path, module, *pair) for pair in constants(path.read_text())]
    before: dict[str, NDArray] = {}
    rows = []
    for path, module, name, value in tqdm(found, unit='constant'):
        choices = choices_for(module)
        code = 'contrast' if module.startswith(OF_CODE) else 'stripe'
        wanted, key = seen[code], f'{code}, {choices}'
        if key not in before:
            before[key] = measured(choices, wanted)
            for scene, row in zip(wanted, before[key], strict=True):
                tqdm.write(
                    f'{choices.get("method", "least-squares")}, {code}, {scene.name}: '
                    f'{row[0]:.4f} mm, {row[1]:.2f} %, {row[2]:.2f}'
                )
        if name in EXACT:
            rows.append((module, name, value, 'not free'))
            continue
        finder = _Finder(f'{PACKAGE}.{module.replace("/", ".")}', path, name)
        rows.append((module, name, value, change(before[key], measured(choices, wanted, finder))))
    return rows


ROW = re.compile(r'^\| `(\w+)` \| [^|]* \| (.*) \| ([^|]*) \|$')


def write(page: Path, rows: list[tuple[str, str, str, str]]) -> None:
    """Put values and changes into a page's tables; print what is missing there."""
    known = {(module, name): (value, moved) for module, name, value, moved in rows}
    module, lines = '', []
    modules = {each for each, _ in known}
    for line in page.read_text().splitlines():
        if line.startswith('**`'):
            module = line.strip('*`').removesuffix('.py')
        match = ROW.match(line)
        if match and module in modules:
            pair = known.pop((module, match[1]), None)
            if pair is None:
                print(f'{module}: {match[1]} is gone')
                continue
            line = f'| `{match[1]}` | {pair[0]} | {match[2]} | {pair[1]} |'
        lines.append(line)
    for module, name in known:
        print(f'{module}: {name} is missing in {page}')
    page.write_text('\n'.join(lines) + '\n')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--only', default='', help="part of the modules' names")
    parser.add_argument('--write', type=Path, help='page whose tables are brought up to date')
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    rows = tables(arguments.only)
    for module, name, value, moved in rows:
        print(f'{module:36} {name:24} {value:28} {moved}')
    if arguments.write:
        write(arguments.write, rows)


if __name__ == '__main__':
    main()
