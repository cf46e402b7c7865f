# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How many connections there may be at once, and how fast each may speak."""

import asyncio
from time import monotonic

from websockets.asyncio.server import ServerConnection

MAX_REQUESTS = 48
"""Connections that have asked for nothing yet, or are being answered: a page opens six."""
MAX_SOCKETS = 64  # WebSockets: a page has two
RATE, BURST = 200.0, 400.0  # messages of one WebSocket: in a second, and at once


class ConnectionLimiter:
    """
    The connections of a server.

    Where too many wait, the oldest is dropped: a browser asks, and takes its answer, at once.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self._requests: dict[ServerConnection, None] = {}  # the oldest first
        self._sockets: set[ServerConnection] = set()

    def enter(self, connection: ServerConnection) -> None:
        """Count one that was just opened."""
        self._requests[connection] = None
        if len(self._requests) > MAX_REQUESTS:
            oldest = next(iter(self._requests))
            del self._requests[oldest]
            oldest.transport.abort()

    def has_room(self) -> bool:
        """Whether there may be another WebSocket."""
        return len(self._sockets) < MAX_SOCKETS

    def become_socket(self, connection: ServerConnection) -> None:
        """Count one as a WebSocket from now on."""
        self._requests.pop(connection, None)
        self._sockets.add(connection)

    def leave(self, connection: ServerConnection) -> None:
        """Count one that is closed no longer."""
        self._requests.pop(connection, None)
        self._sockets.discard(connection)


class RateLimiter:
    """Has a WebSocket that sends too fast wait: what it sends then stays with who sends it."""

    def __init__(self) -> None:
        """Allow BURST messages now."""
        self._allowed, self._then = BURST, monotonic()

    async def keep(self) -> None:
        """Wait until the message that was received may be looked at."""
        now = monotonic()
        self._allowed = min(BURST, self._allowed + RATE * (now - self._then)) - 1.0
        self._then = now
        if self._allowed < 0.0:
            await asyncio.sleep(-self._allowed / RATE)
