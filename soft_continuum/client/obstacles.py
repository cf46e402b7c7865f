# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Access of clients to the obstacles that shape_sequencer plans with."""

from collections.abc import Callable, Coroutine, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from soft_continuum.client.errors import ClientError, NoAnswerError, RefusedError
from soft_continuum.client.requests import Requests
from soft_continuum.client.tasks import until
from soft_continuum.planning.obstacles import Obstacle, ObstacleError
from soft_continuum.planning.obstacles.files import load_obstacles, UNITS
from soft_continuum.ros.entries import LATCHED, OBSTACLES, subscribe_unguarded
from soft_continuum.ros.names import SHAPE_SEQUENCER
from soft_continuum.ros.obstacles import (
    Key,
    known_from_ros,
    MAX_KNOWN_BYTES,
    MAX_MARKER_BYTES,
    obstacle_to_ros,
    REFUSED,
    removal,
)
from soft_continuum.text import printable

T = TypeVar('T')


class ArmObstacles:
    """
    The obstacles around a running arm: ``arm.obstacles``.

    Every change waits until shape_sequencer has applied it.  A refused change raises RefusedError
    with the reason, and nothing changes.
    """

    def __init__(self, requests: Requests) -> None:
        """Send no request yet."""
        self._requests = requests
        self._known: Mapping[Key, Obstacle] | None = None
        self._publisher: Any = None
        self._frame = ''

    @property
    def known(self) -> tuple[Obstacle, ...]:
        """All obstacles that shape_sequencer plans with, from any client; in base_link, m."""
        return tuple(self._do(self._follow()).values())

    def add(self, *obstacles: Obstacle, replace: bool = False) -> None:
        """Add obstacles, replacing those with the same names; replace: also remove all others."""
        self._do(self._add(obstacles, replace))

    def load(self, path: str | Path, *, replace: bool = False) -> tuple[Obstacle, ...]:
        """
        Add the obstacles of a YAML file like ``add``; return them.

        Raises ClientError for an invalid file, or a mesh too large for a message.
        """
        try:
            obstacles = load_obstacles(path)
        except ObstacleError as error:
            raise ClientError(error) from None
        self.add(*obstacles, replace=replace)
        return obstacles

    def remove(self, *names: str) -> None:
        """Remove obstacles by name; raises ClientError for an unknown one."""
        self._do(self._remove(names))

    def clear(self) -> None:
        """Remove all obstacles, including those of the file that shape_sequencer has read."""
        self._do(self._change([Marker(action=Marker.DELETEALL)], lambda known: not known))

    def _do(self, work: Coroutine[Any, None, T]) -> T:
        return self._requests.start(work).result()

    async def _add(self, obstacles: tuple[Obstacle, ...], replace: bool) -> None:
        await self._follow()
        stamp = self._requests.node.get_clock().now().to_msg()
        markers = [marker for one in obstacles
                   for marker in obstacle_to_ros((one.name, 0), one, self._frame, stamp)]
        # In returned form: the vertices of a mesh are in another order.
        wanted = known_from_ros(MarkerArray(markers=markers))

        def done(known: Mapping[Key, Obstacle]) -> bool:
            return all(known.get(key) == one for key, one in wanted.items()) and (
                not replace or len(known) == len(wanted))

        clear = [Marker(action=Marker.DELETEALL)] if replace else []
        await self._change([*clear, *markers], done)

    async def _remove(self, names: tuple[str, ...]) -> None:
        keys = {one.name: key for key, one in (await self._follow()).items()}
        if missing := [name for name in names if name not in keys]:
            raise ClientError(f'there is no obstacle {", ".join(missing)}; known: '
                              f'{", ".join(keys) or "none"}')
        gone = [keys[name] for name in names]
        await self._change([marker for key in gone for marker in removal(key)],
                           lambda known: not any(key in known for key in gone))

    async def _change(self, markers: list[Marker], done: Callable[[Mapping[Key, Obstacle]], bool]
                      ) -> None:
        """Publish markers and wait for the result; raises RefusedError and NoAnswerError."""
        await self._follow()
        requests, refused = self._requests, self._refused
        message = MarkerArray(markers=markers)
        if (size := len(serialize_message(message))) > MAX_MARKER_BYTES:
            raise ClientError(f'the obstacles are a message of {size} bytes; allowed: '
                              f'{MAX_MARKER_BYTES}. Simplify their meshes, or pass the file to '
                              f'{SHAPE_SEQUENCER}, as its parameter obstacles.file')
        await requests.found(self._is_heard, 'a subscriber of obstacles', SHAPE_SEQUENCER)
        before = refused()
        self._publisher.publish(message)
        await until(lambda: done(self._known or {}) or refused() != before, requests.timeout)
        if done(self._known or {}):
            return
        if refused() != before:
            raise RefusedError(f'{SHAPE_SEQUENCER}: {refused().partition(": ")[2]}')
        raise NoAnswerError(f'{SHAPE_SEQUENCER} does not plan with these obstacles within '
                            f'{requests.timeout:g} s')

    async def _follow(self) -> Mapping[Key, Obstacle]:
        """Return the obstacles; the first call waits for them."""
        requests = self._requests
        if self._publisher is None:
            requests.observed  # noqa: B018  (this subscribes to its status)
            node = requests.node
            self._publisher = node.create_publisher(MarkerArray, 'obstacles', OBSTACLES)
            subscribe_unguarded(node, MarkerArray, 'known_obstacles', self._on_known, LATCHED,
                                MAX_KNOWN_BYTES)
        if not self._frame:
            values = await requests.parameters(SHAPE_SEQUENCER, ['frame_id'])
            self._frame = str(values.get('frame_id', 'base_link'))
        # Also its status, which has the previous refusal.
        await requests.found(lambda: self._known is not None and self._status is not None,
                             'known_obstacles', SHAPE_SEQUENCER)
        assert self._known is not None
        return self._known

    def _on_known(self, message: MarkerArray) -> None:
        self._known = known_from_ros(message)
        self._requests.step()

    def _is_heard(self) -> bool:
        """Whether the node, and any other subscriber, will receive the message."""
        node = self._requests.node
        listeners = [one.node_name for one in node.get_subscriptions_info_by_topic(
            node.resolve_topic_name('obstacles'))]
        return (SHAPE_SEQUENCER in listeners
                and self._publisher.get_subscription_count() >= len(listeners))

    @property
    def _status(self) -> Any:
        return self._requests.observed.message(f'{SHAPE_SEQUENCER}/status')

    def _refused(self) -> str:
        """Return the node's last refusal of a message, with its number."""
        status = self._status
        return next((printable(pair.value) for pair in (status.values if status else ())
                     if pair.key == REFUSED), '')


def obstacles_text(obstacles: Sequence[Obstacle], unit: str) -> str:
    """Return a printable list of obstacles; unit: of its lengths, m or mm."""
    if not obstacles:
        return 'no obstacles'
    scale = 1.0 / UNITS[unit]
    rows = [f'{"name":<20}{"shape":<10}{"size in its own frame":>27}{"position":>30}  {unit}']
    for one in obstacles:
        numbers = [f'{scale * value:9.4g}' for value in (*one.size, *one.position)]
        rows.append(f'{one.name:<20}{one.shape.kind:<10}{"".join(numbers[:3])}   '
                    f'{"".join(numbers[3:])}')
    return '\n'.join(rows)
