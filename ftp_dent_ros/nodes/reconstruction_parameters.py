"""The parameters of reconstruction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ftp_dent_ros.parameters import Declarations
from ftp_dent_ros.profilometry.settings import METHODS, UNWRAPPINGS, Settings
from ftp_dent_ros.rig.rig import Rig, read_rig


@dataclass(frozen=True)
class ReconstructionParameters:
    """What reconstruction was given."""

    rig: Rig | None
    bits: int
    tolerance_px: float
    settling_ns: int
    choices: dict[str, Any]


def declare(parameters: Declarations) -> ReconstructionParameters:
    """Declare them; the settings change while it runs."""
    rig = parameters.file(
        'rig', '', 'Calibration file (rig.yaml); without it every image is refused.'
    )
    return ReconstructionParameters(
        rig=read_rig(rig) if rig else None,
        bits=parameters.declare(
            'bits',
            0,
            'Bits of the levels in images of 16, if they are the lower ones (10, 12 or 14); 0 for '
            'levels that fill them, as those of camera_capture do.',
            minimum=0,
            maximum=16,
        ),
        tolerance_px=parameters.declare(
            'camera_info_tolerance',
            5.0,
            "Pixels by which a ray may differ between camera_info and the rig's camera; beyond "
            'it images are refused.',
            minimum=0.0,
            maximum=1e4,
        ),
        settling_ns=_declare_settling(parameters),
        choices=_declare_choices(parameters),
    )


def _declare_settling(parameters: Declarations) -> int:
    """Nanoseconds around a change of the pattern within which photographs are refused."""
    # A projector of 60 Hz begins with the next frame (17 ms) and shows it up to five frames later
    # (83 ms); half an exposure and errors of the clocks come on top. As long before: whoever
    # shows the pattern as it arrives is as early as pattern_publisher tells of it (0.2 s).
    seconds = parameters.declare(
        'pattern_settling',
        0.25,
        'Seconds around a change of the pattern within which photographs are refused.',
        minimum=0.0,
        maximum=60.0,
    )
    return round(1e9 * seconds)


def _declare_choices(parameters: Declarations) -> dict[str, Any]:
    """Choices of the reconstruction from parameters of the same names."""
    default = Settings()
    unwrapping, tau = default.unwrapper
    return {
        'method': parameters.declare(
            'method',
            default.method,
            'How the phase is computed.',
            choices=tuple(METHODS),
            changeable=True,
        ),
        'unwrapping': parameters.declare(
            'unwrapping',
            unwrapping,
            'How the Fourier methods unwrap the phase.',
            choices=tuple(UNWRAPPINGS),
            changeable=True,
        ),
        'tau': parameters.declare(
            'tau',
            float(tau),
            "Gain of Estrada's unwrapping.",
            above=0.0,
            maximum=1.0,
            changeable=True,
        ),
        'stride': parameters.declare(
            'stride',
            default.stride,
            'Every how many pixels the cloud has a point, along rows and columns.',
            minimum=1,
            maximum=16,
            changeable=True,
        ),
    }
