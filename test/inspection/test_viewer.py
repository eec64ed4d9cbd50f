"""The page's 3-D viewer in a browser, where one is installed."""

import pytest
from chromium import Chromium
from dent_samples import DENTED, TrueInspector, noisy_cloud

from ftp_dent_ros.cloud.seen import SeenCloud
from ftp_dent_ros.inspection.inspecting import CloudInspector
from ftp_dent_ros.inspection.page import write_report

# Counts what was drawn: grey skin is not counted as red, coloured dents are.
COUNTED = """
(() => {
  const canvas = document.querySelector('#view canvas');
  const gl = canvas.getContext('webgl2');
  const pixels = new Uint8Array(4 * canvas.width * canvas.height);
  gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let red = 0, drawn = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    if (pixels[i + 3] && pixels[i] + pixels[i + 1] + pixels[i + 2] < 740) drawn += 1;
    if (pixels[i] > pixels[i + 2] + 60) red += 1;
  }
  return [drawn, red, canvas.width * canvas.height];
})()
"""
# The script has come to its end: the slider tells its factor; or it says that it cannot.
READY = """(
  document.querySelector('#view.dead') ? 'dead' : document.querySelector('#times').textContent
)"""


@pytest.fixture
def browser(tmp_path):
    chromium = Chromium(tmp_path / 'profile', size=(900, 900))
    yield chromium
    chromium.close()


def test_the_skin_and_its_dents_are_drawn(tmp_path, browser):
    survey = CloudInspector(TrueInspector(DENTED))
    survey.add(SeenCloud('cloud', noisy_cloud()))
    page = write_report(tmp_path, survey.report('cloud.ply'))
    browser.open(page.as_uri())

    if browser.until(f"document.readyState === 'complete' && {READY}") == 'dead':
        pytest.skip('this Chromium shows no WebGL 2')
    drawn, red, total = browser.value(COUNTED)
    assert total > 100_000
    assert drawn > 0.1 * total
    assert 0.002 * total < red < 0.5 * drawn
    assert browser.errors == []
