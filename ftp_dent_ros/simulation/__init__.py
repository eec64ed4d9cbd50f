"""The world, simulated: skin panels with dents, light, camera, flight and autopilot."""

from ftp_dent_ros.simulation.dent import Dent
from ftp_dent_ros.simulation.fittings import Bead, DomedRivet, MissingRivet, Rivet
from ftp_dent_ros.simulation.form import Wave, waviness
from ftp_dent_ros.simulation.marks import Dirt, Lettering, Patch, scratches
from ftp_dent_ros.simulation.motion import Motion
from ftp_dent_ros.simulation.paint import Paint
from ftp_dent_ros.simulation.panel import Opening, Panel
from ftp_dent_ros.simulation.photometry import Photometry
from ftp_dent_ros.simulation.renderer import Renderer, render
from ftp_dent_ros.simulation.sunlight import Sunlight
from ftp_dent_ros.simulation.surface import Surface

__all__ = [
    'Bead',
    'Dent',
    'Dirt',
    'DomedRivet',
    'Lettering',
    'MissingRivet',
    'Motion',
    'Opening',
    'Paint',
    'Panel',
    'Patch',
    'Photometry',
    'Renderer',
    'Rivet',
    'Sunlight',
    'Surface',
    'Wave',
    'render',
    'scratches',
    'waviness',
]
