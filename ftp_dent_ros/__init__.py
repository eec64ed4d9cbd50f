"""Single-shot fringe-projection dent inspection of aircraft skin from a drone.

`reconstruct` makes a cloud of a photograph, and `inspect` finds the dents in a cloud:

    from ftp_dent_ros import inspect, reconstruct

    measured = reconstruct(image, 'rig.yaml', 'pattern.yaml', stride=2)
    for dent in inspect(measured.cloud).dents:
        print(dent.depth.value, dent.depth.uncertainty)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ftp_dent_ros.inspection.measuring.inspection import inspect
    from ftp_dent_ros.profilometry.one_photograph import reconstruct

__all__ = ['inspect', 'reconstruct']
__version__ = '0.1.0'

_PLACES = {
    'inspect': 'ftp_dent_ros.inspection.measuring.inspection',
    'reconstruct': 'ftp_dent_ros.profilometry.one_photograph',
}


def __getattr__(name: str) -> Any:
    # SciPy and OpenCV take a second to load on a small computer: only for whom they serve.
    if name in _PLACES:
        return getattr(import_module(_PLACES[name]), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
