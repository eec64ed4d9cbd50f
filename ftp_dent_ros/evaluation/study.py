"""The paper's simulation, reproduced: trials, and a study of many."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import RefusedFrameError
from ftp_dent_ros.evaluation.scenes import (
    DYNAMIC_RIG,
    PATTERN,
    SAMPLES,
    SPEED,
    STATIC_RIG,
    Scene,
    sample,
    simulated_dent,
)
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.profilometry.fourier_transform import FourierTransform
from ftp_dent_ros.profilometry.fourier_transform.region import Window
from ftp_dent_ros.rig.rig import Rig

PHASE_NOISE = 0.6  # radians, standard deviation


class NoisyPhase(FourierTransform):
    """A method of the paper's with noise added to its phase map before it is unwrapped.

    Attributes
    ----------
    noise : ndarray, shape (rows, columns), optional
        Radians, at the camera's pixels.
    """

    noise: NDArray[np.float32] | None = None

    def _phase_map(self, fringes: NDArray[np.complex64], window: Window) -> NDArray[np.complex64]:
        if self.noise is None:
            return fringes
        noise = window.padded(self.noise[:: self.settings.stride])
        return fringes * np.exp(1j * noise).astype(np.complex64)


def methods(unwrapping: str, tau: float = 0.8) -> dict[str, Settings]:
    """The paper's two methods with one unwrapping, by the names that tables give them."""
    title = "Itoh's" if unwrapping == 'itoh' else f"Estrada's, tau {tau:g}"
    names = {'direct': 'direct', 'virtual reference': 'virtual-reference'}
    return {
        f'{name}, {title}': Settings.chosen(method, unwrapping=unwrapping, tau=tau)
        for name, method in names.items()
    }


ITOH, ESTRADA, SMOOTHER = methods('itoh'), methods('estrada'), methods('estrada', 0.7)
LEAST_SQUARES = {'least squares': Settings('least-squares')}
_ALL = ITOH | ESTRADA | SMOOTHER | LEAST_SQUARES


@dataclass(frozen=True)
class Figures:
    """What came out; NaN where the photograph was refused.

    Attributes
    ----------
    mae, deviation : float
        Mean distance to the true surface and its standard deviation, as the paper has them, mm.
    dent_mae : float
        The mean over the dent alone, mm.
    depth_bias : float
        Error of the depth at the dent's centre, against the flat around it; positive if the dent
        comes out too deep, mm.
    coverage : float
        Share of the lit surface that has points.
    seconds : float
        Running time with warm tables.
    """

    mae: float = math.nan
    deviation: float = math.nan
    dent_mae: float = math.nan
    depth_bias: float = math.nan
    coverage: float = math.nan
    seconds: float = math.nan


def engine(settings: Settings, rig: Rig) -> Any:
    """What measures photographs by a method."""
    kind: Any = Reconstructor if settings.method == 'least-squares' else NoisyPhase
    return kind(rig, PATTERN, settings)


def trial(
    engine: Any,
    scene: Scene,
    lit: NDArray[np.bool_],
    image: NDArray[np.uint8],
    phase_noise: NDArray[np.float32] | None = None,
) -> tuple[Figures, NDArray[np.float64] | None]:
    """Reconstruct a photograph and compare it with the truth.

    Parameters
    ----------
    engine : object
        From `engine`.
    scene : Scene
    lit : ndarray, shape (rows, columns)
        `Scene.lit`.
    image : ndarray, shape (rows, columns, 3), uint8
    phase_noise : ndarray, shape (rows, columns), optional
        Added to the phase map, radians.

    Returns
    -------
    figures : Figures
    error : ndarray, shape (rows, columns), optional
        Of the cloud, mm; None if the photograph was refused.
    """
    engine.noise = phase_noise
    start = time.perf_counter()
    try:
        cloud = engine.measure(Photograph.of(image)).cloud
    except RefusedFrameError:
        return Figures(coverage=0.0), None
    seconds = time.perf_counter() - start
    error = np.full(cloud.valid.shape, np.nan)
    error[cloud.valid] = 1e3 * scene.surface.distance(cloud.points[cloud.valid])
    return _figures(scene, lit, cloud, error, seconds), error


def _figures(scene: Scene, lit, cloud: Cloud, error, seconds: float) -> Figures:
    valid, dent = cloud.valid, scene.dent
    signed = error[valid]
    x, y = scene.on_panel(cloud.points[valid])
    across = np.hypot(x / (dent.length / 2), y / (dent.width / 2))
    # The depth at the dent's centre is the mean over this share of its half axes.
    on_dent, around, centre = across < 1, (across > 1.2) & (across < 2), across < 0.15
    dent_mae = depth_bias = math.nan
    if centre.any():
        dent_mae = float(np.abs(signed[on_dent]).mean())
        depth_bias = float(signed[centre].mean() - np.median(signed[around]))
    return Figures(
        mae=float(np.abs(signed).mean()),
        deviation=float(np.abs(signed).std()),
        dent_mae=dent_mae,
        depth_bias=depth_bias,
        coverage=float((valid & lit).sum() / lit.sum()),
        seconds=seconds,
    )


def mean(figures: list[Figures]) -> Figures:
    """Mean of each figure over the photographs that gave it; NaN if none did."""
    columns = np.array([list(vars(each).values()) for each in figures]).T
    given = [column[np.isfinite(column)] for column in columns]
    return Figures(*(float(values.mean()) if values.size else math.nan for values in given))


