"""What is left of the code in the cloud: the spectrum of the phase's error along the fringes.

python benchmarks/ripple.py [--seed 0]

Bare panels, clean light. The error is averaged over all rows by its place in the pattern, four
places a fringe, so that what goes with the code adds up and all else averages out. Printed is the
root mean square in milliradians by the ripple's length in fringes; the code's own are 2 to 16. The
error of 1 mrad is given in micrometres of depth. A lens out of focus is blurred by up to twice
the usual variance towards one side of the image, which no part of the method is told.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scenes import CLEAN, FAR, FIELD, NEAR, PATTERN
from tqdm import tqdm

from ftp_dent_ros.pattern.pattern import CODES
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor
from ftp_dent_ros.rig.rig import Rig
from ftp_dent_ros.simulation import Panel, Photometry, Renderer, Surface

RIGS = {'0.6 m': (NEAR, 0.6), '0.8 m': (FIELD, 0.8), '1.2 m': (FAR, 1.2), '1.5 m': (FIELD, 1.5)}
# Angle about the camera's y axis, degrees, and defocus on the left and right, projector pixels.
VARIANTS = {
    'facing': (0.0, 0.7, 0.7),
    'inclined': (12.0, 0.7, 0.7),
    'in focus': (0.0, 0.4, 0.4),
    'out of focus': (0.0, 1.0, 1.0),
    'focus varies': (0.0, 0.7, 1.0),
}
PER_FRINGE = 4
BANDS = ((2, 4), (4, 8), (8, 16), (16, 64))


def photograph(rig: Rig, surface: Surface, pattern, distance, defocus, seed: int) -> NDArray:
    """Picture of a surface, out of focus by so many pixels on the left and on the right."""
    sides = [
        Renderer(
            rig,
            pattern.draw(),
            replace(Photometry(reference_distance=distance), **CLEAN, defocus_px=blur),
        ).render(surface, np.random.default_rng(seed))
        for blur in dict.fromkeys(defocus)
    ]
    if len(sides) == 1:
        return sides[0]
    share = np.linspace(0, 1, rig.camera.width)[None, :, None]
    return np.rint((1 - share) * sides[0] + share * sides[1]).astype(np.uint8)


def figures(rig: Rig, distance: float, variant: str, code: str, seed: int) -> list[float]:
    """Root mean squares by band, milliradians, and micrometres of depth that 1 mrad is."""
    angle, *defocus = VARIANTS[variant]
    pose = Pose.from_rpy((0.03, math.radians(angle), 0.02), (0, 0, distance))
    surface = Surface((Panel(pose, (-0.9, 0.9, -0.9, 0.9)),))
    pattern = replace(PATTERN, code=code)
    image = photograph(rig, surface, pattern, distance, defocus, seed)
    cloud = Reconstructor(rig, pattern).measure(image).cloud
    rays = rig.camera.rays(rig.camera.pixel_grid())
    depth = surface.intersect(rays)
    true, seen = (
        pattern.phase(rig.projector.project(rig.to_projector(points))[..., 0])
        for points in (rays * depth[..., None], cloud.points)
    )
    # Away from the frame's rims, where there is no fringe on one side.
    inner = (
        cloud.valid & (true > true[cloud.valid].min() + 25) & (true < true[cloud.valid].max() - 25)
    )
    inner[: rig.camera.height // 10] = inner[-rig.camera.height // 10 :] = False
    error = (seen - true)[inner]
    place = np.floor(true[inner] * (PER_FRINGE / (2 * np.pi))).astype(int)
    place -= place.min()
    count = np.bincount(place)
    mean = np.bincount(place, error) / np.maximum(count, 1)
    mean = mean[count > 0.2 * np.median(count)]
    mean -= np.polynomial.Polynomial.fit(np.arange(len(mean)), mean, 3)(np.arange(len(mean)))
    power = np.square(np.abs(np.fft.rfft(mean))) * 2 / len(mean) ** 2
    length = PER_FRINGE * np.fft.rfftfreq(len(mean), 1.0)
    rms = [
        1e3 * math.sqrt(power[(length > 1 / longest) & (length <= 1 / shortest)].sum())
        for shortest, longest in BANDS
    ]
    baseline = float(np.linalg.norm(rig.projector_centre))
    focal = rig.projector.camera_matrix[0, 0]
    micrometres = 1e3 * pattern.period_px / (2 * math.pi) * distance**2 / (focal * baseline)
    return [*rms, micrometres]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--only', default='', help='part of the names of the rows wanted')
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    tasks = [
        (rig, variant, code)
        for rig in RIGS
        for variant in VARIANTS
        for code in CODES
        if arguments.only in f'{rig} {variant} {code}'
    ]
    rows = [
        (f'{rig} {variant}', code, figures(*RIGS[rig], variant, code, arguments.seed))
        for rig, variant, code in tqdm(tasks, unit='photograph')
    ]
    bands = ''.join(f'{f"{a} to {b}":>10}' for a, b in BANDS)
    print(f'{"fringes":24}{"":10}{bands}{"um/mrad":>10}')
    for name, code, values in rows:
        print(f'{name:24}{code:10}' + ''.join(f'{value:10.2f}' for value in values))


if __name__ == '__main__':
    main()
