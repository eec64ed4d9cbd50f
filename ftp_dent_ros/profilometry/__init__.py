"""From an image to a cloud, one stage a module."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ftp_dent_ros.profilometry.settings import METHODS, UNWRAPPINGS, Settings

if TYPE_CHECKING:
    from ftp_dent_ros.profilometry.reconstruction import Reconstructor

__all__ = ['METHODS', 'UNWRAPPINGS', 'Reconstructor', 'Settings']


def __getattr__(name: str) -> Any:
    # Who inspects clouds has no use for the methods, nor each process that does.
    if name == 'Reconstructor':
        return import_module('ftp_dent_ros.profilometry.reconstruction').Reconstructor
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
