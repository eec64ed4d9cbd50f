"""What depth of a dent on dirt one photograph can tell at best, and what the clouds know of it.

python benchmarks/dirt_limit.py [--photographs 2] [--seed 43100] [--code contrast]

Fringes of frequency w and contrast c on an albedo 1 + a, with a small, shifted by d, make of each
frequency q + n w (in skin coordinates, n a whole number)

    I_n = a(q + n w) + c / 2 (a(q + (n - 1) w) + a(q + (n + 1) w)) + J_n d(q) + noise,
    J_1 = i c / 2, J_-1 = -i c / 2, all others 0.

Of an albedo of known spectrum and pixels of known noise, the covariance C of the I_n is known, and
no unbiased linear estimate of d has less variance than 1 / (J* C^-1 J) (Gauss and Markov). Of a
Gaussian dent, whose spectrum is D(q) per metre of depth, no filter tells the depth with less than

    1 / variance = integral of |D|^2 (J* C^-1 J) dq / (2 pi)^2.

"bound" is its root, with the spectrum that the simulator's dirt has and under the red stripe: no
linear detector knows more. "depth" is 7.3 bounds: a threshold of six finds 90 % of what is so
deep. Skins have 15 dents as deep, 0.1 mm at least ("dents"): "cloud" is the root mean square of
Gaussians as wide, fitted to the cloud's errors there, "found" how many of them the inspection
lists as dents, and "z" the root mean square of all points' errors over their sigma.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from kind_scenes import CAMERA, PATTERN, by_contour, light
from numpy.typing import NDArray

from ftp_dent_ros.dents.dent import SmallestDent as Looked
from ftp_dent_ros.evaluation.detection import DISTANCES, LIGHTS
from ftp_dent_ros.evaluation.scenes import PATTERN as OF_TRIALS
from ftp_dent_ros.evaluation.scenes import Scene, make_rig
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.measuring.places.evidence import TENTH
from ftp_dent_ros.pattern.pattern import CODES, Pattern
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.simulation import Dirt, Paint, Panel, Photometry
from ftp_dent_ros.simulation.dents import Gaussian
from ftp_dent_ros.simulation.truth import match_truth, true_dents

BASELINE, STRIDE = 0.24, 2
# A threshold of six, and what 90 % of a normal distribution lie above.
SURE = 6 + 1.2816
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
# Harmonics of the fringes, and samples of a dent's frequencies along each axis.
_HARMONICS, _SAMPLES = 4, 33
# Of a correlation that is half at half of a width: standard deviation of the blur of white noise.
_BLUR = 0.25 / math.sqrt(math.log(2))
# Standard deviations that 99 % of a normal distribution lie within.
_WITHIN = 2.576
# Places along u that contrast and noise are taken at, and the limits' mean variance is of, as
# shares of the picture; and the side of each, pixels.
_PLACES, _PART = (0.2, 0.35, 0.5, 0.65, 0.8), 128
# Of the dents, as shares of the distance.
_COLUMNS, _ROWS = (-0.22, -0.11, 0.0, 0.11, 0.22), (-0.1, 0.0, 0.1)
# Of the dirt; the smallest depth that is looked for, and of the dents, metres.
CONTRAST, LEAST, SHALLOWEST = 0.25, 5e-5, 1e-4


@dataclass(frozen=True)
class Case:
    """A rig, a pattern and a light, and the widths of dents that are asked for, metres."""

    name: str
    distance: float
    camera: tuple[int, int, float]
    focal: float
    pattern: Pattern
    photometry: Photometry
    widths: tuple[float, ...]

    def scene(self, contrast: float, seed: int, width: float = 0.0, depth: float = 0.0) -> Scene:
        """Skin with dirt, if that has a contrast, and with dents, if they have a width."""
        rng = np.random.default_rng([seed, 4311])
        pose = Pose.from_rpy(tuple(rng.normal(0, 0.05, 3)), (0, 0, self.distance))
        dirt = (Dirt(contrast, seed=int(rng.integers(1 << 30))),) if contrast else ()
        dents = tuple(
            by_contour(self.distance * x, self.distance * y, width, width, depth, 0.0, Gaussian())
            for x in _COLUMNS
            for y in _ROWS
            if width
        )
        panel = Panel(pose, (-1, 1, -1, 1), dents=dents, paint=Paint(marks=dirt))
        rig = make_rig(self.distance, BASELINE, self.camera, self.focal)
        return Scene(rig, (panel,), self.photometry)


def cases() -> Iterator[Case]:
    """Hail as `kinds.py` has it, and the photographs of `ftp-dent evaluate --pod`."""
    hail = light(reference_distance=0.8)
    yield Case('hail, 0.8 m', 0.8, CAMERA, 1890.0, PATTERN, hail, (0.010, 0.015, 0.025))
    for distance in DISTANCES:
        for name, options in LIGHTS.items():
            photometry = Photometry(reference_distance=distance, **options)
            camera = 1280, 720, 1530.0
            words = f'{distance} m, {name}', distance, camera, 1810.0, OF_TRIALS
            yield Case(*words, photometry, (0.030,))


@dataclass(frozen=True)
class Fringes:
    """What is seen of the fringes at one place of a clean skin.

    Attributes
    ----------
    frequency : float
        Radians a metre of skin.
    slope : float
        Radians a metre of depth.
    contrast : float
        Before the camera blurs it.
    noise : float
        Power density of the pixels' over the level, square metres.
    pixel : float
        Of the camera, metres of skin.
    blur : float
        Standard deviation of its lens's, metres of skin.
    """

    frequency: float
    slope: float
    contrast: float
    noise: float
    pixel: float
    blur: float

    @classmethod
    def of(cls, case: Case) -> list[Fringes]:
        """At several places, of two photographs of a clean skin."""
        scene = case.scene(0.0, 0)
        one, other = (scene.photograph(seed, case.pattern).astype(np.float32) for seed in (1, 2))
        return [cls._at(case, scene, place, one, other) for place in _PLACES]

    @classmethod
    def _at(cls, case, scene, place, one, other) -> Fringes:
        rig, turn = scene.rig, 2 * math.pi / case.pattern.period_px
        column = round(place * rig.camera.width) - _PART // 2
        row = (rig.camera.height - _PART) // 2
        part = slice(row, row + _PART), slice(column, column + _PART)
        rays = rig.camera.rays(rig.camera.pixel_grid()[part].astype(float))
        depth = scene.surface.intersect(rays)[..., None]

        def phase(points):
            return turn * rig.projector.project(rig.to_projector(points))[..., 0]

        here, small = phase(rays * depth), 1e-5
        frequency = abs(float(np.mean(phase(rays * depth + [small, 0, 0]) - here))) / small
        slope = abs(float(np.mean(phase(rays * (depth + small)) - here))) / small
        # Red fringes are whole in the stripe too.
        terms = np.stack([np.ones_like(here), np.cos(here), np.sin(here)], axis=-1)
        level, *waves = np.linalg.lstsq(terms.reshape(-1, 3), one[part][..., 0].ravel())[0]
        grey, again = (each[part] @ _LUMA for each in (one, other))
        noise = float(np.std(grey - again) / math.sqrt(2) / grey.mean())
        pixel = case.distance / case.camera[2]
        lens = pixel * case.photometry.psf_px
        fringes = cls(frequency, slope, 1.0, (noise * pixel) ** 2, pixel, lens)
        contrast = math.hypot(*waves) / level / float(fringes.shown(np.array(frequency)))
        return replace(fringes, contrast=contrast)

    def shown(self, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the camera shows of waves along u: its lens's blur, its pixels, none beyond."""
        left = np.exp(-((frequency * self.blur) ** 2) / 2)
        left = left * np.sinc(frequency * self.pixel / (2 * math.pi))
        return left * (frequency < math.pi / self.pixel)


