# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Who may open the view, over real connections."""

from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPConnection
import socket
import sys
import time

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from soft_continuum.ui.browser.access import AccessError, open_server, page_address
from soft_continuum.ui.browser.main import browser, ui

TOKEN = 'a-token-of-this-test'
PROTOCOL = f'viser-v{viser.__version__}'


@pytest.fixture
def make_server():
    servers = []

    def make(token='', host='127.0.0.1'):
        servers.append(open_server(host, 0, token))
        return servers[-1]

    yield make
    for server in servers:
        server.stop()


def get(server, path='/', **headers):
    connection = HTTPConnection('127.0.0.1', server.get_port(), timeout=30)
    connection.request('GET', path, headers=headers)
    response = connection.getresponse()
    response.text = response.read().decode(errors='replace')
    connection.close()
    return response


def websocket(server, **headers):
    return connect(f'ws://127.0.0.1:{server.get_port()}', subprotocols=[PROTOCOL],
                   additional_headers=headers, open_timeout=30)


def assert_refused(server, status, **headers):
    with pytest.raises(InvalidStatus) as refusal:
        websocket(server, **headers)
    assert refusal.value.response.status_code == status


def test_on_loopback_the_page_and_its_connection_are_open_to_no_other_site(make_server):
    server = make_server()
    page = get(server)
    assert page.status == 200
    assert "frame-ancestors 'self'" in page.headers['Content-Security-Policy']
    with websocket(server, Origin=f'http://127.0.0.1:{server.get_port()}') as connection:
        assert connection.recv(timeout=30)
    for other in ('https://example.org', 'http://127.0.0.1:1', 'null'):
        assert_refused(server, 403, Origin=other)
    page = get(server, Host='example.org:8080')  # a site that takes the address of this machine
    assert page.status == 403
    assert '127.0.0.1' in page.text
    assert server.request_share_url() is None  # no browser can put the arm on the internet


def test_with_a_token_nothing_is_served_without_it(make_server):
    server = make_server(TOKEN)
    for path in ('/', '/?token=another-token', '/?token=', '/index.html'):
        page = get(server, path)
        assert page.status == 401
        assert 'token' in page.text
    assert_refused(server, 401)
    assert_refused(server, 401, Cookie=f'soft_continuum_{server.get_port()}=another-token')


def test_who_shows_the_token_is_let_in_from_then_on(make_server):
    server = make_server(TOKEN, host='0.0.0.0')
    assert page_address(server, TOKEN).endswith(f':{server.get_port()}/?token={TOKEN}')
    first = get(server, f'/?token={TOKEN}')
    assert first.status == 303
    assert first.headers['Location'] == '/'  # the token does not stay in the address bar
    cookie = first.headers['Set-Cookie']
    assert 'HttpOnly' in cookie and 'SameSite=Strict' in cookie
    shown = cookie.partition(';')[0]
    assert get(server, Cookie=shown).status == 200
    with websocket(server, Cookie=shown) as connection:
        assert connection.recv(timeout=30)
    assert_refused(server, 403, Cookie=shown, Origin='https://example.org')


def test_wrong_tokens_are_logged_and_wait_for_each_other(make_server, caplog, monkeypatch):
    monkeypatch.setattr('soft_continuum.ui.browser.access.WRONG_TOKEN_DELAY', 0.2)
    server, start = make_server(TOKEN), time.monotonic()
    with ThreadPoolExecutor(8) as guessers:
        statuses = list(guessers.map(lambda n: get(server, f'/?token=guess{n}').status, range(5)))
        # A cookie is no token: it is too long to be guessed, and needs no delay.
        kept = f'soft_continuum_{server.get_port()}'
        statuses += guessers.map(
            lambda value: get(server, Cookie=f'{kept}={value}').status, ('guess', TOKEN, ''))
    assert statuses == [401] * 8
    assert time.monotonic() - start > 5 * 0.2
    assert caplog.text.count('wrong token from 127.0.0.1') == 5
    assert 'guess' not in caplog.text
    assert get(server, f'/?token={TOKEN}').status == 303


