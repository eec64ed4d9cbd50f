"""One method on one photograph, held against the truth."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.cloud.cloud import Cloud
from ftp_dent_ros.errors import RefusedFrameError
from ftp_dent_ros.evaluation.phase_noise import NoisyPhase, on_phase_map
from ftp_dent_ros.evaluation.scenes import PATTERN, Scene
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry import Reconstructor, Settings
from ftp_dent_ros.rig.rig import Rig

# The depth at the dent's centre is the mean over this share of its half axes.
_CENTRE = 0.15
_MM = 1e3


@dataclass(frozen=True)
class Method:
    """A method under the name that tables give it."""

    name: str
    settings: Settings


def methods(unwrapping: str, tau: float = 0.8) -> tuple[Method, Method]:
    """The paper's two methods with one unwrapping."""
    title = "Itoh's" if unwrapping == 'itoh' else f"Estrada's, tau {tau:g}"
    direct, virtual = (
        Settings.chosen(name, unwrapping=unwrapping, tau=tau)
        for name in ('direct', 'virtual-reference')
    )
    return Method(f'direct, {title}', direct), Method(f'virtual reference, {title}', virtual)


LEAST_SQUARES = Method('least squares', Settings('least-squares'))


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

    mae: float
    deviation: float
    dent_mae: float
    depth_bias: float
    coverage: float
    seconds: float


@dataclass(frozen=True, eq=False)
class Trial:
    """Figures of one photograph, and the cloud with its error (mm) for the pictures."""

    figures: Figures
    cloud: Cloud | None
    error_mm: NDArray[np.float64] | None


class Bench:
    """A method on one rig, with its tables made."""

    def __init__(self, method: Method, rig: Rig) -> None:
        self.method = method
        least_squares = method.settings.method == 'least-squares'
        self._method: Any = (
            Reconstructor(rig, PATTERN, method.settings)
            if least_squares
            else NoisyPhase(rig, PATTERN, method.settings)
        )
        self._warm = False

    def run(
        self,
        scene: Scene,
        lit: NDArray[np.bool_],
        image: NDArray[np.uint8],
        phase_noise: NDArray[np.float32] | None = None,
    ) -> Trial:
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
        if phase_noise is not None and self.method is LEAST_SQUARES:
            image = on_phase_map(image, scene, phase_noise)
        elif phase_noise is not None:
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
            nothing = math.nan
            figures = Figures(nothing, nothing, nothing, nothing, 0.0, nothing)
            return Trial(figures, None, None)
        error = np.full(cloud.valid.shape, np.nan)
        error[cloud.valid] = _MM * scene.error(cloud.points[cloud.valid])
        return Trial(_figures(scene, lit, cloud, error, seconds), cloud, error)


def _figures(scene: Scene, lit, cloud: Cloud, error, seconds: float) -> Figures:
    valid = cloud.valid
    signed = error[valid]
    x, y = scene.on_panel(cloud.points[valid])
    dent = scene.dent
    across = np.hypot(x / (dent.length / 2), y / (dent.width / 2))
    on_dent, around, centre = across < 1, (across > 1.2) & (across < 2), across < _CENTRE
    if not on_dent.any() or not centre.any():
        dent_mae = depth_bias = math.nan
    else:
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
