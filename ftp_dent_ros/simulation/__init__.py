"""The world, simulated: skin panels with dents, light, camera, flight and autopilot."""

from ftp_dent_ros.simulation.dents import Dent, Rivet, domed_rivet
from ftp_dent_ros.simulation.paint import Dirt, Lettering, Paint, PaintPatch, Sunlight, scratches
from ftp_dent_ros.simulation.renderer import Renderer, render
from ftp_dent_ros.simulation.sensor import Photometry
from ftp_dent_ros.simulation.surface import Panel, Surface, Wave, waviness
from ftp_dent_ros.simulation.view import CameraMotion

__all__ = [
    'CameraMotion',
    'Dent',
    'Dirt',
    'Lettering',
    'Paint',
    'PaintPatch',
    'Panel',
    'Photometry',
    'Renderer',
    'Rivet',
    'Sunlight',
    'Surface',
    'Wave',
    'domed_rivet',
    'render',
    'scratches',
    'waviness',
]
