# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Access control of the view: viser serves it, and every request is checked first.

viser has no such hook, so what it hands to ``websockets.asyncio.server.serve`` is wrapped while it
starts.  If a later viser starts its server in another way, nothing is served at all.
"""

from collections.abc import Callable
from contextlib import redirect_stdout
from functools import partial
from hmac import compare_digest
from http import HTTPStatus
from io import StringIO
from ipaddress import ip_address
import socket
from typing import Any
from urllib.parse import parse_qs, urlsplit

import viser
from websockets.asyncio import server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

Handler = Callable[[ServerConnection, Request], Response | None]


class AccessError(ValueError):
    """The view cannot be served like this; the message says why, and what to do."""


class _Server(viser.ViserServer):
    """A server that cannot be published on the internet from the page."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: viser would open a tunnel through a public host."""
        return None

    def stop(self) -> None:
        """Stop, printing nothing."""
        with redirect_stdout(StringIO()):
            super().stop()


def open_server(host: str, port: int, token: str = '') -> viser.ViserServer:
    """
    Serve on ``host`` and ``port`` (0: any free one), with ``token`` only to browsers that show it.

    Raises AccessError for an address beyond loopback without a token, and for one that cannot be
    listened on.
    """
    if not token and not is_loopback(host):
        raise AccessError(
            f'--host {host} can be reached from other machines, and whoever reaches it can move '
            'the arm: give --token too, or leave --host out')
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        socket.create_server((host, port), family=family).close()
    except (OSError, OverflowError) as error:  # viser would try a thousand other ports
        reason = getattr(error, 'strerror', '') or error
        raise AccessError(f'cannot listen on {host} port {port}: {reason}; '
                        'choose others with --host and --port') from None
    checked = False
    serve = websocket_server.serve

    def checked_serve(*arguments: Any, process_request: Handler, **options: Any) -> Any:
        nonlocal checked
        checked = True
        return serve(*arguments, **options,
                     process_request=partial(_check, token, process_request))

    setattr(websocket_server, 'serve', checked_serve)  # noqa: B010  (mypy: not assignable)
    try:
        with redirect_stdout(StringIO()):  # its own banner; ours has the token
            server = _Server(host=host, port=port, label='soft_continuum', verbose=False)
    finally:
        setattr(websocket_server, 'serve', serve)  # noqa: B010
    if not checked:
        server.stop()
        raise AccessError(f'viser {viser.__version__} does not let its connections be checked; '
                        'install the version in requirements/python.txt')
    return server


def page_address(server: viser.ViserServer, token: str = '') -> str:
    """Return the address of the page, to be opened in a browser."""
    host = server.get_host()
    if host in ('0.0.0.0', '::'):
        host = socket.gethostname()
    host = f'[{host}]' if ':' in host else host
    return f'http://{host}:{server.get_port()}/' + (f'?token={token}' if token else '')


def is_loopback(host: str) -> bool:
    """Whether a name or an address is one that only this machine reaches."""
    try:
        found = socket.getaddrinfo(host or '0.0.0.0', None)
    except OSError:
        return False
    return all(ip_address(str(entry[4][0]).partition('%')[0]).is_loopback for entry in found)


def _check(token: str, handler: Handler, connection: ServerConnection,
           request: Request) -> Response | None:
    """Answer one request: refuse it, take its token, or leave it to ``handler``."""
    host = request.headers.get('Host', '')
    if token:
        cookie = f'soft_continuum_{host.rpartition(":")[2]}'  # a browser shares them among ports
        given = parse_qs(urlsplit(request.path).query).get('token', [''])[0]
        if given and compare_digest(given.encode(), token.encode()):
            redirect = connection.respond(HTTPStatus.SEE_OTHER, '')
            redirect.headers['Location'] = '/'
            redirect.headers['Set-Cookie'] = (
                f'{cookie}={token}; Path=/; HttpOnly; SameSite=Strict')
            return redirect
        # Not http.cookies: it drops all of them when it cannot parse that of another program.
        parts = request.headers.get('Cookie', '').split(';')
        pairs = (part.strip().partition('=') for part in parts)
        shown = {name: value for name, _, value in pairs}.get(cookie, '')
        if not compare_digest(shown.encode(), token.encode()):
            return connection.respond(
                HTTPStatus.UNAUTHORIZED,
                'This view of the arm needs its token: open the address that was printed when it '
                'was started, which ends in ?token=...\n')
    elif not _names_loopback(host):
        # A web page can give its own name the address of this machine (DNS rebinding).
        return connection.respond(
            HTTPStatus.FORBIDDEN, f'This view is for this machine only, not for {host}: open it '
            'at 127.0.0.1, or start it with --token\n')
    origin = request.headers.get('Origin')
    if origin is not None and urlsplit(origin).netloc != host:
        # Any web page may open a WebSocket to any address; this one moves an arm.
        return connection.respond(HTTPStatus.FORBIDDEN, f'not for pages of {origin}\n')
    response = handler(connection, request)
    if response is not None:
        response.headers['Content-Security-Policy'] = "frame-ancestors 'self'"
    return response


def _names_loopback(host: str) -> bool:
    """Whether a Host header names this machine, without asking a name server."""
    name = urlsplit(f'//{host}').hostname or ''
    try:
        return name == 'localhost' or ip_address(name).is_loopback
    except ValueError:
        return False
