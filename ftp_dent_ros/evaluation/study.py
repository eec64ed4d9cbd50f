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


@dataclass(frozen=True)
class StudyMethod:
    """A method under the name that tables give it."""

    name: str
    settings: Settings


def methods(unwrapping: str, tau: float = 0.8) -> tuple[StudyMethod, StudyMethod]:
    """The paper's two methods with one unwrapping."""
    title = "Itoh's" if unwrapping == 'itoh' else f"Estrada's, tau {tau:g}"
    direct, virtual = (
        Settings.chosen(name, unwrapping=unwrapping, tau=tau)
        for name in ('direct', 'virtual-reference')
    )
    return StudyMethod(f'direct, {title}', direct), StudyMethod(
        f'virtual reference, {title}', virtual
    )


LEAST_SQUARES = StudyMethod('least squares', Settings('least-squares'))


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


@dataclass(frozen=True, eq=False)
class StudyTrial:
    """Figures of one photograph, and its cloud's error (mm) for the pictures."""

    figures: Figures
    error_mm: NDArray[np.float64] | None


class Bench:
    """A method on one rig, with its tables made."""

    def __init__(self, method: StudyMethod, rig: Rig) -> None:
        self.method = method
        least_squares = method.settings.method == 'least-squares'
        kind: Any = Reconstructor if least_squares else NoisyPhase
        self._method = kind(rig, PATTERN, method.settings)
        self._warm = False

    def run(
        self,
        scene: Scene,
        lit: NDArray[np.bool_],
        image: NDArray[np.uint8],
        phase_noise: NDArray[np.float32] | None = None,
    ) -> StudyTrial:
        """Reconstruct a photograph and compare it with the truth.

        Parameters
        ----------
        scene : Scene
        lit : ndarray, shape (rows, columns)
            `Scene.lit`.
        image : ndarray, shape (rows, columns, 3), uint8
        phase_noise : ndarray, shape (rows, columns), optional
            Added to the phase map, radians.
        """
        if phase_noise is not None:
            self._method.noise = phase_noise
        photograph = Photograph.of(image)
        try:
            if not self._warm:
                self._method.measure(photograph)
                self._warm = True
            start = time.perf_counter()
            cloud = self._method.measure(photograph).cloud
            seconds = time.perf_counter() - start
        except RefusedFrameError:
            return StudyTrial(Figures(coverage=0.0), None)
        error = np.full(cloud.valid.shape, np.nan)
        error[cloud.valid] = 1e3 * scene.error(cloud.points[cloud.valid])
        return StudyTrial(_figures(scene, lit, cloud, error, seconds), error)


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


ITOH = methods('itoh')
ESTRADA = methods('estrada', 0.8)
SMOOTHER = methods('estrada', 0.7)


@dataclass(frozen=True, eq=False)
class Case:
    """Rows of a table: one scene, photographed with several seeds, by several methods."""

    table: str
    row: str
    scene: Scene
    methods: tuple[StudyMethod, ...]
    seeds: int
    phase_noise: float = 0.0


@dataclass(frozen=True, eq=False)
class Entry:
    """Mean figures of one method in one row, how often it refused, and its first trial."""

    case: Case
    method: StudyMethod
    figures: Figures
    refused: int
    first: StudyTrial
    paper: list[float] | None


def cases(quick: bool) -> list[Case]:
    """What is to be measured."""
    many, few = (2, 1) if quick else (20, 3)
    all_methods = (*ITOH, *ESTRADA, *SMOOTHER, LEAST_SQUARES)
    found = [
        Case('section 3', 'phase map', simulated_dent(), all_methods[:-1], many, PHASE_NOISE),
        Case('section 3', 'light', simulated_dent(PHASE_NOISE), all_methods, many),
        Case('section 3', 'none', simulated_dent(), all_methods, 1),
    ]
    for name in SAMPLES:
        scene = sample(name, STATIC_RIG, 0.6)
        found.append(Case('static', name, scene, (*ITOH, *ESTRADA, LEAST_SQUARES), few))
    for name in SAMPLES:
        for row, speed in ((f'{name}, dynamic', SPEED), (f'{name}, static', 0.0)):
            scene = sample(name, DYNAMIC_RIG, 1.2, speed)
            found.append(Case('dynamic', row, scene, (*ESTRADA, LEAST_SQUARES), few))
    return found


def study(quick: bool, progress: Callable[[], object] = lambda: None) -> list[Entry]:
    """Measure every case; `progress` is called once for each photograph and method."""
    result: list[Entry] = []
    benches: dict[tuple[str, int], Bench] = {}
    for case in cases(quick):
        for method in case.methods:
            benches.setdefault((method.name, id(case.scene.rig)), Bench(method, case.scene.rig))
        chosen = [benches[method.name, id(case.scene.rig)] for method in case.methods]
        result.extend(_measured(case, chosen, progress))
    return result


def steps(quick: bool) -> int:
    """How often `study` calls its `progress`."""
    return sum(case.seeds * len(case.methods) for case in cases(quick))


def _measured(case: Case, benches: list[Bench], progress: Callable[[], object]) -> Iterator[Entry]:
    scene, lit = case.scene, case.scene.lit()
    trials: list[list[StudyTrial]] = [[] for _ in benches]
    image = scene.photograph(0)
    for seed in range(case.seeds):
        noise = None
        if case.phase_noise:
            rng = np.random.default_rng(seed)
            noise = rng.normal(0, case.phase_noise, lit.shape).astype(np.float32)
        elif seed:
            image = scene.photograph(seed)
        for bench, done in zip(benches, trials, strict=True):
            trial = bench.run(scene, lit, image, noise)
            # Only the first is drawn; the clouds of the others would fill the memory.
            done.append(trial if seed == 0 else StudyTrial(trial.figures, None))
            progress()
    paper = _paper()
    for bench, done in zip(benches, trials, strict=True):
        yield Entry(
            case,
            bench.method,
            mean([trial.figures for trial in done]),
            sum(np.isnan(trial.figures.mae) for trial in done),
            done[0],
            paper.get((case.table, case.row, bench.method.name)),
        )


def _paper() -> dict[tuple[str, str, str], list[float]]:
    """What the paper reports, by table, row and method: MAE and standard deviation in mm."""
    # Direct, then virtual reference: section 3; tables 3, 4 and 6.
    reported = (
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
    return {
        (table, row, method.name): figures
        for pair, table, row, *values in reported
        for method, figures in zip(pair, (values[:2], values[2:]), strict=True)
    }