def spectrum(frequency: NDArray[np.float64], dirt: Dirt) -> NDArray[np.float64]:
    """Power density of dirt at frequencies in radians a metre, square metres."""
    variance = (dirt.contrast / _WITHIN) ** 2 / len(dirt.scales)
    blurs = [_BLUR * scale for scale in dirt.scales]
    parts = [4 * math.pi * b * b * np.exp(-((frequency * b) ** 2)) for b in blurs]
    return variance * np.sum(parts, axis=0)


def limit(fringes: Fringes, dirt: Dirt, width: float) -> float:
    """Variance of a dent's depth by the best estimate, square metres."""
    w, c, spread = fringes.frequency, fringes.contrast, width / TENTH
    order = np.arange(-_HARMONICS, _HARMONICS + 1)
    wider = np.arange(-_HARMONICS - 1, _HARMONICS + 2)
    mixing = np.eye(len(order), len(wider), 1)
    mixing += c / 2 * (np.eye(len(order), len(wider)) + np.eye(len(order), len(wider), 2))
    # With the factor i of both left out, all is real.
    shift = c / 2 * ((order == 1).astype(float) - (order == -1))
    axis = np.linspace(-4, 4, _SAMPLES) / spread
    information = 0.0
    for along in axis:
        shown = fringes.shown(np.abs(along + order * w))
        seen = shift * shown
        for across in axis:
            power = spectrum(np.hypot(along + wider * w, across), dirt)
            covariance = (mixing * power) @ mixing.T * np.outer(shown, shown)
            covariance += fringes.noise * np.eye(len(order))
            dent = math.exp(-(along**2 + across**2) * spread**2 / 2)
            energy = (2 * math.pi * spread**2 * dent * fringes.slope) ** 2
            information += energy * float(seen @ np.linalg.solve(covariance, seen))
    return (2 * math.pi / (axis[1] - axis[0])) ** 2 / information


