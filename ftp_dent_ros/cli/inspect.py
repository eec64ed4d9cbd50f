"""``ftp-dent inspect``: clouds, photographs or bags to their dents and their report."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tqdm import tqdm

from ftp_dent_ros import profilometry
from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import (
    RULES,
    SMALLEST,
    number,
    output_argument,
    progress_bar,
    smallest_of,
)
from ftp_dent_ros.cloud.ply import read_ply
from ftp_dent_ros.cloud.seen import CAMERA_FRAME, SeenCloud
from ftp_dent_ros.dents.rules import verdict
from ftp_dent_ros.errors import CloudError, ConfigurationError, FtpDentError
from ftp_dent_ros.files import find
from ftp_dent_ros.fleet import LostWorkerError, cores, in_order, on_cluster, side_by_side
from ftp_dent_ros.inspection.inspecting import CloudInspector, survey_bag
from ftp_dent_ros.inspection.measuring.inspection import inspect
from ftp_dent_ros.inspection.page import write_report
from ftp_dent_ros.inspection.report import InspectionReport
from ftp_dent_ros.pattern.file import read_pattern
from ftp_dent_ros.photograph.file import is_photograph, read_photograph
from ftp_dent_ros.rig.rig import Lens, read_rig

ARGUMENTS = (
    argument(
        'inputs',
        type=Path,
        nargs='+',
        metavar='CLOUD.ply|IMAGE|BAG',
        help='a cloud of `ftp-dent reconstruct`, a photograph, or a bag with clouds',
    ),
    output_argument('dents.json, dents.csv, report.html; of several inputs, a folder for each'),
    argument(
        '--rig', type=find, metavar='RIG.yaml', help='calibrated rig; needed for a photograph'
    ),
    argument(
        '--pattern',
        type=find,
        metavar='PATTERN.yaml',
        help='projected pattern; needed for a photograph',
    ),
    RULES,
    *SMALLEST,
    argument(
        '--stride', type=int, default=2, metavar='N', help="a photograph's every N-th pixel only"
    ),
    argument(
        '--survey',
        action='store_true',
        help="lay a bag's clouds on each other first, by the image of their skin: the report "
        'shows the whole skin, and what of it was measured',
    ),
    argument(
        '--jobs',
        type=number('--jobs', 1, kind=int),
        metavar='N',
        help="inputs, or one bag's clouds, inspected at once; default: one a core",
    ),
    argument(
        '--scheduler',
        metavar='ADDRESS',
        help='inspect on the workers of this Dask scheduler, which see the same files',
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Inspect, print a line a dent, and write the report."""
    # Before minutes of the other inputs.
    profilometry.Settings(stride=arguments.stride)
    if len(arguments.inputs) > 1 or arguments.scheduler:
        return inspect_several(arguments)
    with progress_bar('inspecting', None, 'cloud') as bar:
        report = report_of(arguments, arguments.inputs[0], bar, arguments.jobs or cores())
    page = write_report(arguments.output, report)
    print(summary(report))
    print(f'{page}')
    return 0


def summary(report: InspectionReport) -> str:
    """A line a dent."""
    lines = [f'{len(report.dents)} dents, {len(report.others)} others']
    for entry, findings in zip(report.dents, report.findings(), strict=True):
        dent = entry.dent
        line = (
            f'{entry.number:4}  depth {dent.depth.value * 1e3:.3f} mm, '
            f'length {dent.length.value * 1e3:.1f} mm, width {dent.width.value * 1e3:.1f} mm'
        )
        line += ', cut' if dent.is_cut else ''
        line += f', {entry.reason}' if entry.reason else ''
        line += f', seen {len(entry.sightings)} times' if len(report.frames) > 1 else ''
        lines.append(line + (f': {verdict(findings)}' if findings else ''))
    for entry in report.others:
        dent = entry.dent
        sizes = f'{dent.depth.value * 1e3:.3f} mm, length {dent.length.value * 1e3:.1f} mm'
        lines.append(f'      {dent.kind} {sizes}' + (f': {entry.reason}' if entry.reason else ''))
    lines += report.remarks
    if report.skipped:
        lines.append(f'{len(report.skipped)} messages skipped, the first: {report.skipped[0]}')
    return '\n'.join(lines)


def report_of(arguments: argparse.Namespace, path: Path, bar: tqdm, jobs: int) -> InspectionReport:
    """Inspect one of the inputs.

    Parameters
    ----------
    arguments : Namespace
        Of the command.
    path : Path
        A cloud, a photograph or a bag.
    bar : tqdm
        Of the clouds of a bag.
    jobs : int
        Processes that inspect a bag's clouds.

    Raises
    ------
    FtpDentError
        It cannot be inspected; the message says why.
    """
    if not path.exists():
        raise ConfigurationError(f'{path}: no such file: check the path')
    if path.is_dir() or path.suffix.lower() == '.mcap':
        return _of_bag(arguments, path, bar, jobs)
    if arguments.survey:
        raise ConfigurationError(f'{path}: is no bag, whose clouds --survey joins: leave it out')
    measured_by = ''
    if path.suffix.lower() == '.ply':
        cloud, frame_id, measured_by = read_ply(path)
        in_camera = frame_id == CAMERA_FRAME
        seen = SeenCloud(path.name, cloud, frame_id=frame_id, in_camera=in_camera)
    elif is_photograph(path):
        seen = _photographed(arguments, path)
    else:
        raise ConfigurationError(
            f'{path}: neither a cloud (.ply), nor a photograph, nor a bag: give one of them'
        )
    named, camera = _rig(arguments, path, measured_by)
    inspector = CloudInspector(inspect, settings=smallest_of(arguments))
    if inspector.add(seen) is None:
        raise CloudError(inspector.refused[0])
    return inspector.report(str(path), named, camera, arguments.rules)


