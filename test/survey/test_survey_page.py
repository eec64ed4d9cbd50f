"""The survey's page in a browser: places are picked in the pictures, and make a points file."""

import json

import numpy as np
from chromium import Chromium
from flown_skin import FlownSkin
from test_survey_command import record

from ftp_dent_ros.cli.main import main
from ftp_dent_ros.pose import Pose
from ftp_dent_ros.survey.aircraft_frame import aircraft_frame, read_reference_points
from ftp_dent_ros.survey.store import SurveyStore

# Of the survey's frame in the aircraft's, whose coordinates are typed: millimetres.
AIRCRAFT = Pose.from_rpy((0.1, -0.2, 0.8), (12.0, -1.5, 3.0))

# The script has come to its end.
READY = "document.readyState === 'complete' && document.getElementById('lacking').textContent"
# Of the dents in the first picture; and where the pictures' parts begin.
MIDDLES = """
[...document.querySelectorAll('.skin:first-of-type .edge')].map((each) => {
  const box = each.getBBox();
  return [box.x + box.width / 2, box.y + box.height / 2];
})
"""
STARTS = "[...document.querySelectorAll('.skin svg')].map((each) => each.viewBox.baseVal.x)"
CLICK = """
((layer, u, v) => {
  const svg = document.querySelectorAll('.skin svg')[layer];
  const box = svg.getBoundingClientRect(), size = svg.viewBox.baseVal;
  const at = { clientX: box.left + u * box.width / size.width,
    clientY: box.top + v * box.height / size.height, bubbles: true };
  svg.dispatchEvent(new MouseEvent('click', at));
  return document.getElementById('here').textContent;
})(%d, %f, %f)
"""


def test_picked_points_give_the_aircrafts_frame(tmp_path):
    """The skin is a long strip, shown in two parts."""
    dents = ((0.0, 0.06, 0.03, 5e-4), (0.1, -0.06, 0.025, 4e-4), (0.95, 0.02, 0.03, 4e-4))
    skin, out, store = FlownSkin(26, dents=dents), tmp_path / 'out', tmp_path / 'aircraft.sqlite'
    poses = list(skin.flight(6, step=0.2))
    bag = record(tmp_path / 'flight', skin, poses, poses)
    words = ['survey', str(bag), '--output', str(out)]
    assert main([*words, '--name', 'spring', '--store', str(store)]) == 0
    found = json.loads((out / 'survey.json').read_text())
    dents = [each for each in found['dents'] if each['kind'] == 'dent']
    assert len(dents) == 3
    browser = Chromium(tmp_path / 'profile')
    try:
        browser.open((out / 'survey.html').as_uri())
        browser.until(READY)
        assert browser.value("document.querySelectorAll('.skin').length") == 3
        starts = browser.value(STARTS)
        assert len(starts) == 6
        for layer, (u, v) in enumerate(browser.value(MIDDLES)):
            part = int(u >= starts[1])
            told = browser.value(CLICK % (2 * layer + part, u - starts[part], v))
            assert 'a dent would have been found there from 0.' in told
        # Beyond the rim there is nothing to pick.
        assert 'not measured' in browser.value(CLICK % (0, 2, 2))
        picked = browser.value('picks.map((pick) => pick.point)')
        np.testing.assert_allclose(picked, [each['position'] for each in dents], atol=1.5e-3)
        assert browser.value("document.getElementById('lacking').textContent").startswith('0 of 3')
        for index, point in enumerate(picked):
            for place, value in enumerate(AIRCRAFT.apply(np.array(point)) * 1e3):
                browser.value(
                    f"(() => {{ const field = document.querySelectorAll('#picks tr')[{index}]"
                    f".querySelectorAll('input')[{place + 1}]; field.value = '{value:.2f}';"
                    "field.dispatchEvent(new Event('input')); })()"
                )
        text = browser.value("document.getElementById('file').value")
        assert browser.errors == []
    finally:
        browser.close()
    points = tmp_path / 'points.yaml'
    points.write_text(text)
    survey = SurveyStore(store).read('spring')
    frame = aircraft_frame(read_reference_points(points, survey))
    place = np.array(dents[0]['position'])
    np.testing.assert_allclose(frame.place(place)[0], AIRCRAFT.apply(place), atol=1e-4)

    words[-1] = str(tmp_path / 'again')
    assert main([*words, '--points', str(points)]) == 0
    again = json.loads((tmp_path / 'again/survey.json').read_text())['dents'][0]
    expected = AIRCRAFT.apply(np.array(again['position'])) * 1e3
    np.testing.assert_allclose(again['aircraft_mm'], expected, atol=0.1)
    assert 0.3 < again['aircraft_uncertainty_mm'][0] < 3
    assert 'Station, buttock line, water line' in (tmp_path / 'again/survey.html').read_text()
