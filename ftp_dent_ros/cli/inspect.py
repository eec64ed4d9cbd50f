"""``ftp-dent inspect``: a cloud, a photograph or a bag to its dents and their report."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from tqdm import tqdm

from ftp_dent_ros.errors import CloudError, ConfigurationError
from ftp_dent_ros.files import content_id, find
from ftp_dent_ros.inspection.dent import MeasuredDent
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.observation import Observation, viewpoint_of
from ftp_dent_ros.inspection.reporting.content import Report
from ftp_dent_ros.inspection.reporting.files import write_report
from ftp_dent_ros.inspection.reporting.rules import Rules, read_rules, verdict
from ftp_dent_ros.inspection.reporting.survey import Survey
from ftp_dent_ros.inspection.settings import Settings
from ftp_dent_ros.pattern import read_pattern
from ftp_dent_ros.photograph_file import is_photograph, read_photograph
from ftp_dent_ros.ply import read_ply
from ftp_dent_ros.rig import Lens, read_rig

_CAMERA_FRAME = 'camera_optical_frame'
_MM = 1e3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        'input',
        metavar='CLOUD.ply|IMAGE|BAG',
        help='a cloud of `ftp-dent reconstruct`, a photograph, or a bag with clouds',
    )
    parser.add_argument(
        '--output', required=True, metavar='DIR', help='takes dents.json, dents.csv, report.html'
    )
    parser.add_argument(
        '--rig', metavar='RIG.yaml', help='calibrated rig; needed for a photograph'
    )
    parser.add_argument(
        '--pattern', metavar='PATTERN.yaml', help='projected pattern; needed for a photograph'
    )
    parser.add_argument('--rules', metavar='RULES.yaml', help='limits to judge the dents by')
    default = Settings()
    parser.add_argument(
        '--smallest-depth',
        type=float,
        default=default.smallest_depth * _MM,
        metavar='MM',
        help='shallower dents are not reported; default: %(default)g',
    )
    parser.add_argument(
        '--smallest-width',
        type=float,
        default=default.smallest_width * _MM,
        metavar='MM',
        help='narrower ones are rivets, scratches and gaps; default: %(default)g',
    )
    parser.add_argument(
        '--stride', type=int, default=2, metavar='N', help="a photograph's every N-th pixel only"
    )


def run(arguments: argparse.Namespace) -> int:
    """Inspect, print a line a dent, and write the report."""
    path, output = Path(arguments.input), Path(arguments.output)
    if output.exists() and not output.is_dir():
        raise ConfigurationError(f'--output {output} is a file: name a folder')
    rules = read_rules(find(arguments.rules)) if arguments.rules else None
    if not path.exists():
        raise ConfigurationError(f'{path}: no such file: check the path')
    survey: Callable[[argparse.Namespace, Rules | None], Report]
    if path.is_dir() or path.suffix.lower() == '.mcap':
        survey = _of_bag
    elif path.suffix.lower() == '.ply':
        survey = _of_cloud
    elif is_photograph(path):
        survey = _of_photograph
    else:
        raise ConfigurationError(
            f'{path}: neither a cloud (.ply), nor a photograph, nor a bag: give one of them'
        )
    report = survey(arguments, rules)
    page = write_report(output, report)
    print(summary(report))
    print(f'{page}')
    return 0


def summary(report: Report) -> str:
    """A line a dent."""
    lines = [f'{len(report.dents)} dents, {len(report.others)} others']
    for entry, findings in zip(report.dents, report.findings(), strict=True):
        dent = entry.dent
        line = (
            f'{entry.number:4}  depth {dent.depth.value * 1e3:.3f} mm, '
            f'length {dent.length.value * 1e3:.1f} mm, width {dent.width.value * 1e3:.1f} mm'
        )
        line += ', cut' if dent.is_cut else ''
        line += f', {dent.reason}' if dent.reason else ''
        line += f', seen {len(entry.sightings)} times' if len(report.frames) > 1 else ''
        lines.append(line + (f': {verdict(findings)}' if findings else ''))
    lines += [_other(entry.dent) for entry in report.others]
    if report.skipped:
        lines.append(f'{len(report.skipped)} messages skipped, the first: {report.skipped[0]}')
    return '\n'.join(lines)


def _other(dent: MeasuredDent) -> str:
    sizes = f'{dent.depth.value * 1e3:.3f} mm, length {dent.length.value * 1e3:.1f} mm'
    return f'      {dent.kind} {sizes}' + (f': {dent.reason}' if dent.reason else '')


def _of_bag(arguments: argparse.Namespace, rules: Rules | None) -> Report:
    # Only this needs the libraries of bags.
    from ftp_dent_ros.inspection.reporting.bag import survey_bag
    from ftp_dent_ros.recording.clouds import count_clouds
    from ftp_dent_ros.recording.reader import open_bag

    named, camera = _rig(arguments.rig)
    bag = open_bag(arguments.input)
    count, _ = count_clouds(bag)
    with tqdm(desc='inspecting', total=count, unit='cloud', dynamic_ncols=True) as bar:
        settings = _settings(arguments)
        return survey_bag(bag, inspect, named, camera, rules, settings, bar.update)


def _of_cloud(arguments: argparse.Namespace, rules: Rules | None) -> Report:
    cloud, frame_id = read_ply(arguments.input)
    in_camera = frame_id == _CAMERA_FRAME
    viewpoint = (0.0, 0.0, 0.0) if in_camera else viewpoint_of(cloud)
    observation = Observation(Path(arguments.input).name, cloud, viewpoint=viewpoint)
    return _of_one(arguments, observation, frame_id, rules)


def _of_photograph(arguments: argparse.Namespace, rules: Rules | None) -> Report:
    from ftp_dent_ros import profilometry

    if not arguments.rig or not arguments.pattern:
        raise ConfigurationError(
            f'{arguments.input}: a photograph needs its rig and its pattern: '
            'give --rig RIG.yaml and --pattern PATTERN.yaml'
        )
    rig, pattern = read_rig(find(arguments.rig)), read_pattern(find(arguments.pattern))
    reconstructor = profilometry.Reconstructor(
        rig, pattern, profilometry.Settings(stride=arguments.stride)
    )
    photograph = read_photograph(arguments.input)
    measured = reconstructor.measure(photograph)
    observation = Observation(
        Path(arguments.input).name,
        measured.cloud,
        coverage=measured.coverage,
        photograph=photograph.shown(),
    )
    return _of_one(arguments, observation, _CAMERA_FRAME, rules)


def _of_one(
    arguments: argparse.Namespace, observation: Observation, frame_id: str, rules: Rules | None
) -> Report:
    named, camera = _rig(arguments.rig)
    survey = Survey(inspect, settings=_settings(arguments))
    if survey.add(observation) is None:
        raise CloudError(survey.refused[0])
    in_camera = frame_id == _CAMERA_FRAME
    return survey.report(arguments.input, frame_id, named, camera if in_camera else None, rules)


def _settings(arguments: argparse.Namespace) -> Settings:
    return Settings(arguments.smallest_depth / _MM, arguments.smallest_width / _MM)


def _rig(name: str | None) -> tuple[tuple[str, str], Lens | None]:
    """Name and id of the calibration, and its camera."""
    if not name:
        return ('', ''), None
    file = find(name)
    return (file.name, content_id(file)), read_rig(file).camera
