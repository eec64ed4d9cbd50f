"""One input of ``ftp-dent inspect`` to its report, in whatever process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ftp_dent_ros.cloud.ply import read_ply, rig_id_of
from ftp_dent_ros.errors import CloudError, ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.observation import Observation, viewpoint_of
from ftp_dent_ros.inspection.reporting.content import Report
from ftp_dent_ros.inspection.reporting.rules import Rules, read_rules
from ftp_dent_ros.inspection.reporting.survey import Survey
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.photograph.file import is_photograph, read_photograph
from ftp_dent_ros.rig.rig import Lens, read_rig

_CAMERA_FRAME = 'camera_optical_frame'
# Clouds that take as long as another process does to begin.
_WORTH = 10


@dataclass(frozen=True)
class Request:
    """What is to be inspected, and how: plain data, that another process can be given.

    Attributes
    ----------
    path : Path
        A cloud, a photograph or a bag.
    rig, pattern, rules : str, optional
        Names of files.
    settings : Settings
    stride : int
        Of a photograph.
    joined : bool
        Whether a bag's clouds are laid on each other first.
    """

    path: Path
    rig: str | None
    pattern: str | None
    rules: str | None
    settings: Settings
    stride: int
    joined: bool = False


def report_of(
    request: Request,
    progress: Callable[[int], object] = lambda count: None,
    jobs: int = 1,
) -> Report:
    """Inspect what is asked for.

    Parameters
    ----------
    request : Request
    progress : callable
        Called after each cloud of a bag with how many there are.
    jobs : int
        Processes that inspect a bag's clouds.

    Raises
    ------
    FtpDentError
        It cannot be inspected; the message says why.
    """
    path = request.path
    rules = read_rules(find(request.rules)) if request.rules else None
    if not path.exists():
        raise ConfigurationError(f'{path}: no such file: check the path')
    if path.is_dir() or path.suffix.lower() == '.mcap':
        return _of_bag(request, rules, progress, jobs)
    if request.joined:
        raise ConfigurationError(f'{path}: is no bag, whose clouds --survey joins: leave it out')
    if path.suffix.lower() == '.ply':
        return _of_cloud(request, rules)
    if is_photograph(path):
        return _of_photograph(request, rules)
    raise ConfigurationError(
        f'{path}: neither a cloud (.ply), nor a photograph, nor a bag: give one of them'
    )


def _of_bag(
    request: Request, rules: Rules | None, progress: Callable[[int], object], jobs: int
) -> Report:
    # Only this needs the libraries of bags.
    from ftp_dent_ros.fleet import in_order
    from ftp_dent_ros.inspection.reporting.bag import survey_bag
    from ftp_dent_ros.recording import clouds
    from ftp_dent_ros.recording.clouds import count_clouds
    from ftp_dent_ros.recording.reader import open_bag

    bag = open_bag(request.path)
    named, camera = _rig(request, clouds.rig_id_of(bag))
    count, _ = count_clouds(bag)
    if request.joined:
        from ftp_dent_ros.survey.reporting import report_on_skin

        thrice = partial(progress, 3 * count)
        return report_on_skin(bag, inspect, named, camera, rules, request.settings, thrice)[0]
    once, each = partial(progress, count), partial(in_order, jobs=min(jobs, count // _WORTH))
    return survey_bag(
        bag, inspect, named, camera, rules, request.settings, progress=once, each=each
    )


def _of_cloud(request: Request, rules: Rules | None) -> Report:
    cloud, frame_id = read_ply(request.path)
    in_camera = frame_id == _CAMERA_FRAME
    viewpoint = (0.0, 0.0, 0.0) if in_camera else viewpoint_of(cloud)
    observation = Observation(request.path.name, cloud, viewpoint=viewpoint)
    return _of_one(request, observation, frame_id, rules, rig_id_of(request.path))


def _of_photograph(request: Request, rules: Rules | None) -> Report:
    from ftp_dent_ros import profilometry

    if not request.rig or not request.pattern:
        raise ConfigurationError(
            f'{request.path}: a photograph needs its rig and its pattern: '
            'give --rig RIG.yaml and --pattern PATTERN.yaml'
        )
    rig, pattern = read_rig(find(request.rig)), read_pattern(find(request.pattern))
    reconstructor = profilometry.Reconstructor(
        rig, pattern, profilometry.Settings(stride=request.stride)
    )
    photograph = read_photograph(str(request.path))
    measured = reconstructor.measure(photograph, True)
    observation = Observation(
        request.path.name,
        measured.cloud,
        coverage=measured.coverage,
        photograph=photograph.shown(),
    )
    return _of_one(request, observation, _CAMERA_FRAME, rules)


def _of_one(
    request: Request,
    observation: Observation,
    frame_id: str,
    rules: Rules | None,
    measured_by: str = '',
) -> Report:
    named, camera = _rig(request, measured_by)
    survey = Survey(inspect, settings=request.settings)
    if survey.add(observation) is None:
        raise CloudError(survey.refused[0])
    in_camera = frame_id == _CAMERA_FRAME
    camera = camera if in_camera else None
    return survey.report(str(request.path), frame_id, named, camera, rules)


def _rig(request: Request, measured_by: str) -> tuple[tuple[str, str], Lens | None]:
    """Name and id of the calibration, and its camera; the input may say which id it is."""
    if not request.rig:
        return ('', measured_by), None
    file = find(request.rig)
    rig = read_rig(file)
    if measured_by and measured_by != rig.id:
        raise ConfigurationError(
            f'{file}: is the rig {rig.id}, and {request.path} was measured by the rig '
            f'{measured_by}: give that one, or none'
        )
    return (file.name, rig.id), rig.camera
