"""The page's 3-D viewer in a browser, where one is installed."""

import re
import shutil
import subprocess

import pytest
from dent_samples import DENTED, TrueInspector, noisy_cloud

from ftp_dent_ros.inspection.observation import Observation
from ftp_dent_ros.inspection.reporting.files import write_report
from ftp_dent_ros.inspection.reporting.survey import Survey

BROWSER = next(
    filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), None
)
# Counts what was drawn: grey skin is not counted, coloured dents are.
PROBE = """
<script>
  window.addEventListener('load', () => requestAnimationFrame(() => requestAnimationFrame(() => {
    const canvas = document.querySelector('#view canvas');
    const gl = canvas && canvas.getContext('webgl2');
    let red = 0, drawn = 0;
    if (gl) {
      const pixels = new Uint8Array(4 * canvas.width * canvas.height);
      gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      for (let i = 0; i < pixels.length; i += 4) {
        if (pixels[i + 3] && pixels[i] + pixels[i + 1] + pixels[i + 2] < 740) drawn += 1;
        if (pixels[i] > pixels[i + 2] + 60) red += 1;
      }
    }
    document.title = `drawn ${drawn} red ${red} of ${canvas ? canvas.width * canvas.height : 0}`;
  })));
</script>
"""


@pytest.mark.skipif(BROWSER is None, reason='no Chromium is installed')
def test_the_skin_and_its_dents_are_drawn(tmp_path):
    survey = Survey(TrueInspector(DENTED))
    survey.add(Observation('cloud', noisy_cloud()))
    page = write_report(tmp_path, survey.report('cloud.ply', 'camera_optical_frame'))
    page.write_text(page.read_text().replace('</body>', PROBE + '</body>'))

    words = ['--headless', '--no-sandbox', '--disable-dev-shm-usage', '--use-angle=swiftshader']
    words += ['--enable-unsafe-swiftshader', '--window-size=900,900', '--virtual-time-budget=5000']
    words += [f'--user-data-dir={tmp_path / "profile"}', '--dump-dom', page.as_uri()]
    seen = subprocess.run(
        [BROWSER, *words], capture_output=True, text=True, timeout=120, check=True
    ).stdout

    if re.search(r'id="view"[^>]*class="dead"', seen):
        pytest.skip('this Chromium shows no WebGL 2')
    drawn, red, total = map(
        int, re.search(r'<title>drawn (\d+) red (\d+) of (\d+)', seen).groups()
    )
    assert total > 100_000
    assert drawn > 0.1 * total
    assert 0.002 * total < red < 0.5 * drawn
    # The script has come to its end: the slider tells its factor.
    assert re.search(r'<output id="times">[^<]+</output>', seen)
