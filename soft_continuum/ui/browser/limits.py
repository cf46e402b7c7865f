# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Limits of what browsers may send: connections, messages and their rates, and lines of the log.

viser sets any property of an element that a message names and keeps every file it receives. So
messages from its page (its camera, values of controls, the handle of the tip) are decoded with a
strict schema and encoded again.
"""

import asyncio
from collections.abc import Awaitable, Callable
import logging
from time import monotonic
from typing import Annotated, get_args, Literal

import msgspec
from websockets.asyncio.server import ServerConnection

LINES, PERIOD = 20, 10.0  # in so many s
LOG = logging.getLogger('soft_continuum.ui.browser')
SERVER_LOG = logging.getLogger('soft_continuum.ui.browser.server')
"""For websockets, without its tracebacks about messages from browsers."""


class _RateLimit(logging.Filter):
    """Passes LINES in PERIOD and counts the others."""

    def __init__(self) -> None:
        super().__init__()
        self._start, self._count = monotonic(), 0

    def filter(self, record: logging.LogRecord) -> bool:
        if record.msg == 'opening handshake failed':  # a browser that changed its mind
            return False
        now = monotonic()
        if now - self._start >= PERIOD:
            dropped = self._count - LINES
            self._start, self._count = now, 0
            if dropped > 0:
                record.msg = f'{record.msg}  ({dropped} such lines omitted)'
        self._count += 1
        if record.exc_info and record.name == SERVER_LOG.name:
            record.msg = f'{record.msg}: {type(record.exc_info[1]).__name__}'
            record.exc_info = None
        return self._count <= LINES


for _log in (LOG, SERVER_LOG):
    _log.addFilter(_RateLimit())


MAX_REQUESTS = 48
"""Connections without a request yet, or being answered: a page opens six."""
MAX_SOCKETS = 64  # WebSockets: a page has two
RATE, BURST = 200.0, 400.0  # messages of one WebSocket: in a second, and at once


class ConnectionLimiter:
    """
    The connections of a server.

    If too many wait, the oldest is dropped: browsers send requests and read replies at once.
    """

    def __init__(self) -> None:
        """Start empty."""
        self._requests: dict[ServerConnection, None] = {}  # the oldest first
        self._sockets: set[ServerConnection] = set()

    def enter(self, connection: ServerConnection) -> None:
        """Count a new connection."""
        self._requests[connection] = None
        if len(self._requests) > MAX_REQUESTS:
            oldest = next(iter(self._requests))
            del self._requests[oldest]
            oldest.transport.abort()

    def has_room(self) -> bool:
        """Whether there may be another WebSocket."""
        return len(self._sockets) < MAX_SOCKETS

    def become_socket(self, connection: ServerConnection) -> None:
        """Count a connection as a WebSocket."""
        self._requests.pop(connection, None)
        self._sockets.add(connection)

    def leave(self, connection: ServerConnection) -> None:
        """Remove a closed connection."""
        self._requests.pop(connection, None)
        self._sockets.discard(connection)


class RateLimiter:
    """Delays a WebSocket that sends too fast, so that its data stays with the sender."""

    def __init__(self) -> None:
        """Allow BURST messages now."""
        self._allowed, self._then = BURST, monotonic()

    async def keep(self) -> None:
        """Wait until the received message may be processed."""
        now = monotonic()
        self._allowed = min(BURST, self._allowed + RATE * (now - self._then)) - 1.0
        self._then = now
        if self._allowed < 0.0:
            await asyncio.sleep(-self._allowed / RATE)


MAX_MESSAGE = 2**14  # bytes
MAX_TEXT = 1000  # characters
HandleName = Literal['/arm/tip_goal']
TIP_HANDLE: str = get_args(HandleName)[0]
"""The name of the handle that can be dragged."""
Vector = tuple[float, float, float]
Number = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]  # of a slider: s, or degrees
Text = Annotated[str, msgspec.Meta(max_length=MAX_TEXT)]


class _Message(msgspec.Struct, tag_field='type', forbid_unknown_fields=True):
    pass


class _Camera(_Message, tag='ViewerCameraMessage'):
    wxyz: tuple[float, float, float, float]
    position: Vector
    fov: float
    near: float
    far: float
    image_height: Annotated[int, msgspec.Meta(ge=0, le=2**16)]
    image_width: Annotated[int, msgspec.Meta(ge=0, le=2**16)]
    look_at: Vector
    up_direction: Vector


class _Value(msgspec.Struct, forbid_unknown_fields=True):
    value: bool | Number | Text


class _Update(_Message, tag='GuiUpdateMessage'):
    uuid: Annotated[str, msgspec.Meta(max_length=64)]
    updates: _Value


class _Handle(_Message, tag='TransformControlsUpdateMessage'):
    name: HandleName
    wxyz: tuple[Number, Number, Number, Number]
    position: tuple[Number, Number, Number]
    owner: Literal['']


class _HandleStart(_Message, tag='TransformControlsDragStartMessage'):
    name: HandleName
    owner: Literal['']


class _HandleEnd(_HandleStart, tag='TransformControlsDragEndMessage'):
    pass


_DECODER = msgspec.msgpack.Decoder(_Camera | _Update | _Handle | _HandleStart | _HandleEnd)


def only_controls(connection: ServerConnection) -> ServerConnection:
    """Drop and log all other messages of a connection."""
    setattr(connection, 'recv', _filtered(connection.recv))  # noqa: B010  (mypy: a method)
    return connection


def _filtered(receive: Callable[[], Awaitable[str | bytes]]) -> Callable[[], Awaitable[bytes]]:
    limiter = RateLimiter()

    async def receive_filtered() -> bytes:
        while True:
            raw = await receive()
            await limiter.keep()
            try:
                # Encoded as decoded: viser might use the other value of a duplicate key.
                return msgspec.msgpack.encode(_DECODER.decode(raw))  # type: ignore[arg-type]
            except (msgspec.MsgspecError, TypeError, ValueError, RecursionError) as error:
                LOG.warning('dropped a message that is not a value of a control: %.100r',
                            str(error))

    return receive_filtered
