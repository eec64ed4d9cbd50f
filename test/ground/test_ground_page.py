"""The page with a real station behind it, in a real browser."""

import http.client
import socket
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest
from skins import skin

pytest.importorskip('aiohttp', reason='aiohttp is not installed: the page is not tested')
pytest.importorskip('zenoh', reason='Zenoh is not installed: the page is not tested')
pytest.importorskip('rosbags', reason='rosbags is not installed: the page is not tested')

from chromium import Chromium
from free_address import free_address
from rosbags.interfaces import Nodetype

from ftp_dent_ros.coding.cloud_codec import encode
from ftp_dent_ros.coding.messages import DENT
from ftp_dent_ros.errors import CodecError, ConfigurationError
from ftp_dent_ros.ground import topics
from ftp_dent_ros.ground.commands import Answer, Executive
from ftp_dent_ros.ground.drone import Drone
from ftp_dent_ros.ground.link import GroundLink, Security
from ftp_dent_ros.ground.page.scene import PageScene
from ftp_dent_ros.ground.page.server import PageServer
from ftp_dent_ros.ground.protocol import Importance, Item
from ftp_dent_ros.ground.station import Station
from ftp_dent_ros.recording.topic import typestore

STAMP = 1_700_000_000_500_000_000


def message(kind, **given):
    """Message made without ROS; what is not given is 0, empty, or the same of a part."""
    values = {}
    for name, (node, details) in typestore().fielddefs[kind][1]:
        if name in given:
            values[name] = given[name]
        elif node == Nodetype.NAME:
            values[name] = message(details)
        elif node == Nodetype.BASE:
            values[name] = '' if details[0] == 'string' else 0
        elif node == Nodetype.ARRAY:
            values[name] = np.zeros(details[1])
        else:
            values[name] = np.zeros(0, np.uint8) if details[0][1] == ('uint8', 0) else []
    return typestore().types[kind](**values)


def coded(topic, kind, importance=Importance.DENTS, **values):
    """Item of a message."""
    data = bytes(typestore().serialize_cdr(message(kind, **values), kind))
    return Item(importance, topic, f'cdr:{kind}', STAMP, data)


