"""The Foxglove WebSocket with a real client: that of a browser."""

import time

import pytest

pytest.importorskip('aiohttp', reason='aiohttp is not installed: the WebSocket is not tested')
pytest.importorskip('rosbags', reason='rosbags is not installed: the WebSocket is not tested')

from chromium import Chromium
from skins import skin

from ftp_dent_ros.coding.cloud_codec import encode
from ftp_dent_ros.coding.messages import cloud_from_message
from ftp_dent_ros.errors import CodecError
from ftp_dent_ros.ground.page.server import PageServer, encode_message
from ftp_dent_ros.ground.protocol import Importance, Item
from ftp_dent_ros.recording.topic import typestore

TEXT = 'std_msgs/msg/String'
# Subscribes to what is advertised and keeps what comes.
CLIENT = """
  window.topics = {}; window.came = [];
  const socket = new WebSocket(URL_HERE, ['foxglove.sdk.v1']);
  socket.binaryType = 'arraybuffer';
  socket.onmessage = ({data}) => {
    if (typeof data !== 'string') { came.push(new Uint8Array(data).length); return; }
    const message = JSON.parse(data);
    for (const channel of message.channels || []) {
      topics[channel.topic] = [channel.schemaName, channel.encoding];
      const subscriptions = [{id: channel.id, channelId: channel.id}];
      socket.send(JSON.stringify({op: 'subscribe', subscriptions}));
    }
  };
"""


def text_item(text):
    data = bytes(typestore().serialize_cdr(typestore().types[TEXT](data=text), TEXT))
    return Item(Importance.STATE, 'hello', f'cdr:{TEXT}', 5, data)


def test_a_browser_gets_messages_with_their_types(tmp_path, view):
    browser = Chromium(tmp_path)
    server = PageServer('127.0.0.1:0', None)
    try:
        cloud = Item(Importance.CLOUDS, 'points', 'cloud', 7, encode(skin(view), view))
        items = [text_item('x' * 90), cloud]
        for item in items:
            server.take(item)
        browser.value(CLIENT.replace('URL_HERE', f"'{server.foxglove_url}'"))
        browser.until('Object.keys(topics).length === 2')
        assert browser.value('topics') == {
            '/hello': [TEXT, 'cdr'],
            '/points': ['sensor_msgs/msg/PointCloud2', 'cdr'],
        }

        # What is taken before the server has heard of a subscription is sent to nobody.
        came = 'came.some((size) => size > 1e6) && came.some((size) => size < 200)'
        end = time.monotonic() + 120.0
        while not browser.value(came):
            assert time.monotonic() < end
            for item in items:
                server.take(item)
            time.sleep(0.05)
        kind, data = encode_message(cloud)
        back = cloud_from_message(typestore().deserialize_cdr(data, kind))
        assert back.intensity.shape == view.shape
    finally:
        server.close()
        browser.close()


@pytest.mark.parametrize('kind', ['cdr:no/msg/Type', 'cdr:std_msgs/msg/String', 'cloud', 'other'])
def test_what_is_none_is_refused(kind):
    with pytest.raises(CodecError):
        encode_message(Item(Importance.STATE, 'x', kind, 1, b'nothing'))
