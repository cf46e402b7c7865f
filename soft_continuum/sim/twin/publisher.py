# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A publisher of the twin, on a separate node."""

from abc import abstractmethod
from typing import Self

from soft_continuum.client.connection import Connection

DISC_POSES = 'twin/disc_poses'


class Publisher:
    """Publishes while this context manager is open."""

    def __init__(self, name: str, namespace: str) -> None:
        """Make a node; raises ClientError for a namespace that ROS does not take."""
        self._connection = Connection(name, namespace)
        self._node = self._connection.node

    def __enter__(self) -> Self:
        """Begin to publish."""
        self._connection.requests.start(self._begin()).result()
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._connection.close()

    @abstractmethod
    async def _begin(self) -> None:
        """Create publishers and timers, on the thread that spins the node."""
