# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Access control of the view: viser serves it, and every request is checked first.

viser has no hook for this, so the arguments it passes to ``websockets.asyncio.server.serve`` are
wrapped at its start.  If a later viser starts its server differently, nothing is served.
"""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import redirect_stdout
from functools import partial
from hmac import compare_digest
from http import HTTPStatus
from io import StringIO
from ipaddress import ip_address
from secrets import token_urlsafe
import socket
from typing import Any
from urllib.parse import parse_qs, urlsplit

import viser
from websockets.asyncio import server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response
from websockets.server import ServerProtocol

from soft_continuum.ui.browser.bar import Bar, PAGE, PATH
from soft_continuum.ui.browser.limits import (
    ConnectionLimiter,
    LOG,
    MAX_MESSAGE,
    MAX_SOCKETS,
    only_controls,
    SERVER_LOG,
)

WRONG_TOKEN_DELAY = 1.0  # s until the next token from the same address is checked
MAX_WAITING = 10  # waiting tokens from one address
Files = Callable[[ServerConnection, Request], Response | None]
Conversation = Callable[[ServerConnection], Awaitable[None]]


class AccessError(ValueError):
    """The view cannot be served; the message gives the reason and the remedy."""


class _Server(viser.ViserServer):
    """A server that cannot be exposed to the internet from the page."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: viser would open a tunnel through a public host."""
        return None

    def stop(self) -> None:
        """Stop, printing nothing."""
        with redirect_stdout(StringIO()):
            super().stop()


def open_server(host: str, port: int, token: str = '', bar: Bar | None = None
                ) -> viser.ViserServer:
    """
    Serve on ``host`` and ``port`` (0: any free one), with ``token`` only to browsers that show it.

    bar: that of the page.

    Raises AccessError for an address other than loopback without a token, and for one that cannot
    be bound.
    """
    if not token and not is_loopback(host):
        raise AccessError(
            f'--host {host} can be reached from other machines, whose users could move the arm: '
            'also give --token, or leave out --host')
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        socket.create_server((host, port), family=family).close()
    except (OSError, OverflowError) as error:  # viser would try a thousand other ports
        reason = getattr(error, 'strerror', '') or error
        raise AccessError(f'cannot listen on {host} port {port}: {reason}; '
                        'choose others with --host and --port') from None
    checked, limiter = False, ConnectionLimiter()
    serve = websocket_server.serve

    def checked_serve(viser_handler: Conversation, *arguments: Any, process_request: Files,
                      **options: Any) -> Any:
        nonlocal checked
        checked = True
        options |= {'max_size': MAX_MESSAGE, 'logger': SERVER_LOG,
                    'create_connection': partial(_Connection, limiter),
                    'process_request': _Requests(token, process_request, limiter)}
        return serve(partial(_converse, bar or Bar(), viser_handler), *arguments, **options)

    setattr(websocket_server, 'serve', checked_serve)  # noqa: B010  (mypy: not assignable)
    try:
        with redirect_stdout(StringIO()):  # its own banner; ours has the token
            server = _Server(host=host, port=port, label='soft_continuum', verbose=False)
    finally:
        setattr(websocket_server, 'serve', serve)  # noqa: B010
    if not checked:
        server.stop()
        raise AccessError(f'viser {viser.__version__} does not allow its connections to be '
                        'checked; install the version in requirements/lock.txt')
    return server


def page_address(server: viser.ViserServer, token: str = '') -> str:
    """Return the address of the page, to be opened in a browser."""
    host = server.get_host()
    if host in ('0.0.0.0', '::'):
        host = socket.gethostname()
    host = f'[{host}]' if ':' in host else host
    return f'http://{host}:{server.get_port()}/' + (f'?token={token}' if token else '')


def is_loopback(host: str) -> bool:
    """Whether a name or an address can be reached from this machine only."""
    try:
        found = socket.getaddrinfo(host or '0.0.0.0', None)
    except OSError:
        return False
    return all(ip_address(str(entry[4][0]).partition('%')[0]).is_loopback for entry in found)


async def _converse(bar: Bar, viser_handler: Conversation, connection: ServerConnection) -> None:
    """Serve one WebSocket: the bar of a page, or viser's page under it."""
    if connection.request is not None and connection.request.path == PATH:
        await bar.follow(connection)
    elif connection.subprotocol != f'viser-v{viser.__version__}':  # viser would print it
        await connection.close(1002, 'another version of viser; reload the page')
    else:
        await viser_handler(only_controls(connection))


class _Connection(ServerConnection):
    """A counted connection, which also answers data that is not an HTTP request."""

    def __init__(self, limiter: ConnectionLimiter, protocol: ServerProtocol, *arguments: Any,
                 **options: Any) -> None:
        super().__init__(protocol, *arguments, **options)
        self._limiter = limiter
        send_eof = protocol.send_eof

        def answer() -> None:
            if protocol.handshake_exc is not None:
                protocol.writes.append(b'HTTP/1.1 400 Bad Request\r\nConnection: close\r\n\r\n')
            send_eof()

        setattr(protocol, 'send_eof', answer)  # noqa: B010  (mypy: a method)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self._limiter.enter(self)

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._limiter.leave(self)


