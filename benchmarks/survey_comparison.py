"""Two surveys of one skin compared: is every dent told right, and no growth that is none?

python benchmarks/survey_comparison.py [--seeds 20] [--first 700] [--drift 0.3] [--off 0.6]
                                       [--depths]
python benchmarks/survey_comparison.py --rendered FOLDER [--first 7]

A fuselage of 2 m radius, 6 m by 2.4 m of it, with 60 dents: 3 grow by 0.05 mm, 2 are repaired, 5
come. Each survey has the aircraft elsewhere and otherwise, a map that walks (--drift: millimetres
over the first metre), and misses a strip. Depths, lengths and widths are stated as uncertain as
two rendered flights at 0.8 m stated them (depth 0.2 mm over the width in millimetres, length and
width 10 mm over it), and are off by --off times as much: what those flights' 11 dents differed by
was 0.6 of what was stated, for what both have in common drops out. --tail is the degrees of
freedom of the errors' Student t (0: Gaussian). The later rig sees everything 0.3 % larger. Each
survey keeps the skin about its dents, with as much noise as those flights' skins differed by; with
--depths it does not, as what `ftp-dent inspect` writes, and depths are compared.

--rendered photographs the shipped scene twice instead, from other places, in other light, by an
autopilot that errs otherwise, with one dent gone and three grown by 0.05 mm; the surveys are those
of `ftp-dent survey`, which keep the skin about each dent.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter
from tqdm import tqdm

from ftp_dent_ros.cli.main import main as command
from ftp_dent_ros.dents.dent import Estimate
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.simulation.world import read_world
from ftp_dent_ros.survey.comparison import compare
from ftp_dent_ros.survey.result import CoverageCells, DentRelief, SurveyedDent, SurveyResult
from ftp_dent_ros.survey.store import SurveyStore

sys.path.append(str(Path(__file__).resolve().parents[1] / 'test'))
from dent_samples import make_dent

RADIUS, SKIN, APART = 2.0, (6.0, 2.4), 0.04
DENTS, GROWN, REPAIRED, NEW = 60, 3, 2, 5
GROWTH = 5e-5
PLACE, FINDABLE, CELL = 2e-4, 6e-5, 0.01
LARGER = 1.003
# Of the skin about a dent: its points, metres, and the noise of a survey, which is correlated over
# so many of them.
POINT, NOISE, CORRELATED = 1e-3, 3e-6, 2.5
RENDERED_CLOUDS = 41
STORE = 'aircraft.sqlite'
OPEN = ('known', 'first seen', 'not seen')


@dataclass(frozen=True)
class Errors:
    """Of a survey: metres over the first metre, parts of what is stated, degrees of freedom."""

    drift: float
    off: float
    tail: float
    depths: bool = False


@dataclass(frozen=True, eq=False)
class Skin:
    """What there is: flat places, and sizes; metres."""

    places: np.ndarray
    depth: np.ndarray
    length: np.ndarray
    width: np.ndarray


def skin(rng: np.random.Generator, count: int) -> Skin:
    places: list[np.ndarray] = []
    while len(places) < count:
        place = rng.uniform((0.1, 0.1), np.array(SKIN) - 0.1)
        if all(np.linalg.norm(place - other) > APART for other in places):
            places.append(place)
    width = rng.uniform(0.015, 0.06, count)
    depth = np.exp(rng.uniform(np.log(2e-4), np.log(3e-3), count))
    return Skin(np.array(places), depth, width * rng.uniform(1, 1.8, count), width)


def on_fuselage(flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and outward normals of places on the unrolled skin."""
    angle = flat[..., 1] / RADIUS
    normal = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=-1)
    return np.concatenate([flat[..., :1], RADIUS * normal[..., 1:]], axis=-1), normal


def walk(rng: np.random.Generator, drift: float):
    """A random field that differs by so much over a metre, along each axis; it walks."""
    waves = rng.normal(0, 1, (64, 2)) * np.exp(rng.uniform(-2, 1.5, (64, 1)))
    share = 1 / np.linalg.norm(waves, axis=1) ** 1.5
    probe = rng.uniform(0, 5, (400, 2))
    turn = rng.uniform(0, 2 * np.pi, 400)
    beside = probe + np.stack([np.cos(turn), np.sin(turn)], -1)
    phases, signs = rng.uniform(0, 2 * np.pi, (3, 64)), rng.normal(0, 1, (3, 64)) * share

    def field(flat):
        return np.stack(
            [np.sin(flat @ waves.T + p) @ s for p, s in zip(phases, signs, strict=True)], -1
        )

    scale = drift / np.std(field(beside) - field(probe))
    return lambda flat: scale * field(flat)


