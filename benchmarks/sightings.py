"""Dents that several photographs show: errors of their combined sizes over what is stated.

python benchmarks/sightings.py [--flights 8] [--clouds 8] [--seed 5000]

A flight photographs one skin from places 10 cm apart and 0.7 to 0.9 m away, turned by a few
degrees: clean, dirty (10 %), wavy (0.1 mm) and glossy skins in turn, with nine dents of nine
families each. Poses are exact, so that the list has nothing to confuse. Told are the root mean
square of error / stated of single sightings, and of what the list combines of two or more.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict
from dataclasses import replace

import cv2
import numpy as np
from dent_shapes import FAMILIES, SIZES
from kind_scenes import CAMERA, PATTERN, scene
from tqdm import tqdm

from ftp_dent_ros.dents.dent_list import EXACT, DentList
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.evaluation.scenes import make_rig
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.simulation import Dent, Dirt, Paint, Panel, waviness
from ftp_dent_ros.simulation.truth import true_dents

SKINS = 'clean', 'dirty', 'wavy', 'glossy'
RIG = make_rig(0.8, 0.24, CAMERA, 1890.0)
# Of the places, metres: from one to the next, and their scatter; of their turns, radians.
_STEP, _SCATTER, _TURN = 0.1, 0.02, 0.03
_REACH = np.array([0.3, 0.12])
# Those with sizes that are whole: a double's are not, and gouges are told by their marks.
_FAMILIES = tuple(name for name in FAMILIES if name not in ('double', 'gouge'))

# Of a dent: name of the skin, how many sightings, error / stated of depth, length and width.
Row = tuple[str, int, tuple[float, ...]]


def skin_of(seed: int) -> tuple[str, Panel]:
    """A skin with dents, as the first camera sees it."""
    rng = np.random.default_rng([seed, 17])
    name = SKINS[seed % len(SKINS)]
    dents: list[Dent] = []
    for family in _FAMILIES:
        (dent,) = FAMILIES[family](rng)
        radius = dent.size_at(0.1)[0] / 2
        for _ in range(200):
            x, y = map(float, rng.uniform(-1, 1, 2) * _REACH)
            if all(
                math.hypot(x - d.x, y - d.y) > 1.6 * (radius + d.size_at(0.1)[0] / 2)
                for d in dents
            ):
                dents.append(replace(dent, x=x, y=y))
                break
    marks = (Dirt(0.1, seed=seed),) if name == 'dirty' else ()
    panel = Panel(
        Pose.from_rpy((0, 0, 0), (0, 0, 0.8)),
        (-2, 2, -2, 2),
        paint=Paint(roughness=0.2 if name == 'glossy' else 0.0, marks=marks),
        dents=tuple(dents),
        waves=waviness(1e-4, 0.12, seed) if name == 'wavy' else (),
    )
    return name, panel


def flight(seed: int, clouds: int) -> tuple[list[Row], list[Row]]:
    """Of single sightings, and of what the list makes of them."""
    name, panel = skin_of(seed)
    rng = np.random.default_rng([seed, 18])
    reconstructor = Reconstructor(RIG, PATTERN, Settings(stride=2))
    listed = DentList()
    for number in range(clouds):
        along = _STEP * (number - (clouds - 1) / 2)
        place = np.array([along, 0, rng.uniform(-0.1, 0.1)]) + rng.normal(0, _SCATTER, 3)
        camera = Pose.from_rpy(rng.normal(0, _TURN, 3), place)
        seen = replace(panel, pose=camera.inverse() @ panel.pose)
        try:
            one = scene(seen, rig=RIG)
            measured = reconstructor.measure(one.photograph(1000 * seed + number), True)
            found = inspect(measured.cloud)
        except FtpDentError:
            continue
        dents = [dent.transformed(camera) for dent in (*found.dents, *found.others)]
        listed.add(number + 1, dents, camera, EXACT)
    single: list[Row] = []
    together: list[Row] = []
    for true in true_dents(scene(panel, rig=RIG).surface):
        for entry in listed.entries:
            away = np.linalg.norm(entry.dent.position - true.position)
            if away > true.width / 3 or entry.dent.kind in ('other', 'step') or entry.dent.is_cut:
                continue
            whole = [s.dent for s in entry.sightings if not s.dent.is_cut]
            single += [(name, 1, normalised(dent, true)) for dent in whole]
            if len(whole) > 1:
                together.append((name, len(whole), normalised(entry.dent, true)))
    return single, together


def normalised(dent, true) -> tuple[float, ...]:
    """Errors over stated uncertainties."""
    return tuple(
        (getattr(dent, name).value - getattr(true, name)) / getattr(dent, name).uncertainty
        for name in SIZES
    )


def line(rows: list[Row]) -> str:
    """Root mean squares, and the share within 1.96."""
    errors = np.array([row[2] for row in rows], float)
    errors = errors[np.isfinite(errors).all(axis=1)]
    rms = np.sqrt(np.square(errors).mean(axis=0))
    held = 100 * (np.abs(errors) < 1.96).mean(axis=0)
    cells = [f'{len(errors)}', *(f'{value:.2f}' for value in rms), *(f'{h:.0f}' for h in held)]
    return ''.join(f'{cell:>9}' for cell in cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--flights', type=int, default=8)
    parser.add_argument('--clouds', type=int, default=8, help='a flight')
    parser.add_argument('--seed', type=int, default=5000, help='of the first flight')
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    table: dict[str, list[Row]] = defaultdict(list)
    for step in tqdm(range(arguments.flights), unit='flight'):
        single, together = flight(arguments.seed + step, arguments.clouds)
        table['each sighting'] += single
        table['combined'] += together
        table['combined of 4 and more'] += [row for row in together if row[1] > 3]
        for row in together:
            table[f'combined, {row[0]}'].append(row)
    head = 'n', *SIZES, 'held, %', '', ''
    print(f'{"error / stated, rms":24}' + ''.join(f'{name:>9}' for name in head))
    for name, rows in table.items():
        if rows:
            print(f'{name:24}{line(rows)}')


if __name__ == '__main__':
    main()
