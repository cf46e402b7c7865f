# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a browser may send, tried by one that sends what it likes; see also test_bar.py."""

import logging
import threading

import msgspec
import pytest
import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from soft_continuum.ui.browser.access import open_server
from soft_continuum.ui.browser.limits import MAX_TEXT, TIP_HANDLE

CAMERA = {'type': 'ViewerCameraMessage', 'wxyz': [1, 0, 0, 0], 'position': [0, 0, 1], 'fov': 1.0,
          'near': 0.1, 'far': 10.0, 'image_height': 100, 'image_width': 100,
          'look_at': [0.0, 0.0, 0.0], 'up_direction': [0.0, 0.0, 1.0]}


class Controls:
    """A served button and text, and a browser that speaks to them."""

    def __init__(self, server):
        self.server = server
        self.clicked = threading.Semaphore(0)
        self.button = server.gui.add_button('press')
        self.text = server.gui.add_text('text', 'before')
        self.button.on_click(lambda _: self.clicked.release())
        self.browser = self.connect()

    def connect(self):
        """Open a page's connection; viser counts it from its first camera on."""
        browser = connect(f'ws://127.0.0.1:{self.server.get_port()}', open_timeout=30,
                          subprotocols=[f'viser-v{viser.__version__}'])
        browser.send(msgspec.msgpack.encode(CAMERA))
        return browser

    def update(self, control, **updates):
        self.send({'type': 'GuiUpdateMessage', 'uuid': control._impl.uuid, 'updates': updates})

    def send(self, message):
        self.browser.send(msgspec.msgpack.encode(message))

    def assert_click_works(self):
        """All that was sent before was taken, too, when this click is."""
        self.update(self.button, value=True)
        assert self.clicked.acquire(timeout=30), 'a click has no effect'


@pytest.fixture(scope='module')
def controls():
    server = open_server('127.0.0.1', 0)
    controls = Controls(server)
    yield controls
    controls.browser.close()
    server.stop()


@pytest.mark.parametrize(('name', 'value'), [
    ('update_cb', []), ('removed', True), ('sync_cb', None), ('is_button', False),
    ('props', {}), ('uuid', 'x'), ('gui_api', 0), ('__class__', 0), ('no_such', 1),
])
def test_only_the_value_of_a_control_can_be_set(controls, name, value, caplog):
    for updates in ({name: value}, {'value': True, name: value}):
        controls.update(controls.button, **updates)
    controls.assert_click_works()
    assert not controls.button._impl.removed
    assert not controls.clicked.acquire(blocking=False), 'half of a message was taken'
    assert caplog.text.count('dropped a message') == 2


def test_a_text_is_taken_up_to_a_length_and_nothing_else_for_it(controls):
    controls.update(controls.text, value='after')
    for value in ('x' * (MAX_TEXT + 1), 1e300, float('nan'), None, ['a'], {'a': 1}, b'a', 2**63):
        controls.update(controls.text, value=value)
    controls.assert_click_works()
    assert controls.text.value == 'after'


def test_only_the_handle_of_the_tip_can_be_dragged_and_only_to_a_place(controls, caplog):
    handle, other = (controls.server.scene.add_transform_controls(name)
                     for name in (TIP_HANDLE, '/other'))
    turned = {'type': 'TransformControlsUpdateMessage', 'owner': '', 'wxyz': [1.0, 0.0, 0.0, 0.0]}
    controls.send({**turned, 'name': TIP_HANDLE, 'position': [0.1, 0.2, 0.3]})
    for change in ({'name': '/other'}, {'position': [float('nan'), 0.0, 0.0]},
                   {'position': [0.0, 1e300, 0.0]}, {'position': [0.0]}, {'owner': 'x'},
                   {'wxyz': [float('inf')] * 4}, {'scale': 1.0}):
        controls.send({**turned, 'name': TIP_HANDLE, 'position': [9.0] * 3, **change})
    controls.assert_click_works()
    assert tuple(handle.position) == (0.1, 0.2, 0.3) and not any(other.position)
    assert caplog.text.count('dropped a message') == 7


def test_no_upload_is_kept(controls):
    controls.send({'type': 'FileTransferStartUpload', 'transfer_uuid': 't', 'filename': 'f',
                   'source_component_uuid': controls.button._impl.uuid, 'mime_type': '',
                   'part_count': 10**6, 'size_bytes': 10**9})
    controls.send({'type': 'FileTransferPart', 'transfer_uuid': 't', 'part_index': 0,
                   'source_component_uuid': controls.button._impl.uuid, 'content': b'x' * 8000})
    controls.assert_click_works()
    assert not controls.server.gui._current_file_upload_states


def test_what_is_no_message_ends_no_connection_and_writes_no_traceback(controls, caplog):
    caplog.set_level(logging.DEBUG, 'soft_continuum.ui.browser')
    uuid = controls.text._impl.uuid.encode()
    # The same key twice: of which one reader takes the first, another the last.
    twice = (b'\x84\xa4type\xb0GuiUpdateMessage\xa4uuid\xd9' + bytes([len(uuid)]) + uuid
             + b'\xa7updates\x81\xa5value\xa1a\xa7updates\x81\xa7removed\xc3')
    for raw in ('text', '\x1b[31m', b'', b'\xc1', b'\x90', b'\x91' * 8000, b'\x81\xa1', twice,
                msgspec.msgpack.encode({'type': 'NoSuchMessage\x1b[31m\n' * 9}),
                msgspec.msgpack.encode({'type': ['GuiUpdateMessage']}),
                msgspec.msgpack.encode({**CAMERA, 'wxyz': [1, 0]}),
                msgspec.msgpack.encode({**CAMERA, 'fov': 'wide'}),
                msgspec.msgpack.encode({**CAMERA, 'excluded_self_client': 1}),
                msgspec.msgpack.encode({'type': 'ShareUrlRequest'}),
                msgspec.msgpack.encode({'type': 'GuiFormDirtyMessage', 'uuid': 'x' * 5000})):
        controls.browser.send(raw)
    controls.assert_click_works()
    assert not controls.text._impl.removed
    assert 'Traceback' not in caplog.text and '\x1b' not in caplog.text
    assert max(map(len, caplog.messages)) < 300


def test_a_message_that_is_too_long_costs_only_its_sender_the_connection(controls):
    other = controls.connect()
    other.send(b'x' * 10**6)
    with pytest.raises(ConnectionClosed):
        while True:
            other.recv(timeout=30)
    controls.assert_click_works()


def test_the_log_stays_short_whatever_is_sent(controls, caplog, monkeypatch):
    monkeypatch.setattr('soft_continuum.ui.browser.limits.LINES', 20)
    for _ in range(200):
        controls.browser.send(b'\xc1')
    controls.assert_click_works()
    assert len(caplog.messages) <= 40
