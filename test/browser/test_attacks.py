# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The view under attack, over real sockets: who may not get in, and that STOP works meanwhile."""

from contextlib import ExitStack, suppress
from http.client import HTTPConnection
import json
import logging
import os
import socket
import struct
import threading

import pytest
import viser
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from soft_continuum.ui.browser import access, limits
from soft_continuum.ui.browser.access import open_server
from soft_continuum.ui.browser.bar import Bar, PATH
from soft_continuum.ui.browser.limits import MAX_REQUESTS

TOKEN = 'a-token-of-this-test'
PROTOCOL = f'viser-v{viser.__version__}'
TIMEOUT = 30.0  # s


class View:
    """A served view with a token, and a page of it that can stop."""

    def __init__(self, port=0):
        self.stopped, self.resumed = threading.Semaphore(0), threading.Semaphore(0)
        bar = Bar()
        bar.commands = {'stop': self.stopped.release, 'resume': self.resumed.release}
        self.server = open_server('127.0.0.1', port, TOKEN, bar)
        self.port = self.server.get_port()
        shown = self.get(f'/?token={TOKEN}')
        self.cookie = shown.headers['Set-Cookie'].partition(';')[0]
        self.bar = self.open_bar()
        self.state = ''  # as the page has it
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self):
        """Take what the bar is sent, as a page does: who takes nothing is disconnected."""
        with suppress(ConnectionClosed):
            while True:
                self.state = json.loads(self.bar.recv())['kind']

    def get(self, path='/', **headers):
        connection = HTTPConnection('127.0.0.1', self.port, timeout=TIMEOUT)
        connection.request('GET', path, headers=headers)
        response = connection.getresponse()
        response.read()
        connection.close()
        return response

    def open_bar(self):
        return connect(f'ws://127.0.0.1:{self.port}{PATH}', open_timeout=TIMEOUT,
                       additional_headers={'Cookie': self.cookie})

    def open_page(self):
        return connect(f'ws://127.0.0.1:{self.port}', open_timeout=TIMEOUT,
                       subprotocols=[PROTOCOL],
                       additional_headers={'Cookie': self.cookie})

    def attacker(self, data=b''):
        """Return a connection that has sent something, and reads nothing."""
        sender = socket.create_connection(('127.0.0.1', self.port), TIMEOUT)
        sender.sendall(data)
        return sender

    def request(self, path='/', *lines):
        """Return a request as a browser sends it."""
        return '\r\n'.join([f'GET {path} HTTP/1.1', f'Host: 127.0.0.1:{self.port}', *lines,
                            '', '']).encode()

    def handshake(self, path='/', cookie=''):
        """Return what opens a WebSocket."""
        return self.request(
            path, 'Upgrade: websocket', 'Connection: Upgrade', 'Sec-WebSocket-Version: 13',
            'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==', f'Cookie: {cookie}',
            f'Sec-WebSocket-Protocol: {PROTOCOL}')

    def assert_stops(self):
        """Claim that the page that is open can stop, and that another one opens."""
        self.bar.send('stop')
        assert self.stopped.acquire(timeout=TIMEOUT), 'STOP has no effect'
        assert self.get(Cookie=self.cookie).status == 200

    def close(self):
        self.bar.close()
        self.server.stop()


@pytest.fixture(scope='module')
def view():
    view = View()
    yield view
    view.close()


def status_of(answer):
    return int(answer.split(b' ', 2)[1])


def test_what_an_earlier_run_gave_is_worth_nothing_even_with_its_token():
    first = View()
    captured = first.handshake(PATH, first.cookie)
    with first.attacker(captured) as same:  # who can read the network is in: there is no secret
        assert status_of(same.recv(9999)) == 101
    assert TOKEN not in first.cookie
    first.close()
    later = View(first.port)  # the same address, the same token
    try:
        assert later.cookie != first.cookie
        assert later.get(Cookie=first.cookie).status == 401
        with later.attacker(captured) as replayed:
            assert status_of(replayed.recv(9999)) == 401
        later.assert_stops()
    finally:
        later.close()


@pytest.mark.parametrize('host', ['example.org:8080', 'example.org', '127.0.0.1.example.org'])
def test_a_name_that_leads_to_this_machine_has_no_cookie_of_it(view, host):
    # A page of that site sends its own name as Host and Origin, and cookies of that name only.
    for path in ('/', PATH):
        assert view.get(path, Host=host, Origin=f'http://{host}').status == 401
    assert view.get(Cookie=view.cookie, Origin=f'http://{host}').status == 403


def test_wrong_tokens_keep_nobody_out_who_is_in_and_few_of_them_wait(view, monkeypatch):
    monkeypatch.setattr(access, 'WRONG_TOKEN_DELAY', 2.0)
    with ExitStack() as opened:
        guesses = [opened.enter_context(view.attacker(view.request(f'/?token=guess{n}')))
                   for n in range(40)]
        refused = [guess for guess in guesses[access.MAX_WAITING:]
                   if status_of(guess.recv(9999)) == 429]
        assert len(refused) >= 20
        view.assert_stops()
        with view.open_page() as page:
            assert page.recv(timeout=TIMEOUT)
        monkeypatch.setattr(access, 'WRONG_TOKEN_DELAY', 0.0)
        assert status_of(guesses[0].recv(9999)) == 401
    while view.get('/?token=guess').status != 401:  # behind all others
        pass


