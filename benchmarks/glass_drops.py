"""Drops on the camera's glass during a recorded flight: what is listed, and what is told of them.

python benchmarks/glass_drops.py BAG [--drops 3] [--seed 5100] [--every 1]

Bends the photographs of a bag as drops out of focus do, the same way in each, reconstructs and
inspects them by the poses of the bag, and lists the dents as `ftp-dent inspect` does; once without
drops. A bag of `benchmarks/survey_hail.py` or of the demonstration serves.
"""

from __future__ import annotations

import argparse

import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from ftp_dent_ros.dents.dent_list import DentList
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.files import find
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.recording.clouds import bag_clouds
from ftp_dent_ros.recording.reader import open_bag
from ftp_dent_ros.rig.rig import read_rig

# What is nearer in the picture to a drop than so many of its radii is of it; and two entries that
# are so near, metres, are one.
_OF_DROP, _SAME = 2.0, 0.01


def drops(
    shape: tuple[int, int], count: int, seed: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], list[tuple[float, float, float]]]:
    """Columns and rows that pixels show, and the drops: row, column, radius; pixels."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    from_column, from_row, places = columns.copy(), rows.copy(), []
    for _ in range(count):
        row, column = (rng.uniform(0.2, 0.8) * size for size in shape)
        radius, strength = rng.uniform(25, 60), rng.uniform(1, 5)
        x, y = (columns - column) / radius, (rows - row) / radius
        weight = strength * np.exp(-(x * x + y * y))
        from_column, from_row = from_column + weight * x, from_row + weight * y
        places.append((row, column, radius))
    return from_column.astype(np.float32), from_row.astype(np.float32), places


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('bag')
    parser.add_argument('--drops', type=int, default=3)
    parser.add_argument('--seed', type=int, default=5100)
    parser.add_argument('--every', type=int, default=1, help='use every n-th photograph')
    arguments = parser.parse_args()
    rig, pattern = read_rig(find('shipped:rig.yaml')), read_pattern(find('shipped:pattern.yaml'))
    reconstructor = Reconstructor(rig, pattern, Settings(stride=2))
    bag = open_bag(arguments.bag)
    plain, dropped = DentList(), DentList()
    places: list[tuple[float, float, float]] = []
    for number, item in enumerate(tqdm(bag_clouds(bag), unit='photograph')):
        if number % arguments.every or item.pose is None or item.photograph is None:
            continue
        image = item.photograph
        columns, rows, places = drops(image.shape[:2], arguments.drops, arguments.seed)
        bent = cv2.remap(image, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        for entries, seen in ((plain, image), (dropped, bent)):
            try:
                found = inspect(reconstructor.measure(seen).cloud)
            except FtpDentError as reason:
                print(f'photograph {number}: {reason}')
                continue
            dents = [each.transformed(item.pose) for each in (*found.dents, *found.others)]
            entries.add(number, dents, item.pose, item.covariance, stamp_ns=item.stamp_ns)
    truth = [each for each in plain.entries if each.dent.kind == 'dent']
    print(f'without drops: {_counts(plain)}; {len(plain.glass)} marks told')
    print(f'with {len(places)} drops: {_counts(dropped)}; {len(dropped.glass)} marks told')
    camera = rig.camera.camera_matrix
    for spot in dropped.glass:
        pixel = camera[:2, :2] @ spot.bearing + camera[:2, 2]
        near = [np.hypot(pixel[1] - row, pixel[0] - column) / r for row, column, r in places]
        print(
            f'  mark at pixel {pixel[0]:.0f}, {pixel[1]:.0f}, {min(near):.1f} radii off a drop, '
            f'seen {len(spot.seen)} times from {len(spot.cameras)} places'
        )
    dents = [each.dent for each in dropped.entries if each.dent.kind == 'dent']
    false = sum(
        all(np.linalg.norm(each.position - t.dent.position) > _SAME for t in truth)
        for each in dents
    )
    print(f'  {len(dents)} dents of {len(truth)} without drops; {false} are not there without')


def _counts(entries: DentList) -> str:
    dents = sum(each.dent.kind == 'dent' for each in entries.entries)
    return f'{dents} dents, {len(entries.entries) - dents} others'


if __name__ == '__main__':
    main()