def at_dents(scene: Scene, pattern: Pattern, seed: int) -> tuple[list[float], int, float]:
    """Errors of the depths of a scene's dents, metres, how many are found, mean square of z."""
    measure = Reconstructor(scene.rig, pattern, Settings(stride=STRIDE)).measure
    cloud = measure(scene.photograph(seed, pattern), True).cloud
    known = cloud.valid
    points = np.where(known[..., None], cloud.points, 1.0)
    error = scene.error(points)
    on_panel = scene.panel.pose.inverse().apply(points)
    cell = float(np.nanmedian(np.linalg.norm(np.diff(cloud.points, axis=1), axis=-1)))
    errors = []
    for dent in scene.panel.dents:
        square = np.square(on_panel[..., 0] - dent.x) + np.square(on_panel[..., 1] - dent.y)
        spread = dent.size_at(0.1)[0] / TENTH
        near = known & (square < (TENTH * spread) ** 2)
        shape = np.exp(-square[near] / (2 * spread**2))
        energy = float(np.square(shape).sum())
        # Of what is not measured there is no error.
        if energy * cell**2 > math.pi * spread**2 / 2:
            errors.append(float((error[near] * shape).sum()) / energy)
    truth = true_dents(scene.surface)
    listed = [each.position for each in inspect(cloud, Looked(smallest_depth=LEAST)).dents]
    positions, reach = [t.position for t in truth], [t.width / 2 for t in truth]
    normalised = float(np.mean(np.square(error[known] / cloud.sigma[known])))
    return errors, len(match_truth(listed, positions, reach)), normalised


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--photographs', type=int, default=2, help='of a rig and light')
    parser.add_argument('--seed', type=int, default=43100, help='of the first')
    parser.add_argument('--code', choices=CODES, default='stripe', help='of the pattern measured')
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    print('millimetres')
    head = 'fringe', 'contrast', 'bound', 'depth', 'dents', 'cloud', 'found', 'z'
    print(f'{"":22}' + ''.join(f'{name:>9}' for name in head))
    dirt = Dirt(CONTRAST)
    seeds = range(arguments.seed, arguments.seed + arguments.photographs)
    for case in cases():
        places = Fringes.of(case)
        middle = places[len(places) // 2]
        pattern = replace(case.pattern, code=arguments.code)
        for width in case.widths:
            bound = math.sqrt(np.mean([limit(at, dirt, width) for at in places]))
            depth = max(SURE * bound, SHALLOWEST)
            scenes = [(case.scene(CONTRAST, seed, width, depth), seed) for seed in seeds]
            seen = [at_dents(scene, pattern, seed) for scene, seed in scenes]
            errors = np.concatenate([each for each, *_ in seen])
            total = sum(len(scene.panel.dents) for scene, _ in scenes)
            cells = [f'{2e3 * math.pi / middle.frequency:.2f}', f'{middle.contrast:.2f}']
            cells += [f'{1e3 * bound:.4f}', f'{1e3 * SURE * bound:.3f}', f'{1e3 * depth:.3f}']
            cells += [f'{1e3 * math.sqrt(np.mean(errors**2)):.4f}']
            cells += [f'{sum(found for _, found, _ in seen)}/{total}']
            cells += [f'{math.sqrt(np.mean([z for *_, z in seen])):.2f}']
            label = f'{case.name}, {1e3 * width:.0f} mm'
            print(f'{label:22}' + ''.join(f'{cell:>9}' for cell in cells))


if __name__ == '__main__':
    main()
