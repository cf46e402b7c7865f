# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Conversion of obstacles to and from markers.

A marker is identified by namespace and number; the obstacle is named after both, or after the
namespace alone if the number is 0.  ROS has no marker for a capsule: it is a CYLINDER with the
text CAPSULE, and two SPHEREs with the text END, which are only for display.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from urllib.parse import unquote, urlparse

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
import numpy as np
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from soft_continuum.colours import OBSTACLE, OBSTACLE_OPACITY
from soft_continuum.mechanics.arm import Array
from soft_continuum.planning.obstacles import (
    Box,
    Capsule,
    Cylinder,
    Mesh,
    Obstacle,
    ObstacleError,
    Sphere,
)
from soft_continuum.planning.obstacles.files import load_mesh, MAX_OBSTACLES
from soft_continuum.planning.obstacles.mesh import mesh_of_triangles
from soft_continuum.planning.obstacles.obstacle import Shape, UPRIGHT
from soft_continuum.planning.obstacles.shapes import check_size
from soft_continuum.ros.conversions import pose_from_ros
from soft_continuum.text import MAX_NAME, printable

Key = tuple[str, int]
"""Namespace and number of a marker."""
REFUSED = 'obstacles refused'
"""Key in ~/status: number of refused messages, and the last reason."""
CAPSULE, END = 'capsule', 'end of a capsule'
MAX_MARKER_BYTES = 500_000
"""Largest message with obstacles, some 6,900 triangles: converting it takes 0.1 s."""
MAX_KNOWN = 1 + 3 * MAX_OBSTACLES  # markers
MAX_KNOWN_BYTES = 1_000_000
"""Largest size of all known obstacles in one message, bytes."""
KINDS = {Marker.SPHERE: 'SPHERE', Marker.CUBE: 'CUBE', Marker.CYLINDER: 'CYLINDER',
         Marker.TRIANGLE_LIST: 'TRIANGLE_LIST', Marker.MESH_RESOURCE: 'MESH_RESOURCE'}


def name_of(key: Key) -> str:
    """Return the name of the obstacle of a marker."""
    namespace, number = key
    return (namespace or 'obstacle') + (f'/{number}' if number else '')


def is_decoration(marker: Marker) -> bool:
    """Whether a marker is only for display, beside that of the obstacle."""
    return bool(marker.type == Marker.SPHERE and marker.text == END)


def obstacle_from_ros(marker: Marker, frame: str) -> Obstacle:
    """
    Return the obstacle that a marker adds.

    frame: required frame.  A SPHERE or CYLINDER with unequal scales counts as the round one around
    it.  Raises ObstacleError for an invalid marker.
    """
    if marker.header.frame_id != frame:
        raise ObstacleError(f'frame_id is {printable(repr(marker.header.frame_id), MAX_NAME)}; '
                            f'allowed: {frame!r}. Transform it, for instance with tf2')
    if marker.type not in KINDS:
        raise ObstacleError(f'type is {marker.type}; allowed: ' + ', '.join(
            f'{number} ({kind})' for number, kind in KINDS.items()))
    pose = pose_from_ros(marker.pose)
    x, y, z, *turn = pose
    a, b, c, d = turn if any(turn) else UPRIGHT  # as views interpret an unset quaternion
    shape = _shape_from_ros(marker)
    return Obstacle(name_of((marker.ns, marker.id)), shape, (x, y, z), (a, b, c, d))


