"""The world, simulated: skin panels with dents, light, camera, flight and autopilot."""

from ftp_dent_ros.simulation.dent import Dent, Rivet
from ftp_dent_ros.simulation.motion import Motion
from ftp_dent_ros.simulation.paint import Paint
from ftp_dent_ros.simulation.panel import Panel
from ftp_dent_ros.simulation.photometry import Photometry
from ftp_dent_ros.simulation.renderer import Renderer, render
from ftp_dent_ros.simulation.surface import Surface

__all__ = [
    'Dent',
    'Motion',
    'Paint',
    'Panel',
    'Photometry',
    'Renderer',
    'Rivet',
    'Surface',
    'render',
]