def _of_bag(arguments: argparse.Namespace, path: Path, bar: tqdm, jobs: int) -> InspectionReport:
    # Only this needs the libraries of bags.
    from ftp_dent_ros.recording import clouds
    from ftp_dent_ros.recording.reader import open_bag

    bag = open_bag(path)
    named, camera = _rig(arguments, path, clouds.rig_id_of(bag))
    count, _ = clouds.count_clouds(bag)
    how = arguments.rules, smallest_of(arguments)
    if arguments.survey:
        from ftp_dent_ros.survey.surveying import report_on_skin

        bar.total = 3 * count
        return report_on_skin(bag, named, camera, *how, bar.update)[0]
    bar.total = count
    # Clouds that take as long as another process does to begin.
    each = partial(in_order, jobs=min(jobs, count // 10))
    return survey_bag(bag, inspect, named, camera, *how, progress=bar.update, each=each)


def _photographed(arguments: argparse.Namespace, path: Path) -> SeenCloud:
    if not arguments.rig or not arguments.pattern:
        raise ConfigurationError(
            f'{path}: a photograph needs its rig and its pattern: '
            'give --rig RIG.yaml and --pattern PATTERN.yaml'
        )
    rig, pattern = read_rig(arguments.rig), read_pattern(arguments.pattern)
    settings = profilometry.Settings(stride=arguments.stride)
    photograph = read_photograph(str(path))
    measured = profilometry.Reconstructor(rig, pattern, settings).measure(photograph, True)
    return SeenCloud(
        path.name, measured.cloud, coverage=measured.coverage, photograph=photograph.shown()
    )


def _rig(
    arguments: argparse.Namespace, path: Path, measured_by: str
) -> tuple[tuple[str, str], Lens | None]:
    """Name and id of the calibration, and its camera; the input may say which id it is."""
    if not arguments.rig:
        return ('', measured_by), None
    rig = read_rig(arguments.rig)
    if measured_by and measured_by != rig.id:
        raise ConfigurationError(
            f'{arguments.rig}: is the rig {rig.id}, and {path} was measured by the rig '
            f'{measured_by}: give that one, or none'
        )
    return (arguments.rig.name, rig.id), rig.camera


def inspect_several(arguments: argparse.Namespace) -> int:
    """Inspect all; 2 if any of them failed.

    Raises
    ------
    ConfigurationError
        Two inputs are one, or there is no scheduler.
    """
    folders = _folders(arguments.inputs, arguments.output)
    tasks = [(arguments, *each) for each in zip(arguments.inputs, folders, strict=True)]
    results = (
        on_cluster(_inspect_into, tasks, arguments.scheduler)
        if arguments.scheduler
        else side_by_side(_inspect_into, tasks, arguments.jobs or cores())
    )
    failed = 0
    with progress_bar('inspecting', len(tasks), 'input') as bar:
        for (_, path, folder), outcome in results:
            if isinstance(outcome, Exception):
                failed += 1
                bar.write(_failure(str(path), outcome), file=sys.stderr)
            else:
                bar.write(f'{path}: {outcome}: {folder}')
            bar.update()
    print(f'{len(tasks) - failed} inspected, {failed} failed')
    return 2 if failed else 0


def _failure(path: str, error: Exception) -> str:
    """Why an input was not inspected: one must not cost all the others."""
    text = str(error)
    if isinstance(error, LostWorkerError):
        text = f'not inspected ({error}): try it alone'
    elif not isinstance(error, FtpDentError):
        text = f'a defect of the software ({type(error).__name__}: {error}): report it'
    return text if text.startswith(path) else f'{path}: {text}'


def _inspect_into(task: tuple[argparse.Namespace, Path, Path]) -> str:
    """Inspect one input and write its report, in whatever process this is."""
    arguments, path, folder = task
    started = time.perf_counter()
    report = report_of(arguments, path, tqdm(disable=True), 1)
    write_report(folder, report)
    left_out = len(report.refused) + len(report.skipped)
    text = f'{len(report.dents)} dents, {len(report.others)} others'
    text += f', {len(report.frames)} clouds' if len(report.frames) > 1 else ''
    text += f', {left_out} left out' if left_out else ''
    return f'{text} in {time.perf_counter() - started:.1f} s'


def _folders(inputs: Sequence[Path], output: Path) -> list[Path]:
    """A folder for each input, by as much of its path as tells it from the others."""
    paths = [Path(os.path.abspath(path)) for path in inputs]
    for path, times in Counter(paths).items():
        if times > 1:
            raise ConfigurationError(f'{path} is given {times} times: give each input once')
    above = Path(os.path.commonpath([path.parent for path in paths]))
    names = [path.relative_to(above) for path in paths]
    short = [name.with_suffix('') for name in names]
    return [output / name for name in (short if len(set(short)) == len(short) else names)]
