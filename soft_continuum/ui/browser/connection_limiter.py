# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Limits the number of connections and their message rates."""

import asyncio
from time import monotonic

from websockets.asyncio.server import ServerConnection

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