class _Requests:
    """Handles requests of browsers: refuses them, checks their token, or serves them."""

    def __init__(self, token: str, files: Files, limiter: ConnectionLimiter) -> None:
        """``files``: serves the files of viser and passes its WebSocket."""
        self._token, self._files, self._limiter = token, files, limiter
        # Unique to this run, whatever its token: it cannot be guessed, so it need not wait.
        self._key = token_urlsafe(32)
        # Tokens from one address wait for each other, so that guessing is slow.
        self._turns = [asyncio.Lock() for _ in range(64)]
        self._waiting: Counter[str] = Counter()  # tokens, by address

    async def __call__(self, connection: ServerConnection, request: Request) -> Response | None:
        try:
            return await self._answer(connection, request)
        except (LookupError, ValueError, OSError):  # such as two hosts, half an address
            return connection.respond(HTTPStatus.BAD_REQUEST, 'not a request of a browser\n')

    async def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        host = request.headers.get('Host', '')
        name = urlsplit(f'//{host}').hostname or ''
        if self._token:
            refusal = await self._check_token(connection, request, host)
            if refusal is not None:
                return refusal
        elif not _names_loopback(name):
            # A web page can resolve its own name to the address of this machine (DNS rebinding).
            return connection.respond(
                HTTPStatus.FORBIDDEN, 'This view is only available on this machine, not for '
                f'{host}: open it at 127.0.0.1, or start it with --token\n')
        origin = request.headers.get('Origin')
        if origin is not None and urlsplit(origin).netloc != host:
            # Any web page may open a WebSocket to any address, and this one moves an arm.
            return connection.respond(HTTPStatus.FORBIDDEN, f'not for pages of {origin}\n')
        response = self._files(connection, request)
        if response is None:  # a WebSocket
            if not self._limiter.has_room():
                return connection.respond(
                    HTTPStatus.SERVICE_UNAVAILABLE, f'{MAX_SOCKETS // 2} pages are open, which is '
                    'the maximum; close one\n')
            self._limiter.become_socket(connection)
            return None
        if request.path.partition('?')[0] == '/':
            response = connection.respond(HTTPStatus.OK, PAGE)
            del response.headers['Content-Type']
            response.headers['Content-Type'] = 'text/html; charset=utf-8'
        response.headers['Content-Security-Policy'] = "frame-ancestors 'self'"
        return response

    async def _check_token(self, connection: ServerConnection, request: Request, host: str
                           ) -> Response | None:
        """Return a refusal, or the response to a correct token; None: continue."""
        cookie = f'soft_continuum_{host.rpartition(":")[2]}'  # browsers share cookies among ports
        # Not http.cookies: it drops all of them when it cannot parse that of another program.
        parts = request.headers.get('Cookie', '').split(';')
        pairs = (part.strip().partition('=') for part in parts)
        kept = {name: value for name, _, value in pairs}.get(cookie, '')
        given = parse_qs(urlsplit(request.path).query).get('token', [''])[0]
        if not given and compare_digest(kept.encode(), self._key.encode()):
            return None
        if self._waiting[str(connection.remote_address[0])] >= MAX_WAITING:
            return connection.respond(
                HTTPStatus.TOO_MANY_REQUESTS, 'Too many wrong tokens came from your address; try '
                f'again after {MAX_WAITING * WRONG_TOKEN_DELAY:.0f} s\n')
        if not await self._is_right(given, connection):
            return connection.respond(
                HTTPStatus.UNAUTHORIZED,
                'This view of the arm needs its token: open the address printed at its start, '
                'which ends in ?token=...\n')
        redirect = connection.respond(HTTPStatus.SEE_OTHER, '')
        redirect.headers['Location'] = '/'
        redirect.headers['Set-Cookie'] = (
            f'{cookie}={self._key}; Path=/; HttpOnly; SameSite=Strict')
        return redirect

    async def _is_right(self, token: str, connection: ServerConnection) -> bool:
        if not token:
            return False
        address = str(connection.remote_address[0])
        self._waiting[address] += 1
        try:
            async with self._turns[hash(address) % len(self._turns)]:
                if compare_digest(token.encode(), self._token.encode()):
                    return True
                LOG.warning('wrong token from %s', address)
                await asyncio.sleep(WRONG_TOKEN_DELAY)
        finally:
            self._waiting[address] -= 1
            self._waiting += Counter()  # forgets who does not wait
        return False


def _names_loopback(name: str) -> bool:
    """Whether a host name is one of this machine, without a DNS query."""
    try:
        return name == 'localhost' or ip_address(name).is_loopback
    except ValueError:
        return False