@dataclass(frozen=True, eq=False)
class Case:
    """Rows of a table: one scene, photographed with several seeds, by several methods."""

    table: str
    row: str
    scene: Scene
    methods: dict[str, Settings]
    seeds: int
    phase_noise: float = 0.0


@dataclass(frozen=True, eq=False)
class Entry:
    """Mean figures of one method in one row, how often it refused, and its first error map, mm."""

    case: Case
    method: str
    figures: Figures
    refused: int
    error_mm: NDArray[np.float64] | None

    @property
    def paper(self) -> list[float] | None:
        """Mean absolute error and its standard deviation as the paper has them, mm."""
        return _PAPER.get((self.case.table, self.case.row, self.method))


def cases(quick: bool) -> list[Case]:
    """What is to be measured."""
    many, few = (2, 1) if quick else (20, 3)
    paper_alone = ITOH | ESTRADA | SMOOTHER
    found = [
        Case('section 3', 'phase map', simulated_dent(), paper_alone, many, PHASE_NOISE),
        Case('section 3', 'light', simulated_dent(PHASE_NOISE), _ALL, many),
        Case('section 3', 'none', simulated_dent(), _ALL, 1),
    ]
    for name in SAMPLES:
        scene = sample(name, STATIC_RIG, 0.6)
        found.append(Case('static', name, scene, ITOH | ESTRADA | LEAST_SQUARES, few))
    for name in SAMPLES:
        for row, speed in ((f'{name}, dynamic', SPEED), (f'{name}, static', 0.0)):
            scene = sample(name, DYNAMIC_RIG, 1.2, speed)
            found.append(Case('dynamic', row, scene, ESTRADA | LEAST_SQUARES, few))
    return found


def study(quick: bool, progress: Callable[[], object] = lambda: None) -> list[Entry]:
    """Measure every case; `progress` is called once for each photograph and method."""
    engines: dict[tuple[str, Rig], Any] = {}
    return [entry for case in cases(quick) for entry in _measured(case, engines, progress)]


def steps(quick: bool) -> int:
    """How often `study` calls its `progress`."""
    return sum(case.seeds * len(case.methods) for case in cases(quick))


def _measured(
    case: Case, engines: dict[tuple[str, Rig], Any], progress: Callable[[], object]
) -> Iterator[Entry]:
    scene, lit = case.scene, case.scene.lit()
    figures: dict[str, list[Figures]] = {name: [] for name in case.methods}
    first: dict[str, NDArray[np.float64] | None] = {}
    for seed in range(case.seeds):
        image, noise = scene.photograph(0 if case.phase_noise else seed), None
        if case.phase_noise:
            rng = np.random.default_rng(seed)
            noise = rng.normal(0, case.phase_noise, lit.shape).astype(np.float32)
        for name, settings in case.methods.items():
            at = name, scene.rig
            if at not in engines:
                engines[at] = engine(settings, scene.rig)
                # So that its tables are made before it is timed.
                trial(engines[at], scene, lit, image)
            found, error = trial(engines[at], scene, lit, image, noise)
            figures[name].append(found)
            # Only the first is drawn; those of the others would fill the memory.
            first.setdefault(name, error)
            progress()
    for name, each in figures.items():
        refused = sum(math.isnan(one.mae) for one in each)
        yield Entry(case, name, mean(each), refused, first[name])


# What the paper reports, mean absolute error and standard deviation in mm, of the direct and the
# virtual reference: section 3; tables 3, 4 and 6.
_REPORTED = (
    (ITOH, 'section 3', 'phase map', 6.820, 7.174, 3.827, 7.090),
    (ESTRADA, 'section 3', 'phase map', 7.597, 4.822, 1.591, 1.339),
    (SMOOTHER, 'section 3', 'phase map', 1.241, 1.047, 1.221, 1.032),
    (ITOH, 'static', 'A', 0.158, 0.176, 0.126, 0.115),
    (ITOH, 'static', 'B', 0.167, 0.202, 0.144, 0.151),
    (ITOH, 'static', 'C', 0.259, 0.616, 0.154, 0.494),
    (ITOH, 'static', 'D', 0.158, 0.566, 0.144, 0.537),
    (ESTRADA, 'static', 'A', 0.153, 0.174, 0.120, 0.110),
    (ESTRADA, 'static', 'B', 0.165, 0.190, 0.135, 0.130),
    (ESTRADA, 'static', 'C', 0.202, 0.162, 0.115, 0.114),
    (ESTRADA, 'static', 'D', 0.213, 0.368, 0.124, 0.131),
    (ESTRADA, 'dynamic', 'A, dynamic', 0.381, 0.456, 0.280, 0.307),
    (ESTRADA, 'dynamic', 'A, static', 0.504, 0.486, 0.285, 0.217),
    (ESTRADA, 'dynamic', 'B, dynamic', 0.419, 0.438, 0.309, 0.396),
    (ESTRADA, 'dynamic', 'B, static', 0.432, 0.329, 0.287, 0.255),
    (ESTRADA, 'dynamic', 'C, dynamic', 0.436, 0.443, 0.271, 0.265),
    (ESTRADA, 'dynamic', 'C, static', 0.493, 0.546, 0.320, 0.468),
    (ESTRADA, 'dynamic', 'D, dynamic', 0.411, 0.394, 0.295, 0.294),
    (ESTRADA, 'dynamic', 'D, static', 0.370, 0.357, 0.293, 0.401),
)

_PAPER = {
    (table, row, name): figures
    for pair, table, row, *values in _REPORTED
    for name, figures in zip(pair, (values[:2], values[2:]), strict=True)
}
