# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Messages from viser's page: its camera, values of controls, and the handle of the tip.

viser sets any property of an element that a message names and keeps every file it receives. So
messages are decoded here with a strict schema and encoded again.
"""

from collections.abc import Awaitable, Callable
from typing import Annotated, get_args, Literal

import msgspec
from websockets.asyncio.server import ServerConnection

from soft_continuum.ui.browser.connection_limiter import RateLimiter
from soft_continuum.ui.browser.log import LOG

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