@pytest.mark.parametrize('lines', [
    b'GET / HTTP/1.1\r\nHost: [::1\r\n',
    b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: 127.0.0.1\r\n',
    b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://[\r\n',
    b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: a\r\nOrigin: b\r\n',
    b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: a\r\nUpgrade: b\r\n',
    b'GET /' + 4000 * b'x' + b' HTTP/1.1\r\nHost: 127.0.0.1\r\n',
    b'GET /?token=\xff HTTP/1.1\r\nHost: 127.0.0.2.x\r\n',
    b'GET / HTTP/1.1\r\nHost: \xff\r\n',
    b'GET / HTTP/1.1\r\nHost: x\r\nCookie: soft_continuum_x=\xff\r\n',
    b'GET / HTTP/1.1\r\nHost 127.0.0.1\r\n',
    b'GET /\r\n',
    b'POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n',
])
def test_what_is_no_request_of_a_browser_is_refused_without_a_traceback(
        make_server, lines, caplog, capfd, monkeypatch):
    monkeypatch.setattr('soft_continuum.ui.browser.access.WRONG_TOKEN_DELAY', 0.0)
    for token in ('', TOKEN):
        with socket.create_connection(('127.0.0.1', make_server(token).get_port()), 30) as sender:
            sender.sendall(lines + b'\r\n')
            status = sender.recv(9999).split(b' ', 2)[1]
        assert b'400' <= status < b'500', (token, status)
    assert 'Traceback' not in caplog.text + ''.join(capfd.readouterr())


@pytest.mark.parametrize(('host', 'port', 'token', 'reason'), [
    ('0.0.0.0', 0, '', '--token'), ('::', 0, '', '--token'), ('', 0, '', '--token'),
    ('no.such.host.invalid', 0, '', '--token'),
    ('no.such.host.invalid', 0, TOKEN, 'cannot listen on'),
    ('127.0.0.1', 99999, '', 'cannot listen on'), ('127.0.0.1', 99999, TOKEN, 'cannot listen on')])
def test_an_address_that_is_not_to_be_had_without_a_token_or_at_all_is_named(
        host, port, token, reason):
    with pytest.raises(AccessError, match=reason):
        open_server(host, port, token)


def test_a_port_that_is_taken_is_named():
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(AccessError, match=f'port {port}.*--port'):
            open_server('127.0.0.1', port)


def test_a_server_that_cannot_be_guarded_is_not_started(monkeypatch):
    # As if a later viser started its server in another way than the one that is guarded.
    from websockets.asyncio import server as real

    class Other:
        serve = staticmethod(real.serve)

    monkeypatch.setattr('soft_continuum.ui.browser.access.websocket_server', Other)
    with pytest.raises(AccessError, match='requirements'):
        open_server('127.0.0.1', 0)


@pytest.mark.parametrize(('arguments', 'reason'), [
    (('--host', '0.0.0.0'), '--token'),
    (('--token', 'short'), '12 or more'),
    (('--port', 'x'), '--port'),
    (('--tendon-driver', 'gbrl'), 'gbrl'),
])
def test_bad_arguments_are_named(arguments, reason, monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', ['soft_continuum', '--port', '0', *arguments])
    with pytest.raises(SystemExit) as end:
        sys.exit(ui())
    assert end.value.code == 2
    assert reason in capsys.readouterr().err


@pytest.mark.parametrize(('arguments', 'reason'), [
    (('--nonsense',), "unknown argument '--nonsense'"),
    (('--ros-args', '-r', 'bad'), 'ROS rejects these arguments: --ros-args -r bad'),
    (('--ros-args', '--params-file', '/nowhere.yaml'), '/nowhere.yaml: cannot be read')])
def test_the_view_alone_takes_arguments_of_ros_and_names_others(
        arguments, reason, monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', ['soft_continuum', '--port', '0', *arguments])
    assert browser() == 2
    assert reason in capsys.readouterr().err
