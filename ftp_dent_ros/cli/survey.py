"""``ftp-dent survey``: bags of one aircraft to one skin, its dents and what was looked at."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ftp_dent_ros.cli import argument
from ftp_dent_ros.cli.arguments import SMALLEST, output_argument, progress_bar, smallest_of
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.files import find
from ftp_dent_ros.rig.rig import read_rig

if TYPE_CHECKING:
    from ftp_dent_ros.recording.reader import Bag
    from ftp_dent_ros.survey.writing import Surveyed

# Lines of each that a terminal shows; survey.json has all.
_REMARKS, _GAPS = 12, 6


ARGUMENTS = (
    argument('bags', nargs='+', metavar='BAG', help='bags of flights along one aircraft'),
    output_argument('survey.html, survey.json, mosaic.ply and pictures of the unrolled skin'),
    argument('--name', default='', help="the survey's; by default the first bag's"),
    argument(
        '--store',
        metavar='FILE',
        help="file of the aircraft's surveys, for `compare`",
    ),
    argument(
        '--rig', type=find, metavar='RIG.yaml', help='calibrated rig: bags of another are refused'
    ),
    argument(
        '--points',
        type=find,
        metavar='POINTS.yaml',
        help='three or more points whose coordinates on the aircraft are known, as survey.html '
        'saves them: places are given in these besides',
    ),
    *SMALLEST,
)


def run(arguments: argparse.Namespace) -> int:
    """Survey, write the files and print what was found."""
    # Only this needs the libraries of bags.
    from ftp_dent_ros.recording.clouds import count_clouds
    from ftp_dent_ros.recording.reader import open_bag
    from ftp_dent_ros.survey.aircraft_frame import aircraft_frame, read_reference_points
    from ftp_dent_ros.survey.store import SurveyStore
    from ftp_dent_ros.survey.surveying import survey_bags
    from ftp_dent_ros.survey.writing import write_survey

    bags = [open_bag(path) for path in arguments.bags]
    rig_id = _rig_of(bags, arguments.rig)
    name = arguments.name or bags[0].path.stem
    store = SurveyStore(arguments.store) if arguments.store else None
    if store:
        store.check_new(name)
    count = sum(count_clouds(bag)[0] for bag in bags)
    with progress_bar('surveying', 3 * count, 'cloud') as bar:
        surveys = survey_bags(bags, name, smallest_of(arguments), rig_id, bar.update)
    for number, survey in enumerate(surveys, 1):
        frame = None
        # Reference points are those of the first part, whose pictures they were picked in.
        if arguments.points and number == 1:
            points = read_reference_points(arguments.points, survey.result)
            frame = aircraft_frame(points)
        folder = arguments.output / f'part-{number}' if number > 1 else arguments.output
        files = write_survey(folder, survey, frame)
        if store:
            store.add(survey.result)
        _print(survey)
        for path in files:
            print(path)
    stale = arguments.output / f'part-{len(surveys) + 1}'
    if stale.exists():
        print(f'{stale}: is of another survey, of before')
    return 0


def _print(survey: Surveyed) -> None:
    """What was found, for the terminal."""
    result, remarks = survey.result, survey.joined.remarks
    used, left_out = survey.joined.pairs
    clouds = len(survey.joined.numbers)
    print(f'{result.name}: {clouds} clouds, joined by {used} pairs; {left_out} left out')
    for text in remarks[:_REMARKS]:
        print(f'  {text}')
    if len(remarks) > _REMARKS:
        print(f'  and {len(remarks) - _REMARKS} more remarks in survey.json')
    dents = [each for each in result.dents if each.dent.kind == 'dent']
    print(f'{len(dents)} dents, {len(result.dents) - len(dents)} others')
    for each in dents:
        x, y = survey.mosaic.skin.place(each.dent.position)[:2]
        dent = each.dent
        print(
            f'{each.number:4}  x {x:7.3f} m, y {y:7.3f} m, depth {dent.depth.value * 1e3:.3f} mm, '
            f'length {dent.length.value * 1e3:.1f} mm, width {dent.width.value * 1e3:.1f} mm, '
            f'seen {each.sightings} times' + (f', {dent.reason}' if dent.reason else '')
        )
    print(f'{survey.mosaic.area:.3f} m2 of the skin were measured')
    for gap in survey.mosaic.gaps()[0][:_GAPS]:
        x, y = gap.place
        width, height = gap.size * 1e3
        print(f'  not measured: {width:.0f} mm by {height:.0f} mm at x {x:.3f} m, y {y:.3f} m')


def _rig_of(bags: Sequence[Bag], given: Path | None) -> str:
    """Id of the one rig that measured all bags, as far as they tell; else of the file given."""
    from ftp_dent_ros.recording import clouds

    # The first that tells which rig it is: a file, or a bag.
    known, whose = (read_rig(given).id, given) if given else ('', None)
    for bag in bags:
        rig = clouds.rig_id_of(bag)
        if rig and known and rig != known:
            raise ConfigurationError(
                f'{bag.path}: was measured by the rig {rig}, and {whose} is of the rig {known}: '
                'a survey is of one rig: survey them one by one, and compare'
            )
        if rig and not known:
            known, whose = rig, bag.path
    return known
