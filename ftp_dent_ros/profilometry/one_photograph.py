"""One photograph to a cloud, in one call."""

from __future__ import annotations

import os
from typing import Any

from numpy.typing import NDArray

from ftp_dent_ros.files import find
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.pattern.pattern import Pattern
from ftp_dent_ros.photograph.photograph import Photograph
from ftp_dent_ros.profilometry.reconstruction import Measurement, Reconstructor
from ftp_dent_ros.profilometry.settings import Settings
from ftp_dent_ros.rig.rig import Rig, read_rig

_Path = str | os.PathLike[str]


def reconstruct(
    image: Photograph | NDArray[Any], rig: Rig | _Path, pattern: Pattern | _Path, **settings: Any
) -> Measurement:
    """Measure the surface in a photograph of the fringes.

    Parameters
    ----------
    image : ndarray or Photograph
        As large as the camera's calibration says. An array is RGB, shape (height, width, 3), or
        grey, shape (height, width), of 8 or 16 bits; `Photograph` tells
        of raw pixels, and of bits between.
    rig : Rig or path
        The calibrated camera and projector, or their file; ``shipped:rig.yaml`` is the
        demonstration's.
    pattern : Pattern or path
        What was projected, or its file.
    **settings
        Fields of `ftp_dent_ros.profilometry.Settings`, such as ``stride=2``.

    Returns
    -------
    Measurement
        Its `cloud` is in metres, in the camera's optical frame (x right, y down, z forward); its
        `coverage` tells what of the lit area has no points, and why.

    Raises
    ------
    ConfigurationError
        A file or a setting is wrong.
    ImageError
        The image has the wrong type or size.
    RefusedFrameError
        It gives no measurement; the message says why and what to do.

    Examples
    --------
    >>> from ftp_dent_ros import inspect, reconstruct
    >>> measured = reconstruct(image, 'rig.yaml', 'pattern.yaml', stride=2)  # doctest: +SKIP
    >>> inspect(measured.cloud).dents  # doctest: +SKIP
    """
    given_rig = rig if isinstance(rig, Rig) else read_rig(find(rig))
    given_pattern = pattern if isinstance(pattern, Pattern) else read_pattern(find(pattern))
    return Reconstructor(given_rig, given_pattern, Settings(**settings)).measure(image, True)