def survey(
    name: str,
    rng: np.random.Generator,
    skin: Skin,
    there: np.ndarray,
    errors: Errors,
    larger: float,
) -> SurveyResult:
    pose = Pose.from_rpy(
        [*rng.normal(0, 0.03, 2), rng.uniform(-np.pi, np.pi)], rng.uniform(-20, 20, 3)
    )
    field, missed = walk(rng, errors.drift), rng.uniform(0.5, 5.0)
    dents = []

    def seen(flat):
        return np.abs(flat[..., 0] - missed) > 0.05

    def off(size, sigma):
        error = rng.normal()
        if errors.tail:
            error = rng.standard_t(errors.tail) / np.sqrt(errors.tail / (errors.tail - 2))
        return Estimate(float(larger * size + errors.off * sigma * error), float(sigma))

    for index in np.flatnonzero(there & seen(skin.places)):
        flat = skin.places[index]
        place, normal = on_fuselage(flat)
        place = place + field(flat) + rng.normal(0, PLACE, 3)
        dent = make_dent(
            pose.apply(place),
            normal=pose.rotation.apply(normal),
            axis=pose.rotation.apply([1.0, 0, 0]),
        )
        width = skin.width[index]
        sigmas = 2e-7 / width, 1e-5 / width, 1e-5 / width
        sizes = skin.depth[index], skin.length[index], width
        depth, length, across = (off(size, s) for size, s in zip(sizes, sigmas, strict=True))
        dent = replace(dent, depth=depth, length=length, width=across)
        about = None if errors.depths else relief(rng, sizes, larger, PLACE)
        dents.append(SurveyedDent(int(index), dent, np.eye(3) * 1e-6, 5, about))
    grid = np.stack(
        np.meshgrid(*(np.arange(CELL / 2, size, CELL) for size in SKIN), indexing='ij'), -1
    ).reshape(-1, 2)
    grid = grid[seen(grid)]
    cells = pose.apply(on_fuselage(grid)[0] + field(grid))
    count = len(cells)
    coverage = CoverageCells(
        CELL,
        cells.astype(np.float32),
        np.full(count, FINDABLE, np.float32),
        np.full(count, 1e-5, np.float32),
        np.full(count, 3),
        np.zeros(count, int),
    )
    return SurveyResult(name, (), 0, 'map', tuple(dents), coverage=coverage)


def relief(rng: np.random.Generator, sizes: tuple, larger: float, place: float) -> DentRelief:
    """The skin about a dent of a depth, length and width, seen from a little beside it."""
    depth, length, width = sizes
    columns, rows = (round((0.75 * size + 0.006) / POINT) for size in (length, width))
    a, b = DentRelief(POINT, np.zeros((2 * rows + 1, 2 * columns + 1), np.float32)).places()
    x, y = (each + off for each, off in zip((a, b), rng.normal(0, place, 2), strict=True))
    form = np.exp(-4 * np.log(10) * ((x / length) ** 2 + (y / width) ** 2))
    noise = gaussian_filter(rng.normal(size=a.shape), CORRELATED)
    noise *= NOISE * 2 * np.sqrt(np.pi) * CORRELATED
    heights = -(y**2) / (2 * RADIUS) - larger * depth * form + noise
    return DentRelief(POINT, heights.astype(np.float32))


def trial(seed: int, errors: Errors) -> Counter:
    rng = np.random.default_rng(seed)
    before = skin(rng, DENTS + NEW)
    indices = np.arange(DENTS + NEW)
    grown, repaired = indices < GROWN, (indices >= GROWN) & (indices < GROWN + REPAIRED)
    new = indices >= DENTS
    after = replace(before, depth=before.depth + GROWTH * grown)
    earlier = survey('a', rng, before, ~new, errors, 1.0)
    later = survey('b', rng, after, ~repaired, errors, LARGER)
    seen = [{each.number for each in one.dents} for one in (earlier, later)]
    told: Counter = Counter()
    for each in compare(earlier, later).dents:
        numbers = {d.number for d in (each.earlier, each.later) if d is not None}
        if len(numbers) > 1:
            told['two dents taken for one'] += 1
            continue
        (number,) = numbers
        if number in seen[0] and number in seen[1]:
            true = 'grown' if grown[number] else 'known'
        elif new[number]:
            true = 'new'
        elif repaired[number]:
            true = 'repaired'
        else:
            true = 'not seen' if number in seen[0] else 'first seen'
        told[true, each.status] += 1
        for change in each.changes:
            truth = GROWTH * (grown[number] and change.quantity == 'depth')
            told[
                'interval', change.quantity, abs(change.estimate.value - truth) < change.half
            ] += 1
    return told


