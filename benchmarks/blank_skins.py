"""What is listed on skins that have nothing, of each kind of skin.

python benchmarks/blank_skins.py [--photographs 96] [--seed 800000] [--smallest-depth 0.1]

Blank photographs as `ftp-dent evaluate --pod` takes them (eight skins, three distances, three
lights), of other numbers. "Dents" are those that are listed, "others" is whatever else is but
steps, both with their number per square metre of skin that was measured. What lies on a fitting,
as a domed rivet's head that stands out by a millimetre, is counted apart: there is something.
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import cv2
import numpy as np
from tqdm import tqdm

from ftp_dent_ros.dents.dent import SmallestDent
from ftp_dent_ros.errors import FtpDentError
from ftp_dent_ros.evaluation.detection import area_of, reconstructor_at, scene_of
from ftp_dent_ros.inspection.measuring.inspection import inspect

# A fitting's groove and what the fringes make of it end within so many of its radii.
_REACH = 2.5


def on_fitting(panel, position) -> bool:
    """Whether a place is on one of a panel's fittings, or beside it."""
    x, y, _ = panel.pose.inverse().apply(position)
    return any(
        np.hypot(each.x - x, each.y - y) < _REACH * each.radius
        for each in panel.near(np.array([x]), np.array([y])).rivets
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--photographs', type=int, default=96)
    parser.add_argument('--seed', type=int, default=800000, help='number of the first')
    parser.add_argument('--smallest-depth', type=float, default=0.1, help='mm')
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    settings = SmallestDent(smallest_depth=arguments.smallest_depth / 1e3)
    table: dict[str, list[float]] = defaultdict(lambda: [0.0] * 5)
    said = []
    for step in tqdm(range(arguments.photographs), unit='photograph'):
        index = arguments.seed + step
        distance, skin, light, scene = scene_of(-index)
        try:
            cloud = reconstructor_at(distance).measure(scene.photograph(index), True).cloud
        except FtpDentError:
            continue
        found = inspect(cloud, settings)
        panel = scene.surface.panels[0]
        counts = [1.0, area_of(cloud.points), 0.0, 0.0, 0.0]
        for dent in (*found.dents, *found.others):
            if dent.kind == 'step':
                continue
            if on_fitting(panel, dent.position):
                counts[4] += 1
                continue
            counts[2 + (dent.kind != 'dent')] += 1
            depth, length, width = (1e3 * e.value for e in (dent.depth, dent.length, dent.width))
            said.append(
                f'{index}: {distance} m, {skin}, {light}: {dent.kind} of {depth:+.2f} +- '
                f'{1e3 * dent.depth.uncertainty:.2f} mm, {length:.0f} x {width:.0f} mm '
                f'{dent.reason}'
            )
        for key in (skin, light, 'all'):
            table[key] = [a + b for a, b in zip(table[key], counts, strict=True)]
    print(f'{"":14}{"views":>7}{"m2":>7}{"dents":>7}{"others":>8}{"per m2":>8}{"on fittings":>13}')
    for key, (views, area, dents, others, fittings) in table.items():
        rate = (dents + others) / max(area, 1e-9)
        print(
            f'{key:14}{views:>7.0f}{area:>7.2f}{dents:>7.0f}{others:>8.0f}{rate:>8.2f}'
            f'{fittings:>13.0f}'
        )
    print('\n'.join(said))


if __name__ == '__main__':
    main()
