"""The world, simulated: skin panels with dents, light, camera, flight and autopilot."""

from ftp_dent_ros.simulation.photography.motion import Motion
from ftp_dent_ros.simulation.photography.photometry import Photometry
from ftp_dent_ros.simulation.photography.renderer import Renderer, render
from ftp_dent_ros.simulation.skin.dent import Dent
from ftp_dent_ros.simulation.skin.fittings import Bead, DomedRivet, MissingRivet, Rivet
from ftp_dent_ros.simulation.skin.form import Wave, waviness
from ftp_dent_ros.simulation.skin.marks import Dirt, Lettering, Patch, scratches
from ftp_dent_ros.simulation.skin.paint import Paint
from ftp_dent_ros.simulation.skin.panel import Opening, Panel
from ftp_dent_ros.simulation.skin.sunlight import Sunlight
from ftp_dent_ros.simulation.skin.surface import Surface

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