def _shape_from_ros(marker: Marker) -> Shape:
    x, y, z = scale = marker.scale.x, marker.scale.y, marker.scale.z
    for axis, size in zip('xyz', scale, strict=True):
        if marker.type in (Marker.TRIANGLE_LIST, Marker.MESH_RESOURCE):
            if not 1e-6 <= size <= 1e6:  # nor nan
                raise ObstacleError(f'scale.{axis} is {size:g}; allowed: 1e-6 to 1e6, 1 where the '
                                    'points are in m')
        else:
            check_size(f'scale.{axis}', size)
    if marker.type == Marker.SPHERE:
        return Sphere(max(scale) / 2)
    if marker.type == Marker.CUBE:
        return Box(scale)
    if marker.type == Marker.CYLINDER:
        kind = Capsule if marker.text == CAPSULE else Cylinder
        return kind(max(x, y) / 2, z)
    if marker.type == Marker.MESH_RESOURCE:
        place = urlparse(marker.mesh_resource)
        if place.scheme != 'file' or place.netloc not in ('', 'localhost'):
            raise ObstacleError(
                f'mesh_resource is {printable(repr(marker.mesh_resource), MAX_NAME)}; allowed: '
                'file:///PATH on the machine of shape_sequencer, or TRIANGLE_LIST')
        return load_mesh(unquote(place.path), scale)
    if len(marker.points) % 3:
        raise ObstacleError(f'{len(marker.points)} points; three make a triangle')
    points = np.array([(p.x, p.y, p.z) for p in marker.points]).reshape(-1, 3, 3)
    return mesh_of_triangles(points * scale)


def known_from_ros(message: MarkerArray) -> dict[Key, Obstacle]:
    """Return the obstacles in known_obstacles, without invalid ones."""
    found = {}
    for marker in message.markers[:MAX_KNOWN]:
        # None is of a file: what others send must not make this process read one.
        if (marker.action == Marker.ADD and marker.type != Marker.MESH_RESOURCE
                and not is_decoration(marker)):
            with suppress(ObstacleError):
                found[marker.ns, marker.id] = obstacle_from_ros(marker, marker.header.frame_id)
    return found


def obstacle_to_ros(key: Key, obstacle: Obstacle, frame: str, stamp: Time) -> Iterator[Marker]:
    """Return the markers of an obstacle; the first one is that for obstacle_from_ros."""
    shape, place = obstacle.shape, np.array(obstacle.position, dtype=float)
    namespace, number = key
    marker = _marker(namespace, number, obstacle, place, frame, stamp)
    size: Sequence[float] = (1.0, 1.0, 1.0)
    if isinstance(shape, Sphere):
        marker.type, size = Marker.SPHERE, (2 * shape.radius,) * 3
    elif isinstance(shape, Box):
        marker.type, size = Marker.CUBE, shape.size
    elif isinstance(shape, Cylinder):
        marker.type, size = Marker.CYLINDER, (2 * shape.radius, 2 * shape.radius, shape.length)
    else:
        marker.type, marker.points = Marker.TRIANGLE_LIST, _corners(shape)
    _scale(marker, size)
    if isinstance(shape, Capsule):
        marker.text = CAPSULE
    yield marker
    if isinstance(shape, Capsule):
        along = obstacle.rotation[:, 2] * shape.length / 2
        for k, middle in enumerate((place - along, place + along)):
            end = _marker(_ends(key), k, obstacle, middle, frame, stamp)
            end.type, end.text = Marker.SPHERE, END
            _scale(end, (2 * shape.radius,) * 3)
            yield end


def removal(key: Key) -> list[Marker]:
    """Return the markers that remove an obstacle."""
    return [Marker(ns=ns, id=k, action=Marker.DELETE) for ns, k in (
        key, (_ends(key), 0), (_ends(key), 1))]


def _ends(key: Key) -> str:
    """Return the namespace of the half balls of a capsule."""
    return f'{name_of(key)}/ends'


def _marker(namespace: str, number: int, obstacle: Obstacle, place: Array, frame: str, stamp: Time
            ) -> Marker:
    r, g, b = (channel / 255 for channel in OBSTACLE)
    marker = Marker(ns=namespace, id=number, action=Marker.ADD,
                    color=ColorRGBA(r=r, g=g, b=b, a=OBSTACLE_OPACITY))
    marker.header.frame_id, marker.header.stamp = frame, stamp
    p, q = marker.pose.position, marker.pose.orientation
    p.x, p.y, p.z = place.tolist()
    q.x, q.y, q.z, q.w = (float(part) for part in obstacle.orientation)
    return marker


def _scale(marker: Marker, size: Sequence[float]) -> None:
    marker.scale.x, marker.scale.y, marker.scale.z = (float(length) for length in size)


def _corners(mesh: Mesh) -> list[Point]:
    corners = np.asarray(mesh.vertices, dtype=float)[mesh.triangles].reshape(-1, 3)
    return [Point(x=x, y=y, z=z) for x, y, z in corners.tolist()]