def rendered(folder: Path, seed: int) -> None:
    """Two flights from photographs to the comparison."""
    rng = np.random.default_rng(seed)
    # Only this needs ROS.
    from flight_bags import ERRING, EVERY_NS, START_NS, record_flight

    world = replace(read_world('shipped:scene.yaml', START_NS), errors=ERRING, seed=seed)
    flight, numbers = world.flight, count()
    deep = sum(len(panel.dents) for panel in world.surface.panels)
    *grown, repaired = rng.permutation(deep)[: GROWN + 1].tolist()
    print(f'of the dents of scene.yaml, from 0: {sorted(grown)} grow, {repaired} is repaired')
    panels = tuple(
        replace(
            panel,
            dents=tuple(
                replace(dent, depth=dent.depth + GROWTH * (number in grown))
                for dent, number in zip(panel.dents, numbers, strict=False)
                if number != repaired
            ),
        )
        for panel in world.surface.panels
    )
    elsewhere = rng.normal(0, 0.03, 3)
    middle = Pose(flight.middle.rotation, flight.middle.translation + elsewhere)
    after = replace(
        world,
        surface=replace(world.surface, panels=panels),
        flight=replace(flight, middle=middle),
        errors=replace(ERRING, offset=tuple(rng.normal(0, 0.2, 3)), yaw=0.03),
        photometry=replace(world.photometry, ambient=0.08, exposure=0.85),
        seed=seed + 1,
    )
    for name, seen, late_ns in (('before', world, 0), ('after', after, 230_000_000)):
        if not (folder / f'{name}_bag').exists():
            stamps = [START_NS + EVERY_NS * (k + 1) + late_ns for k in range(RENDERED_CLOUDS)]
            record_flight(folder / f'{name}_bag', seen, tqdm(stamps, unit='photograph'))
        words = [str(folder / f'{name}_bag'), '--output', str(folder / name), '--name', name]
        words += ['--store', str(folder / STORE), '--rig', 'shipped:rig.yaml']
        if name not in SurveyStore(folder / STORE).names() and command(['survey', *words]):
            raise SystemExit(2)
    surveys = [f'{folder / STORE}:{name}' for name in ('before', 'after')]
    raise SystemExit(command(['compare', *surveys, '--output', str(folder / 'comparison')]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--first', type=int, default=700)
    parser.add_argument('--drift', type=float, default=0.3, help='mm over the first metre')
    parser.add_argument('--off', type=float, default=0.6, help='parts of what is stated')
    parser.add_argument('--tail', type=float, default=0.0, help='degrees of freedom')
    parser.add_argument('--depths', action='store_true', help='no skin is kept about the dents')
    parser.add_argument('--rendered', type=Path, metavar='FOLDER')
    arguments = parser.parse_args()
    if arguments.rendered:
        rendered(arguments.rendered, arguments.first)
    errors = Errors(arguments.drift * 1e-3, arguments.off, arguments.tail, arguments.depths)
    told: Counter = Counter()
    for seed in tqdm(range(arguments.first, arguments.first + arguments.seeds), unit='pair'):
        told += trial(seed, errors)
    for key in sorted(k for k in told if isinstance(k, tuple) and k[0] != 'interval'):
        # What is left open is no false statement.
        mark = '' if key[0] == key[1] else '   WRONG' if key[1] not in OPEN else '   left open'
        print(f'{key[0]:12} told {key[1]:12} {told[key]:6}{mark}')
    print(f'two dents taken for one: {told["two dents taken for one"]}')
    for quantity in ('depth', 'length', 'width'):
        inside, outside = (told['interval', quantity, yes] for yes in (True, False))
        print(f'{quantity}: {100 * inside / (inside + outside):.1f} % of 95 % intervals are true')


if __name__ == '__main__':
    main()
