"""``ftp-dent inspect``: clouds, photographs or bags to their dents and their report."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from tqdm import tqdm

from ftp_dent_ros import profilometry
from ftp_dent_ros.cli.inspect_several import inspect_several
from ftp_dent_ros.cli.inspection_arguments import (
    add_settings_arguments,
    output_folder,
    settings_of,
)
from ftp_dent_ros.cli.inspection_request import Request, report_of
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.inspection.reporting.content import Report
from ftp_dent_ros.inspection.reporting.files import write_report
from ftp_dent_ros.inspection.reporting.rules import verdict
from ftp_dent_ros.inspection.tracking.sightings import ListedDent


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        'inputs',
        nargs='+',
        metavar='CLOUD.ply|IMAGE|BAG',
        help='a cloud of `ftp-dent reconstruct`, a photograph, or a bag with clouds',
    )
    parser.add_argument(
        '--output',
        required=True,
        metavar='DIR',
        help='takes dents.json, dents.csv, report.html; of several inputs, a folder for each',
    )
    parser.add_argument(
        '--rig', metavar='RIG.yaml', help='calibrated rig; needed for a photograph'
    )
    parser.add_argument(
        '--pattern', metavar='PATTERN.yaml', help='projected pattern; needed for a photograph'
    )
    parser.add_argument('--rules', metavar='RULES.yaml', help='limits to judge the dents by')
    add_settings_arguments(parser)
    parser.add_argument(
        '--stride', type=int, default=2, metavar='N', help="a photograph's every N-th pixel only"
    )
    parser.add_argument(
        '--survey',
        action='store_true',
        help="lay a bag's clouds on each other first, by the image of their skin: the report "
        'shows the whole skin, and what of it was measured',
    )
    parser.add_argument(
        '--jobs',
        type=int,
        metavar='N',
        help="inputs, or one bag's clouds, inspected at once; default: one a core",
    )
    parser.add_argument(
        '--scheduler',
        metavar='ADDRESS',
        help='inspect on the workers of this Dask scheduler, which see the same files',
    )


def run(arguments: argparse.Namespace) -> int:
    """Inspect, print a line a dent, and write the report."""
    output = output_folder(arguments)
    if arguments.jobs is not None and arguments.jobs < 1:
        raise ConfigurationError(f'--jobs is {arguments.jobs}: give at least 1')
    settings = settings_of(arguments)
    # Before minutes of the other inputs.
    profilometry.Settings(stride=arguments.stride)
    files = arguments.rig, arguments.pattern, arguments.rules
    requests = [
        Request(Path(name), *files, settings, arguments.stride, arguments.survey)
        for name in arguments.inputs
    ]
    if len(requests) > 1 or arguments.scheduler:
        return inspect_several(requests, output, arguments.jobs, arguments.scheduler)
    with tqdm(desc='inspecting', unit='cloud', dynamic_ncols=True, delay=0.5, disable=None) as bar:

        def progress(count: int) -> None:
            bar.total = count
            bar.update()

        jobs = arguments.jobs or len(os.sched_getaffinity(0))
        report = report_of(requests[0], progress, jobs)
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
        line += f', {entry.reason}' if entry.reason else ''
        line += f', seen {len(entry.sightings)} times' if len(report.frames) > 1 else ''
        lines.append(line + (f': {verdict(findings)}' if findings else ''))
    lines += [_other(entry) for entry in report.others]
    lines += report.remarks
    if report.skipped:
        lines.append(f'{len(report.skipped)} messages skipped, the first: {report.skipped[0]}')
    return '\n'.join(lines)


def _other(entry: ListedDent) -> str:
    dent = entry.dent
    sizes = f'{dent.depth.value * 1e3:.3f} mm, length {dent.length.value * 1e3:.1f} mm'
    return f'      {dent.kind} {sizes}' + (f': {entry.reason}' if entry.reason else '')
