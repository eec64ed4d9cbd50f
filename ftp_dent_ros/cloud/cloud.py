"""An organised point cloud."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ftp_dent_ros.errors import CloudError

if TYPE_CHECKING:
    from ftp_dent_ros.pose import Pose

#: What a cloud has of each point beside its place, in the order of files and messages.
FIELDS = ('intensity', 'sigma', 'resolution', 'raw', 'noise')


@dataclass(frozen=True)
class Cloud:
    """Points on the camera's grid, at full resolution or at every n-th pixel.

    Attributes
    ----------
    points : ndarray, shape (rows, columns, 3), float32
        Metres; NaN where there is no measurement.
    intensity : ndarray, shape (rows, columns), float32
        Modulation of the fringes in grey levels: the strength of the signal.
    sigma : ndarray, shape (rows, columns), float32
        Standard uncertainty of each point along its ray, metres: noise, what smoothing may have
        taken off, and what the photograph's edges and texture may have added. NaN where it is
        not known; all NaN if not given.
    resolution : ndarray, shape (rows, columns), float32
        Wavelength on the surface, metres, at which smoothing has taken half of a detail's depth;
        longer ones are shown better. NaN where it is not known; all NaN if not given.
    raw, noise : ndarray, shape (rows, columns), float32
        From each point along its ray, away from the camera, to where it lay before it was
        denoised, metres, and the standard deviation of that place by noise alone. Denoising
        takes small dents off with the noise, and makes others shallower and wider: a dent is
        looked for in what was there before. NaN where they are not known, as in a gap, whose
        points are taken from its rim; all NaN if not given.
    skin : ndarray, shape (rows, columns), uint8
        Its light without the fringes, as an image; 0 where it is not known, all 0 if not given.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32]
    sigma: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 0), np.float32))
    resolution: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 0), np.float32))
    raw: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 0), np.float32))
    noise: NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 0), np.float32))
    skin: NDArray[np.uint8] = field(
        default_factory=lambda: np.empty((0, 0), np.uint8), kw_only=True
    )

    def __post_init__(self) -> None:
        if self.points.ndim != 3 or self.points.shape[2] != 3:
            raise CloudError(
                f'a cloud has the shape (rows, columns, 3), not {self.points.shape}: '
                'give an organised cloud'
            )
        for name in (*FIELDS, 'skin'):
            values = getattr(self, name)
            if name != 'intensity' and not values.size:
                nothing = 0 if name == 'skin' else np.nan
                unknown = np.full(self.points.shape[:2], nothing, values.dtype)
                object.__setattr__(self, name, unknown)
            elif values.shape != self.points.shape[:2]:
                raise CloudError(
                    f'{name} has the shape {values.shape}, the points {self.points.shape[:2]}: '
                    f'give one {name} a point'
                )

    def with_skin(self, skin: NDArray[np.uint8] | None) -> Cloud:
        """The same cloud with an image of its skin, if there is one that has its shape."""
        if skin is None or skin.shape != self.points.shape[:2]:
            return self
        return replace(self, skin=skin)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask of the measured points, shape (rows, columns)."""
        return np.isfinite(self.points[..., 2])

    @property
    def transposed(self) -> Cloud:
        """The same cloud with x for y, and y for x, of pixels as of points."""
        points = np.ascontiguousarray(self.points.swapaxes(0, 1)[..., [1, 0, 2]])
        names = (*FIELDS, 'skin')
        turned = {name: np.ascontiguousarray(getattr(self, name).T) for name in names}
        return Cloud(points, **turned)

    def transformed(self, pose: Pose) -> Cloud:
        """The same cloud in the parent frame of `pose`."""
        return replace(self, points=pose.apply(self.points))


def check_resolution(cloud: Cloud) -> Cloud:
    """The cloud, if its resolution can be true.

    Raises
    ------
    CloudError
        It cannot be: no window of a photograph is a metre wide.
    """
    largest = float(np.nanmax(cloud.resolution, initial=0.0))
    if not largest < 1:
        raise CloudError(
            f'the cloud states a resolution of {largest:.3g} m, where less than 1 m can be: '
            'correct its field resolution, in metres'
        )
    return cloud
