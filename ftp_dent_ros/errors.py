"""Every error that a user can cause, as one tree.

::

    FtpDentError
     ├─ InputError                what was given cannot be used (exit status 2)
     │   ├─ RigError              rig.yaml: a field is missing, malformed or impossible
     │   ├─ PatternError          the fringe pattern, its file or its image
     │   ├─ ImageError            a photograph of the wrong type or size, or unreadable
     │   ├─ CloudError            a point cloud file
     │   ├─ CodecError            an encoded cloud or frame that is damaged, or of another version
     │   ├─ ConfigurationError    a configuration or scene file, or a parameter
     │   ├─ BagError              a bag that cannot be read or written
     │   └─ CalibrationError      photographs of a board that do not give a rig
     ├─ RefusedFrameError         a photograph that gives no measurement; `reason` names why
     │   ├─ NoCalibrationError    no rig is set
     │   ├─ WrongCalibrationError the rig is not that of the camera
     │   ├─ NoPatternError        it is not known what is projected
     │   ├─ PatternChangeError    taken while the projector changed its pattern
     │   ├─ StampError            its stamp cannot be: of the future, or there already
     │   ├─ OtherPatternError     the fringes seen are not those of the pattern given
     │   ├─ TooDarkError          no fringes: the lamp is off, or the skin is out of its light
     │   ├─ SaturatedError        the fringes are clipped: the exposure is too long
     │   ├─ NoFringesError        what is lit is noise, texture, or another pattern
     │   └─ NoStripeError         the red stripe is not seen, so the fringe order is unknown
     ├─ CameraError               a camera that cannot be opened or has stopped
     ├─ LinkError                 a MAVLink connection that cannot be opened
     └─ PoseError                 no trustworthy pose at the time asked for; `reason` names why
         └─ PoseAwaitedError      not yet: what is needed may still come

A message is one sentence: what is wrong, where, and what to do. It may quote what came from
anywhere (names, values), so it is made fit for a terminal: see `printable`.
"""

from __future__ import annotations

_LONGEST = 2000  # characters: more is no sentence


def printable(text: str) -> str:
    """One line of a text, with escapes for what a terminal would obey, and not too long."""
    cut = text if len(text) <= _LONGEST else f'{text[:_LONGEST]} ...'
    return ''.join(
        each if each.isprintable() else each.encode('unicode_escape').decode() for each in cut
    )


# What to do where a package is not installed.
_ADVICE = {
    ('mcap', 'rosbags', 'lz4', 'zstandard'): (
        "install it with `pip install '.[bags]'`, or where ROS 2 is installed "
        'use `ros2 bag`, which writes and reads the same bags'
    ),
    ('zenoh', 'cryptography', 'aiohttp'): "install it with `pip install '.[ground]'`",
    ('jinja2', 'matplotlib'): "install it with `pip install '.[reports]'`",
    ('dask', 'distributed'): (
        "install it with `pip install '.[cluster]'`, or apt's python3-distributed"
    ),
}


def missing_package(error: ModuleNotFoundError) -> str:
    """A sentence on a package that is not installed; raises the error if it is this one's."""
    package = (error.name or str(error)).split('.')[0]
    if package == 'ftp_dent_ros':
        raise error
    known = (text for names, text in _ADVICE.items() if package in names)
    advice = next(known, 'see "Install" in the README')
    return f'needs the Python package {package}, which is not installed: {advice}'


class FtpDentError(Exception):
    """Base of all errors that this package raises on purpose.

    Parameters
    ----------
    message : str
    reason : str
        A few fixed words, for counting refusals by their reason; those of the class by default.
    """

    reason = 'error'

    def __init__(self, message: str, reason: str = '') -> None:
        super().__init__(message)
        self.reason = reason or self.reason

    def __str__(self) -> str:
        return printable(super().__str__())


class InputError(FtpDentError):
    """Something that the user gave cannot be used."""

    reason = 'wrong input'


class RigError(InputError):
    """The calibration of camera and projector is missing a field or is impossible."""


class PatternError(InputError):
    """The fringe pattern is malformed or does not fit the projector."""

    reason = 'wrong pattern'


class ImageError(InputError):
    """The image cannot be read, or has the wrong type or size."""

    reason = 'wrong image'


class CloudError(InputError):
    """The point cloud cannot be read or used."""

    reason = 'wrong cloud'


class CodecError(InputError):
    """Encoded data are damaged, of another version, or impossible."""


class ConfigurationError(InputError):
    """A configuration file or a parameter is wrong."""


class BagError(InputError):
    """The bag cannot be read or written."""


class CalibrationError(InputError):
    """The photographs of the board, or what was read off them, do not give a rig."""


class RefusedFrameError(FtpDentError):
    """The image is well formed but gives no measurement that could be trusted."""

    reason = 'refused'


class NoCalibrationError(RefusedFrameError):
    """No rig is set, so that the image has no geometry."""

    reason = 'no calibration'


class WrongCalibrationError(RefusedFrameError):
    """The camera says of itself that the rig is not its own."""

    reason = 'wrong calibration'


class NoPatternError(RefusedFrameError):
    """It is not known what the projector shows."""

    reason = 'no pattern'


class PatternChangeError(RefusedFrameError):
    """The photograph was taken so close to a change of the pattern that it may show either."""

    reason = 'pattern changed'


class StampError(RefusedFrameError):
    """The photograph's stamp is of the future, or that of the photograph before."""

    reason = 'wrong stamp'


class OtherPatternError(RefusedFrameError):
    """The fringes seen cannot be those of the pattern given."""

    reason = 'another pattern'


class TooDarkError(RefusedFrameError):
    """No part of the image shows fringes."""

    reason = 'too dark'


class SaturatedError(RefusedFrameError):
    """The fringes are clipped over most of the lit area."""

    reason = 'saturated'


class NoFringesError(RefusedFrameError):
    """What is lit is not explained by the fringes: noise, texture, or another pattern."""

    reason = 'no fringes'


class NoStripeError(RefusedFrameError):
    """The red stripe is not seen, so that the fringe order is unknown."""

    reason = 'no stripe'


class CameraError(FtpDentError):
    """The camera cannot be opened or gives no images."""


class LinkError(FtpDentError):
    """The MAVLink connection cannot be opened."""


class PoseError(FtpDentError):
    """There is no trustworthy pose at the time asked for."""

    reason = 'no pose'


class PoseAwaitedError(PoseError):
    """The pose asked for may still come to be known: ask again a little later."""
