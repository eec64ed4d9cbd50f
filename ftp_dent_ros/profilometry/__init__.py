"""From an image to a cloud, one stage a module."""

from ftp_dent_ros.profilometry.reconstruction import Reconstructor
from ftp_dent_ros.profilometry.settings import METHODS, UNWRAPPINGS, Settings

__all__ = ['METHODS', 'UNWRAPPINGS', 'Reconstructor', 'Settings']
