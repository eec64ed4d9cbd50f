"""A real Chromium, headless, spoken to over a pipe (the DevTools protocol)."""

import contextlib
import json
import os
import shutil
import subprocess
import time

import pytest

NAMES = ('chromium', 'chromium-browser', 'google-chrome')


class Chromium:
    """One page of a browser that is started for it."""

    def __init__(self, folder, size=(1180, 820)):
        program = next(filter(None, map(shutil.which, NAMES)), None)
        if program is None:
            pytest.skip('Chromium is not installed: the page is not tested in a browser')
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        moved = f'exec {program} "$@" 3<&{to_browser} 4>&{from_browser}'
        options = (
            *('--headless=new', '--no-sandbox', '--remote-debugging-pipe'),
            # WebGL without a graphics card.
            *('--use-angle=swiftshader', '--enable-unsafe-swiftshader'),
            *('--no-first-run', '--disable-dev-shm-usage', f'--user-data-dir={folder}'),
            *(f'--window-size={size[0]},{size[1]}', '--disable-background-networking'),
            'about:blank',
        )
        # In bash, for descriptors of two digits.
        self._process = subprocess.Popen(
            ['bash', '-c', moved, 'bash', *options],
            pass_fds=(to_browser, from_browser),
            stderr=subprocess.DEVNULL,
            env={key: value for key, value in os.environ.items() if key != 'LD_LIBRARY_PATH'},
        )
        os.close(to_browser)
        os.close(from_browser)
        self._number, self._rest, self._session = 0, b'', None
        self.errors = []
        targets = self._call('Target.getTargets')['targetInfos']
        page = next(each for each in targets if each['type'] == 'page')
        attached = self._call('Target.attachToTarget', targetId=page['targetId'], flatten=True)
        self._session = attached['sessionId']
        self._call('Runtime.enable')
        self._call('Log.enable')

    def open(self, url):
        self._call('Page.navigate', url=url)

    def value(self, expression):
        """What an expression gives in the page; a promise is waited for."""
        answer = self._call(
            'Runtime.evaluate', expression=expression, returnByValue=True, awaitPromise=True
        )
        return answer['result'].get('value')

    def until(self, expression, seconds=120.0):
        """Wait for an expression to give something true, which is returned."""
        end = time.monotonic() + seconds
        while not (value := self.value(expression)):
            assert time.monotonic() < end, f'not reached: {expression}; {self.errors}'
            time.sleep(0.05)
        return value

    def picture(self):
        """PNG of the page as it is, base64."""
        return self._call('Page.captureScreenshot', captureBeyondViewport=True)['data']

    def close(self):
        self._process.terminate()
        self._process.wait(60)
        for end in (self._in, self._out):
            with contextlib.suppress(OSError):
                os.close(end)

    def _call(self, method, **parameters):
        self._number += 1
        message = {'id': self._number, 'method': method, 'params': parameters}
        if self._session:
            message['sessionId'] = self._session
        os.write(self._out, json.dumps(message).encode() + b'\0')
        while True:
            answer = self._read()
            if answer.get('id') == self._number:
                assert 'result' in answer, answer
                return answer['result']
            if answer.get('method') == 'Runtime.exceptionThrown':
                self.errors.append(answer['params']['exceptionDetails'])
            if answer.get('method') == 'Log.entryAdded':
                self.errors.append(answer['params']['entry'])

    def _read(self):
        while b'\0' not in self._rest:
            more = os.read(self._in, 1 << 20)
            assert more, 'the browser has ended'
            self._rest += more
        line, _, self._rest = self._rest.partition(b'\0')
        return json.loads(line)
