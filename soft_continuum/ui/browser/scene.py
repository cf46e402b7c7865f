# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The 3-D scene: discs, skins, tendons, obstacles, measurement, prediction and goal.

Handles are kept and moved; only changes are sent.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import viser

from soft_continuum.client import ArmState, Pose
from soft_continuum.colours import (
    AXES,
    DISC,
    GHOST,
    GHOST_OPACITY,
    LOCKED,
    MEASURED,
    OBSTACLE,
    OBSTACLE_OPACITY,
    PREDICTED,
    segment_colour,
    tension_colour,
    UNKNOWN,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.mechanics.rotations import matrices, orientation
from soft_continuum.planning.obstacles import Box, Capsule, Cylinder, Mesh, Obstacle, Sphere
from soft_continuum.ros.obstacles import Key
from soft_continuum.ui.browser.meshes import (
    curve,
    dashes,
    frames_along,
    line,
    Points,
    rectangle,
    repeated,
    sampled,
    SIDES,
    tube,
    tube_faces,
)
from soft_continuum.ui.browser.session import Description

RINGS_PER_JOINT = 3
PLEAT = 0.03  # of the radius: pleats make the bending of a skin visible
SKIN = 0.88  # of the outer diameter, so that discs stand out
ROD = 0.3  # of the distance between backbone and next tendon: a backbone without a skin
DISC_RADII = np.array([0.0, 1.0, 1.0, 1.0, 1.0, 0.0])  # rings twice, for sharp edges
SPACER_RADII, SPACER_SIDES = np.array([0.0, 1.0, 1.0, 0.0]), 16
DASHES = 9  # in a segment, of a slack tendon
PLANAR_VIEWS = {'side': (0.1, -1.5, 0.1), 'front': (1.5, -0.1, 0.1), 'above': (0.0, -0.3, 1.5)}
"""Viewpoints of a planar arm, relative to its length; the bending plane first."""
FIRST_VIEW = 'three-quarter'
VIEWS = {FIRST_VIEW: (0.7, -0.82, 0.25), **PLANAR_VIEWS}
"""Viewpoints of a spatial arm."""
MAX_PLACE = 100.0  # m, of what is drawn; also not what is not a number
OUTLINE = 1.1  # of the radius of the thickest disc
STEEL = 7850.0  # kg/m^3: a payload is drawn as a ball of this density
BALL = np.linspace(0.0, np.pi, 9)  # rad from its lower end, of its rings
ROPE = 0.0027  # of the length of the arm: radius of a taut tendon as drawn
AXIS = 0.25  # of the length of the arm: axes at its base
FOLDER = '/arm/obstacles'


def views_of(description: Description) -> dict[str, tuple[float, float, float]]:
    """Return the viewpoints of the arm, relative to its length, the default first."""
    return VIEWS if all(description.moves_along) else PLANAR_VIEWS


def viewpoint(description: Description, view: str) -> tuple[Array, Array]:
    """Return position and target, (3,) m, of one of views_of."""
    angle, length = description.arm.mounting_angle, description.arm.length
    target: Array = 0.5 * length * np.array([np.sin(angle), 0.0, np.cos(angle)])
    return target + length * np.array(views_of(description)[view]), target


class Scene:
    """The arm of one description in a viser scene."""

    def __init__(self, server: viser.ViserServer, description: Description) -> None:
        """Draw only the ground, and point the camera."""
        self._description = description
        self._chain = Chain(description.arm)
        self._drawn: tuple[object, ...] = ()
        self._joint_angles: tuple[float, ...] = ()  # the last that were received
        self._tensions = (np.nan,) * len(description.arm.tendon_names)
        self._ghost_line: Points = ()
        self._seen_discs: Sequence[Pose | None] = ()
        self._predicted_discs: Sequence[Pose] = ()
        self._rope = ROPE * description.arm.length
        self._half = OUTLINE * max(s.outer_diameter for s in description.arm.segments) / 2.0
        self._aside = 0.8 * description.arm.segments[0].outer_diameter
        self._label_side = np.array([1.0, 0.0, 0.0])  # of the body's frame
        self._sideways = all(description.moves_along)
        if self._sideways:  # left of the arm in the first view: the axes are on its right
            x, y, _ = VIEWS[FIRST_VIEW]
            left = np.array([y * np.cos(description.arm.mounting_angle), -x, 0.0])
            self._label_side = left / np.linalg.norm(left)
        self._add_surroundings(server, description)
        self._add_arm(server.scene, description)
        self._add_beside_it(server.scene)
        self._obstacles = DrawnObstacles(server.scene)

    def _add_surroundings(self, server: viser.ViserServer, description: Description) -> None:
        """Add the ground, the frame of the base, its axes, and the camera."""
        scene, length = server.scene, description.arm.length
        angle = description.arm.mounting_angle
        turn = orientation(angle)
        self._root = scene.add_frame('/arm', show_axes=False, wxyz=(turn[3], *turn[:3]))
        self._root.visible = False
        ground = -0.001 if np.cos(angle) > 0.9 else -1.15 * length  # below an arm that hangs
        scene.add_grid('/ground', 4 * length, 4 * length, cell_size=0.05, section_size=0.1,
                       cell_color=(222, 226, 230), section_color=(200, 205, 210),
                       plane_color=(250, 250, 250), plane_opacity=1.0, shadow_opacity=0.25,
                       fade_distance=6 * length, position=(0.0, 0.0, ground))
        server.initial_camera.position, server.initial_camera.look_at = (
            tuple(place) for place in viewpoint(description, next(iter(views_of(description)))))
        server.initial_camera.up = (0.0, 0.0, 1.0)
        if any(description.directed):  # directions are about z, from x to y
            ends = AXIS * length * np.eye(3)[:2]
            scene.add_line_segments(
                '/arm/axes', np.stack([np.zeros((2, 3)), ends], axis=1), AXES,
                thickness=2 * self._rope)
            for name, end in zip(('x, 0°', 'y, 90°'), ends, strict=True):
                scene.add_label(f'/arm/{name[0]}', name, position=tuple(1.2 * end),
                                anchor='center-center')

    def _add_arm(self, scene: viser.SceneApi, description: Description) -> None:
        """Add skins or backbones, spacers, discs, tendons and the numbers of the segments."""
        arm, n = description.arm, self._chain.joints_per_segment
        self._stations = np.linspace(0.0, n - 1, RINGS_PER_JOINT * (n - 1) + 1)
        straight = self._chain.straight()
        points, frames = _along(straight)
        triangles = tube_faces(len(self._stations))
        self._joints = len(straight.joint_positions)
        rod = ROD * min(float(np.hypot(*guide[:2])) for guides in straight.tendon_points
                        for guide in guides)
        self._radii = [0.5 * SKIN * s.outer_diameter if description.jamming else
                       max(rod, self._rope) for s in arm.segments]
        self._skins = [
            scene.add_mesh_simple(f'/arm/skin_{s + 1}', skin, triangles, color=UNKNOWN)
            for s, skin in enumerate(self._skin_vertices(points, frames))]
        # Discs are meshes like the skins: a slow browser would move cylinders at another time.
        self._discs = scene.add_mesh_simple(
            '/arm/discs', self._disc_vertices(straight),
            repeated(tube_faces(len(DISC_RADII)), len(arm.discs)), color=DISC)
        # With jamming the skin hides them.
        spacers = 0 if description.jamming else arm.spacers
        each = arm.bodies_per_segment // (spacers + 1)
        self._spacers = np.array([s * n + k * each for s in range(len(arm.segments))
                                  for k in range(1, spacers + 1)], dtype=int)
        if len(self._spacers):
            self._spacer_mesh = scene.add_mesh_simple(
                '/arm/spacers', self._spacer_vertices(points, frames),
                repeated(tube_faces(len(SPACER_RADII), SPACER_SIDES), len(self._spacers)),
                color=DISC)
        self._ball = np.cbrt(0.75 * arm.payload / (np.pi * STEEL))
        if self._ball:
            self._payload = scene.add_mesh_simple(
                '/arm/payload', self._payload_vertices(points, frames), tube_faces(len(BALL)),
                color=DISC)
        self._dashes = max(2, round(DASHES / (spacers + 1)))
        self._tendons = [
            scene.add_line_segments(f'/arm/{name}', np.zeros((1, 2, 3)), LOCKED,
                                    thickness=2 * self._rope)
            for name in arm.tendon_names]
        self._labels = [
            scene.add_label(f'/arm/label_{s + 1}', str(s + 1), anchor='center-center')
            for s in range(len(arm.segments))]

    def _add_beside_it(self, scene: viser.SceneApi) -> None:
        """Add measurement, prediction and goal; hidden until available."""
        self._seen, self._predicted = (
            scene.add_line_segments(f'/arm/{name}', np.zeros((1, 2, 3)), colour,
                                    thickness=2 * self._rope, visible=False)
            for name, colour in (('seen', MEASURED), ('predicted', PREDICTED)))
        self._prediction = scene.add_label('/arm/prediction', 'predicted',
                                           anchor='center-center', visible=False)
        self._ghost = scene.add_mesh_simple(
            '/arm/ghost', np.zeros((2 * SIDES, 3)), tube_faces(2), color=GHOST,
            opacity=GHOST_OPACITY, visible=False, cast_shadow=False, side='double')

    def show(self, state: ArmState, ghost: Points, obstacles: Mapping[Key, Obstacle]) -> None:
        """Bring the scene up to date; ghost: of the target or selected shape."""
        self._obstacles.show(obstacles)
        count = len(self._skins)
        stiff: Sequence[bool | None] = (None,) * count  # a stale shape is drawn grey
        angles = state.joint_angles or ()
        if len(angles) == self._joints and max(map(abs, angles)) < np.pi:  # false for nan
            self._joint_angles = angles
            if len(state.tensions or ()) == len(self._tensions):
                self._tensions = state.tensions or ()
            if not self._description.jamming:
                stiff = (False,) * count
            elif len(state.stiff) == count:
                stiff = state.stiff
        self._root.visible = bool(self._joint_angles)
        if not self._joint_angles:
            return
        drawn = (self._joint_angles, stiff, *(round(t, 1) for t in self._tensions))
        if repr(drawn) != repr(self._drawn):  # nan is not equal to itself
            self._drawn = drawn
            self._move(self._chain.at(np.array(self._joint_angles)))
            self._colour(stiff, self._tensions)
        self._show_ghost(ghost)
        self._show_seen(state.measured_discs)
        measured = state.estimate is not None and state.estimate.measured
        self._show_predicted(state.predicted_disc_poses or () if measured else ())

    def _move(self, state: Equilibrium) -> None:
        points, frames = _along(state)
        self._discs.vertices = self._disc_vertices(state).astype(np.float32)
        for skin, vertices in zip(self._skins, self._skin_vertices(points, frames), strict=True):
            skin.vertices = vertices.astype(np.float32)
        if len(self._spacers):
            self._spacer_mesh.vertices = self._spacer_vertices(points, frames).astype(np.float32)
        if self._ball:
            self._payload.vertices = self._payload_vertices(points, frames).astype(np.float32)
        self._guides = state.tendon_points
        n = self._chain.joints_per_segment
        for s, label in enumerate(self._labels):
            middle = s * n + n // 2
            label.position = tuple(
                points[middle] + self._aside * frames[middle] @ self._label_side)

    def _colour(self, stiffness: Sequence[bool | None], tensions: Sequence[float]) -> None:
        for s, (skin, stiff) in enumerate(zip(self._skins, stiffness, strict=True)):
            skin.color = segment_colour(stiff)
            name = 'not known' if stiff is None else 'stiff' if stiff else 'soft'
            self._labels[s].text = f'{s + 1} {name}' if self._description.jamming else f'{s + 1}'
        for t, (tendon, tension) in enumerate(zip(self._tendons, tensions, strict=True)):
            is_slack, guides = tension == 0.0, self._guides[t]
            pieces = dashes(guides, self._dashes) if is_slack else line(guides)
            tendon.points = pieces.astype(np.float32)
            tendon.colors = np.array(
                tension_colour(tension, self._description.tension_limit), dtype=np.uint8)
            tendon.thickness = self._rope if is_slack else 2 * self._rope

    def _show_ghost(self, points: Points) -> None:
        if len(points) > 1 and points != self._ghost_line:
            if len(points) != len(self._ghost_line):  # other numbers of vertices need other faces
                self._ghost.faces = tube_faces(len(points)).astype(np.uint32)
            self._ghost_line = points
            places = np.array(points)
            radii = np.full(len(points), 0.3 * self._description.arm.segments[0].outer_diameter)
            self._ghost.vertices = tube(places, frames_along(places), radii).astype(np.float32)
        self._ghost.visible = len(points) > 1

    def _show_seen(self, discs: Sequence[Pose | None]) -> None:
        """Draw an outline at the measured pose of every disc."""
        if discs == self._seen_discs:
            return
        self._seen_discs = discs
        outlines = [self._outline(n, *_placed([disc])) for n, disc in enumerate(discs)
                    if disc is not None and n < len(self._description.arm.discs)
                    and np.isfinite((*disc.position, *disc.orientation)).all()]
        if outlines:
            self._seen.points = np.concatenate(outlines).astype(np.float32)
        self._seen.visible = bool(outlines)

    def _show_predicted(self, poses: Sequence[Pose]) -> None:
        """Draw the outline of the arm as predicted open loop."""
        if poses == self._predicted_discs:
            return
        self._predicted_discs = poses
        known = len(poses) == 2 * len(self._description.arm.discs) and bool(
            (np.abs([(*p.position, *p.orientation) for p in poses]) < MAX_PLACE).all())
        if known:
            places, frames = _placed(poses)
            self._predicted.points = np.concatenate([
                *(self._outline(n // 2, places[n:], frames[n:]) for n in range(0, len(poses), 2)),
                *(self._edges(places[n:n + 2], frames[n:n + 2])
                  for n in range(1, len(poses) - 1, 2)),
            ]).astype(np.float32)
            self._prediction.position = tuple(places[-1] + 0.75 * self._aside * frames[-1, :, 2])
        self._predicted.visible = self._prediction.visible = known

    def _sides(self, frame: Array) -> list[tuple[Array, Array]]:
        """Return the position of an outline relative to the backbone, and its half width, m."""
        x, y = self._half * frame[:, 0], self._half * frame[:, 1]
        # That of a planar arm is on the side of the camera.
        return [(0.0 * x, x), (0.0 * y, y)] if self._sideways else [(-y, x)]

    def _outline(self, n: int, places: Array, frames: Array) -> Array:
        """Return the edges of a disc whose bottom is the first of the places, (k, 2, 3) m."""
        up = self._description.arm.discs[n].height * frames[0, :, 2]
        return np.concatenate([rectangle(places[0] + middle, up, across)
                               for middle, across in self._sides(frames[0])])

    def _edges(self, places: Array, frames: Array) -> Array:
        """Return the edges of a segment between two places and frames, (k, 2, 3) m."""
        middle = curve(places, frames[:, :, 2])
        turned = sampled(frames, np.linspace(0.0, 1.0, len(middle)))
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        sides = [self._sides(frame) for frame in turned]
        return np.concatenate([
            line(middle + [side[i][0] + sign * SKIN / OUTLINE * side[i][1] for side in sides])
            for i in range(len(sides[0])) for sign in (-1.0, 1.0)])

    # Shapes of meshes.

    def _disc_vertices(self, state: Equilibrium) -> Array:
        """Return the vertices (k, 3) of all discs, m."""
        poses, each = state.poses, len(DISC_RADII) // 2
        frames = np.repeat(matrices(poses[:, 3:]), each, axis=0)
        radii = np.repeat(self._chain.disc_radii + 2 * self._rope, len(DISC_RADII))
        return tube(np.repeat(poses[:, :3], each, axis=0), frames,
                    radii * np.tile(DISC_RADII, len(poses) // 2))

    def _spacer_vertices(self, points: Array, frames: Array) -> Array:
        """Return the vertices (k, 3) of all spacers, m; arguments: of _along."""
        rings = len(SPACER_RADII)
        centres, turned = points[self._spacers], frames[self._spacers]
        ends = centres[:, None] + self._rope * np.array([-1.0, -1.0, 1.0, 1.0])[:, None] \
            * turned[:, None, :, 2]
        radii = [s.outer_diameter / 2 for s in self._description.arm.segments]
        each = np.repeat(radii, len(self._spacers) // len(radii))
        return tube(ends.reshape(-1, 3), np.repeat(turned, rings, axis=0),
                    (each[:, None] * SPACER_RADII).ravel(), SPACER_SIDES)

    def _payload_vertices(self, points: Array, frames: Array) -> Array:
        """Return the vertices (k, 3) of a ball on the tip, m; arguments: of _along."""
        heights = self._ball * (1.0 - np.cos(BALL))
        return tube(points[-1] + heights[:, None] * frames[-1, :, 2],
                    np.repeat(frames[-1:], len(BALL), axis=0), self._ball * np.sin(BALL))

    def _skin_vertices(self, points: Array, frames: Array) -> list[Array]:
        """Return the vertices (k, 3) along every segment, m; arguments: of _along."""
        n = self._chain.joints_per_segment
        pleats = 1.0 + PLEAT * self._description.jamming * np.cos(2 * np.pi * self._stations)
        return [tube(sampled(points[s * n:s * n + n], self._stations),
                     sampled(frames[s * n:s * n + n], self._stations), radius * pleats)
                for s, radius in enumerate(self._radii)]


def _along(state: Equilibrium) -> tuple[Array, Array]:
    """Return upper end and frame of every body, the base disc first, (k, 3) m, (k, 3, 3)."""
    return state.backbone, np.concatenate([np.eye(3)[None], state.rotations])


def _placed(poses: Sequence[Pose]) -> tuple[Array, Array]:
    """Return places (k, 3), m, and frames (k, 3, 3) of poses."""
    return (np.array([pose.position for pose in poses]),
            matrices(np.array([pose.orientation for pose in poses])))


class DrawnObstacles:
    """Obstacles, drawn in the frame of the base."""

    def __init__(self, scene: viser.SceneApi) -> None:
        """Start empty."""
        self._scene = scene
        self._drawn: Mapping[Key, Obstacle] = {}
        self._handles: list[Any] = []

    def show(self, obstacles: Mapping[Key, Obstacle]) -> None:
        """Draw these obstacles only."""
        if obstacles is self._drawn:
            return
        self._drawn = obstacles
        for handle in self._handles:
            handle.remove()
        self._handles = [handle for number, obstacle in enumerate(obstacles.values())
                         for handle in self._add(f'{FOLDER}/{number}', obstacle)]

    def _add(self, name: str, obstacle: Obstacle) -> list[Any]:
        scene, shape = self._scene, obstacle.shape
        x, y, z, w = obstacle.orientation
        place = np.array(obstacle.position)
        look: dict[str, Any] = {'opacity': OBSTACLE_OPACITY, 'wxyz': (w, x, y, z),
                                'position': place, 'cast_shadow': False}
        if isinstance(shape, Sphere):
            return [scene.add_icosphere(name, shape.radius, OBSTACLE, **look)]
        if isinstance(shape, Box):
            return [scene.add_box(name, OBSTACLE, shape.size, **look)]
        if isinstance(shape, Mesh):
            return [scene.add_mesh_simple(
                name, np.asarray(shape.vertices, dtype=np.float32), np.asarray(shape.triangles),
                color=OBSTACLE, flat_shading=True, side='double', **look)]
        assert isinstance(shape, Cylinder)
        drawn: list[Any] = [scene.add_cylinder(name, shape.radius, shape.length, OBSTACLE, **look)]
        if isinstance(shape, Capsule):
            along = obstacle.rotation[:, 2] * shape.length / 2
            drawn += [scene.add_icosphere(f'{name}_{end}', shape.radius, OBSTACLE,
                                          **{**look, 'position': place + sign * along})
                      for end, sign in (('below', -1.0), ('above', 1.0))]
        return drawn