def header():
    stamp = message('builtin_interfaces/msg/Time', sec=STAMP // 10**9, nanosec=STAMP % 10**9)
    return message('std_msgs/msg/Header', stamp=stamp, frame_id='map')


def point(x, y, z):
    return message('geometry_msgs/msg/Point', x=float(x), y=float(y), z=float(z))


def pose(*place):
    turn = message('geometry_msgs/msg/Quaternion', w=1.0)
    return message('geometry_msgs/msg/Pose', position=point(*place), orientation=turn)


def pose_item(topic):
    kind = 'geometry_msgs/msg/PoseWithCovariance'
    given = {'header': header(), 'pose': message(kind, pose=pose(1, 2, 3))}
    return coded(topic, f'{kind}Stamped', Importance.POSES, **given)


def dents_item():
    """One dent of 40 x 30 x 1.5 mm in the middle of the view, 0.8 m ahead."""
    dent = np.zeros(1, DENT)
    values = {'x': 1.0, 'y': 2.0, 'z': 3.8, 'normal_z': -1, 'axis_x': 1, 'number': 7}
    values |= {'length': 0.04, 'width': 0.03, 'depth': 1.5e-3, 'sightings': 3}
    values |= {'length_uncertainty': 1e-3, 'width_uncertainty': 1e-3, 'depth_uncertainty': 2e-5}
    for name, value in values.items():
        dent[name] = value
    kind = 'sensor_msgs/msg/PointField'
    fields = [
        message(kind, name=name, offset=DENT.fields[name][1], datatype=7, count=1)
        for name in DENT.names
    ]
    given = {'header': header(), 'height': 1, 'width': 1, 'fields': fields}
    given |= {'point_step': DENT.itemsize, 'data': dent.view(np.uint8)}
    return coded('dents/list', 'sensor_msgs/msg/PointCloud2', **given)


def path_item(*places):
    poses = [
        message('geometry_msgs/msg/PoseStamped', header=header(), pose=pose(*place))
        for place in places
    ]
    return coded('survey/path', 'nav_msgs/msg/Path', header=header(), poses=poses)


def coverage_item():
    """A measured strip of 1 x 0.2 m, and a gap of 0.02 m beside it."""

    def marker(ns, low, high):
        a, b, c, d = (point(x, y, 3.8) for x, y in ((0, low), (1, low), (1, high), (0, high)))
        points = [a, b, c, a, c, d]
        return message('visualization_msgs/msg/Marker', header=header(), ns=ns, points=points)

    markers = [marker('measured', 2.0, 2.2), marker('gaps', 2.2, 2.22)]
    return coded('survey/coverage', 'visualization_msgs/msg/MarkerArray', markers=markers)


def state_item(text='works'):
    kind = 'diagnostic_msgs/msg/DiagnosticStatus'
    value = message('diagnostic_msgs/msg/KeyValue', key='recording', value='not recording')
    status = message(kind, level=0, name='downlink', message=text, values=[value])
    return coded(
        topics.DIAGNOSTICS,
        'diagnostic_msgs/msg/DiagnosticArray',
        Importance.STATE,
        header=header(),
        status=[status],
    )


def picture_item(view):
    image = np.full((view.lens.height, view.lens.width, 3), 120, np.uint8)
    data = cv2.imencode('.jpg', image)[1].tobytes()
    given = {'frame': 'camera', 'lens': view.lens}
    return Item(Importance.PICTURES, topics.IMAGE, 'jpeg', STAMP, data, **given)


def cloud_item(view):
    data = encode(skin(view), view)
    return Item(Importance.PREVIEWS, topics.PREVIEW_POINTS, 'cloud', STAMP, data, frame='camera')


@pytest.fixture
def items(view):
    return [
        pose_item(topics.CAMERA_POSE),
        dents_item(),
        state_item(),
        picture_item(view),
        cloud_item(view),
    ]


def test_the_scene_places_the_dent_in_the_picture(items, view):
    scene = PageScene()
    for item in items:
        scene.take(item)
    state = scene.state()
    (outline,) = state['picture']['outlines']
    middle = np.mean(outline['points'], axis=0)
    np.testing.assert_allclose(middle, view.lens.camera_matrix[:2, 2], atol=1.0)
    across = np.ptp(outline['points'], axis=0)
    np.testing.assert_allclose(across, [850 * 0.05, 852 * 0.0375], atol=1.5)
    assert state['dents'][0]['depth_mm'] == pytest.approx(1.5)
    assert state['path'] == [[1.0, 2.0, 3.0]] and len(state['areas']) == 1
    values = np.frombuffer(scene.cloud, '<f4').reshape(-1, 4)
    # The dent of the skin is the deepest deviation away from its smooth form.
    assert len(values) > 10_000 and np.abs(np.median(values[:, 3])) < 1.0


def test_where_the_survey_runs_the_map_shows_its_path_and_its_coverage(items):
    scene = PageScene()
    for item in [*items, path_item((0, 2, 3), (1, 2, 3)), coverage_item()]:
        scene.take(item)
    state = scene.state()
    assert state['path'] == [[0, 2, 3], [1, 2, 3]]
    strip = [[0, 2.0, 3.8], [1, 2.0, 3.8], [1, 2.2, 3.8], [0, 2.2, 3.8]]
    assert state['areas'] == [strip]
    assert state['gaps'] == [[[0, 2.2, 3.8], [1, 2.2, 3.8], [1, 2.22, 3.8], [0, 2.22, 3.8]]]
    empty = coded('survey/coverage', 'visualization_msgs/msg/MarkerArray', markers=[])
    for bad in (path_item((float('nan'), 0, 0)), empty):
        with pytest.raises(CodecError):
            scene.take(bad)
    assert scene.state() == state


def test_the_scene_refuses_what_is_no_item(items):
    scene = PageScene()
    for item in items:
        for data in (b'', b'x' * 50, item.data[:-9], b'\xff' * 300):
            with pytest.raises(CodecError):
                scene.take(Item(item.importance, item.topic, item.kind, 1, data))
    assert scene.version == 0 and scene.state()['dents'] == []


class Works:
    """A station that keeps the commands that it is given."""

    def __init__(self):
        self.done = []
        self.rate, self.summary = lambda: 125.0, lambda: (0, 'works')

    def command(self, name):
        self.done.append(name)
        return Answer(True, name)


@pytest.fixture
def served():
    station = Works()
    server = PageServer('127.0.0.1:0', station)
    yield urlsplit(server.url), station.done
    server.close()


def ask(url, method, path, body=None, **headers):
    """Status, text and cookie of an answer."""
    connection = http.client.HTTPConnection(url.hostname, url.port, timeout=60)
    connection.request(method, path, body, headers)
    response = connection.getresponse()
    data = response.read()
    connection.close()
    return response.status, data, response.getheader('Set-Cookie', '').partition(';')[0]


SIGN = {'X-Ftp-Dent': 'command'}


def test_commands_come_from_the_page_alone(served):
    url, done = served
    _, _, cookie = ask(url, 'GET', f'/?{url.query}')
    assert ask(url, 'POST', '/command/capture', Cookie=cookie, **SIGN)[:2] == (
        200,
        b'{"success": true, "message": "capture"}',
    )
    assert ask(url, 'POST', '/command/capture', Cookie=cookie)[0] == 403
    assert ask(url, 'POST', '/command/fly', Cookie=cookie, **SIGN)[0] == 404
    assert ask(url, 'GET', '/../../etc/passwd', Cookie=cookie)[0] == 404
    # A page of somebody else's in the same browser, which sends its cookies along.
    foreign = {'Origin': 'http://evil.example', 'Cookie': cookie}
    assert ask(url, 'POST', '/command/capture', **foreign, **SIGN)[0] == 403
    assert ask(url, 'GET', '/events', **foreign)[0] == 403
    assert ask(url, 'GET', '/foxglove', **foreign)[0] == 403
    assert done == ['capture']


def test_the_body_of_a_refused_request_is_no_request(served):
    url, done = served
    _, _, cookie = ask(url, 'GET', f'/?{url.query}')
    inner = f'POST /command/take_list HTTP/1.1\r\nHost: x\r\nCookie: {cookie}\r\n'
    inner += 'X-Ftp-Dent: command\r\nContent-Length: 0\r\n\r\n'
    for headers in ({}, {'Cookie': cookie, **SIGN}):
        with socket.create_connection((url.hostname, url.port), timeout=60) as connection:
            head = ''.join(f'{name}: {value}\r\n' for name, value in headers.items())
            connection.sendall(
                f'POST /command/capture HTTP/1.1\r\nHost: {url.netloc}\r\n{head}'
                f'Content-Length: {len(inner)}\r\n\r\n{inner}'.encode()
            )
            answer = b''.join(iter(lambda: connection.recv(65536), b''))  # until it is closed
        assert answer.count(b'HTTP/1.1') == 1 and b' 40' in answer[:15]
    assert done == []


def test_every_page_asks_for_its_own_key(served):
    url, _ = served
    other = PageServer('0.0.0.0:0', Works())
    try:
        beyond = urlsplit(other.url)
        here = beyond._replace(netloc=f'127.0.0.1:{beyond.port}')
        assert ask(url, 'GET', '/')[0] == ask(here, 'GET', '/')[0] == 403
        status, _, cookie = ask(url, 'GET', f'/?{url.query}')
        other_status, _, other_cookie = ask(here, 'GET', f'/?{here.query}')
        assert status == other_status == 200
        # A browser sends both to either port.
        both = f'{cookie}; {other_cookie}'
        assert ask(url, 'GET', '/page.js', Cookie=both)[0] == 200
        assert ask(here, 'GET', '/page.js', Cookie=both)[0] == 200
        assert ask(here, 'GET', '/page.js', Cookie=cookie)[0] == 403
    finally:
        other.close()
    with pytest.raises(ConfigurationError, match='cannot be served'):
        PageServer('nowhere', Works())


def test_the_page_shows_what_comes_and_its_buttons_command(items, tmp_path):
    address = free_address()
    done = []

    def capture():
        done.append(1)
        return Answer(True, 'photograph taken')

    browser = Chromium(tmp_path)
    drone = Drone(
        GroundLink('drone', address, Security()), None, 10**8, 0.0, Executive({'capture': capture})
    )
    pages = []
    station = Station(
        GroundLink('ground', address, Security()), lambda item: pages[0].take(item), 'browser'
    )
    pages.append(PageServer('127.0.0.1:0', station))
    try:
        browser.open(pages[0].url)
        for item in items:
            drone.put(item)
        browser.until("document.querySelectorAll('#dents tr').length === 1")
        row = browser.value("document.querySelector('#dents tr').innerText")
        assert row.split('\t')[0] == '7' and '1.500' in row and '± 0.039' in row  # 95 %
        browser.until("document.querySelectorAll('#outlines polygon').length === 1")
        browser.until("document.getElementById('picture').naturalWidth === 640")
        browser.until('cloudView.values.length > 1000')
        browser.until("document.getElementById('recording').textContent === 'not recording'")
        drone.put(items[0])  # Where nothing comes for three seconds the link is not good.
        browser.until("document.getElementById('link').className === 'chip good'")
        drone.put(coverage_item())
        browser.until('mapView.state.gaps.length === 1')
        for canvas in ('cloud', 'map'):
            shades = browser.value(
                f"new Set(document.getElementById('{canvas}').getContext('2d')"
                '.getImageData(0, 0, 960, 540).data).size'
            )
            assert shades > 20, canvas
        button = "document.querySelector('[data-command=capture]')"
        browser.value(f'{button}.click()')
        said = "document.getElementById('answer').textContent"
        assert 'photograph taken' in browser.until(f"{said}.includes('done') && {said}")
        assert done == [1]
        browser.value("document.querySelector('[data-command=start_recording]').click()")
        assert 'cannot' in browser.until(f"{said}.includes('failed') && {said}")
        # Large enough for fingers, and nothing is wider than the tablet.
        assert browser.value(f'{button}.getBoundingClientRect().height') >= 44
        assert browser.value('document.documentElement.scrollWidth <= innerWidth')
        assert browser.errors == []
        drone.close()
        text = "document.getElementById('link').textContent"
        browser.until(f"{text}.startsWith('nothing has come')")
    finally:
        browser.close()
        pages[0].close()
        station.close()
        drone.close()