@pytest.mark.parametrize('data', [b'', b'GET / HT', b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: '])
def test_connections_that_never_finish_their_request_are_dropped_for_new_ones(view, data):
    with ExitStack() as opened:
        slow = [opened.enter_context(view.attacker(data)) for _ in range(100)]
        view.assert_stops()
        dropped = 0
        for one in slow[:100 - MAX_REQUESTS]:  # the oldest
            one.settimeout(TIMEOUT)
            try:
                dropped += one.recv(1) == b''
            except ConnectionResetError:
                dropped += 1
        assert dropped == 100 - MAX_REQUESTS


def test_who_asks_for_files_and_does_not_take_them_takes_no_memory_for_ever(view):
    with ExitStack() as opened:
        before = resident()
        for _ in range(200):
            one = opened.enter_context(view.attacker())
            one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
            one.sendall(view.request('/index.html', f'Cookie: {view.cookie}'))
        view.assert_stops()
        assert resident() - before < 100e6  # 200 times the page would be 160 MB


def resident():
    """Return the memory of this process, bytes."""
    with open('/proc/self/statm', encoding='ascii') as statm:
        return float(statm.read().split()[1]) * os.sysconf('SC_PAGE_SIZE')


def test_a_hundred_pages_are_more_than_are_served_and_those_that_are_open_stop(view):
    with ExitStack() as opened:
        with pytest.raises(InvalidStatus) as refusal:
            for _ in range(100):
                opened.enter_context(view.open_bar())
        assert refusal.value.response.status_code == 503
        view.assert_stops()
    with view.open_page() as page:  # once they are closed
        assert page.recv(timeout=TIMEOUT)


def test_a_page_that_sends_without_end_holds_up_only_itself(view, monkeypatch):
    monkeypatch.setattr(limits, 'RATE', 1.0)
    monkeypatch.setattr(limits, 'BURST', 20.0)
    with view.attacker(view.handshake(PATH, view.cookie)) as flood:
        flood.sendall(5000 * frame(1, b'stop'))
        for _ in range(20):
            assert view.stopped.acquire(timeout=TIMEOUT)
        with view.open_bar() as other:
            other.send('resume')
            assert view.resumed.acquire(timeout=TIMEOUT)
    taken = 20
    while view.stopped.acquire(blocking=False):
        taken += 1
    assert taken < 500, 'the rest waits with who sent it'


def frame(opcode, data=b'', *, fin=0x80, mask=0x80):
    """Return a frame of a WebSocket, masked with zeros."""
    length = (bytes([mask | len(data)]) if len(data) < 126 else
              bytes([mask | 126]) + struct.pack('>H', len(data)))
    return bytes([fin | opcode]) + length + (bytes(4) if mask else b'') + data


@pytest.mark.parametrize('path', ['/', PATH])
@pytest.mark.parametrize('data', [
    frame(1, b'stop', mask=0),                               # a client has to mask
    frame(3, b'x'), frame(0xb, b'x'),                        # no such kind of frame
    frame(1, b'stop', fin=0xc0), frame(1, b'stop', fin=0xf0),  # extensions that nobody agreed on
    frame(9, b'x' * 126), frame(9, b'', fin=0),              # no ping
    frame(0, b'x'),                                          # goes on with nothing
    frame(1, b'a', fin=0) + frame(1, b'b'),                  # begins twice
    frame(1, b'\xff\xfe'),                                   # no text
    frame(8, b'x'), frame(8, struct.pack('>H', 5)),          # no reason to close
    bytes([0x82, 0xff]) + struct.pack('>Q', 2**63) + bytes(4),
    bytes([0x82, 0xff]) + struct.pack('>Q', 2**62) + bytes(4),
    bytes([0x82, 0xfe]) + struct.pack('>H', 0xffff) + bytes(4),
    frame(2, b'x' * 9000, fin=0) + 2 * frame(0, b'x' * 9000, fin=0),  # too long in parts
    os.urandom(2000),
], ids=range(17))
def test_what_is_no_frame_costs_only_its_sender_the_connection(view, path, data, caplog, capfd):
    caplog.set_level(logging.DEBUG, 'soft_continuum.ui.browser')
    with view.attacker(view.handshake(path, view.cookie)) as attacker:
        assert status_of(attacker.recv(12, socket.MSG_WAITALL)) == 101
        attacker.sendall(data)
        attacker.settimeout(TIMEOUT)
        if data[0] & 0x0f != 9 or len(data) > 100:  # else it waits for the rest
            try:
                while attacker.recv(65536):
                    pass
            except ConnectionResetError:
                pass
    view.assert_stops()
    assert 'Traceback' not in caplog.text + ''.join(capfd.readouterr())


def test_the_page_that_was_open_all_the_time_still_knows_the_state(view):
    assert view.state == 'lost'  # no arm is shown here
    view.assert_stops()
