"""What is asked of a GenICam camera."""

from __future__ import annotations

from dataclasses import dataclass

SOFTWARE = 'Software'


@dataclass(frozen=True)
class GenicamSettings:
    """What is asked of a camera.

    Attributes
    ----------
    camera : str
        Name, serial number or address, as Aravis lists it; empty for the first.
    width, height : int
        Image size, pixels; 0 leaves it as it is.
    rate : float
        Images a second of a camera that runs freely; below 1 leaves it as it is.
    pixel_format : str
        GenICam's name (Mono8, RGB8, BayerRG8); empty leaves it as it is.
    exposure : float
        Seconds; 0 leaves it as it is.
    gain : float
        Negative leaves it as it is.
    trigger : str
        ``Software``, a line's name (``Line1``), or empty for none.
    """

    camera: str = ''
    width: int = 0
    height: int = 0
    rate: float = 0.0
    pixel_format: str = ''
    exposure: float = 0.0
    gain: float = -1.0
    trigger: str = ''
