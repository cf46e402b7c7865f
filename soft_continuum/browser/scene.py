# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What is drawn: discs, skins, tendons, what is measured, predicted, and aimed at.

Handles are kept and moved; only what has changed is sent.
"""

from collections.abc import Sequence

import numpy as np
import viser

from soft_continuum.browser.session import Description
from soft_continuum.client.state import ArmState, Pose
from soft_continuum.colours import (
    DISC,
    GHOST,
    GHOST_OPACITY,
    LOCKED,
    MEASURED,
    PREDICTED,
    segment_colour,
    tension_colour,
    UNKNOWN,
)
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array, orientation, RigidChain

SIDES = 32  # of skins and discs
RINGS_PER_JOINT = 3
PLEAT = 0.03  # of the radius: a skin is seen to bend by its pleats
SKIN = 0.88  # of the outer diameter, so that discs stand out
DISC_RADII = np.array([0.0, 1.0, 1.0, 1.0, 1.0, 0.0])  # rings twice, for sharp edges
DASHES = 9  # in each span of a slack tendon
VIEWS = {'side': (0.1, -1.5, 0.1), 'front': (1.5, -0.1, 0.1), 'above': (0.0, -0.3, 1.5)}
"""From where it can be looked at, over its length; first the plane in which it bends."""
MAX_PLACE = 100.0  # m or rad, of what is drawn; also not what is not a number
PIECES = 6  # of an edge of a predicted segment
OUTLINE = 1.1  # of the radius of the thickest disc
ROPE = 0.0009  # m, radius of a taut tendon as drawn


def viewpoint(arm: Arm, view: str) -> tuple[Array, Array]:
    """Return from where, and to where, (3,) m, one of VIEWS looks."""
    axis = np.array([np.sin(arm.mounting_angle), 0.0, np.cos(arm.mounting_angle)])
    target: Array = 0.5 * arm.length * axis
    return target + arm.length * np.array(VIEWS[view]), target


class Scene:
    """The arm of one description in a viser scene."""

    def __init__(self, server: viser.ViserServer, description: Description) -> None:
        """Draw nothing yet but the ground, and point the camera."""
        arm = description.arm
        self._chain = RigidChain(arm)
        self._limit = description.tension_limit
        self._drawn: tuple[object, ...] = ()
        self._joint_angles: tuple[float, ...] = ()  # the last that were received
        self._tensions = (np.nan,) * len(arm.tendon_names)
        self._ghost_line: tuple[tuple[float, float], ...] = ()
        self._seen_discs: Sequence[Pose | None] = ()
        scene = server.scene
        length = arm.length
        turn = orientation(arm.mounting_angle)
        root = scene.add_frame('/arm', show_axes=False, wxyz=(turn[3], *turn[:3]))
        self._root = root
        root.visible = False
        upright = np.cos(arm.mounting_angle) > 0.9
        ground = -0.001 if upright else -1.15 * length  # below an arm that hangs
        scene.add_grid('/ground', 4 * length, 4 * length, cell_size=0.05, section_size=0.1,
                       cell_color=(222, 226, 230), section_color=(200, 205, 210),
                       plane_color=(250, 250, 250), plane_opacity=1.0, shadow_opacity=0.25,
                       fade_distance=6 * length, position=(0.0, 0.0, ground))
        server.initial_camera.position, server.initial_camera.look_at = (
            tuple(place) for place in viewpoint(arm, 'side'))
        server.initial_camera.up = (0.0, 0.0, 1.0)

        n = self._chain.joints_per_segment
        self._stations = np.linspace(0.0, n - 1, RINGS_PER_JOINT * (n - 1) + 1)
        zero = np.zeros(self._chain.joints)
        faces = _faces(len(self._stations))
        self._skins = [
            scene.add_mesh_simple(f'/arm/skin_{s + 1}', skin, faces, color=UNKNOWN)
            for s, skin in enumerate(self._skin_vertices(zero))]
        # Discs are meshes like the skins, not moved cylinders: a slow browser shows these at
        # another time.
        each = _faces(len(DISC_RADII))
        count = SIDES * len(DISC_RADII)
        self._discs = scene.add_mesh_simple(
            '/arm/discs', self._disc_vertices(zero),
            np.concatenate([each + k * count for k in range(len(arm.discs))]), color=DISC)
        self._tendons = [
            scene.add_line_segments(f'/arm/{name}', np.zeros((1, 2, 3)), LOCKED,
                                    thickness=2 * ROPE)
            for name in arm.tendon_names]
        self._labels = [
            scene.add_label(f'/arm/label_{s + 1}', str(s + 1), anchor='center-center')
            for s in range(self._chain.segments)]
        self._seen = scene.add_line_segments(
            '/arm/seen', np.zeros((1, 2, 3)), MEASURED, thickness=2 * ROPE, visible=False)
        self._predicted_discs: Sequence[Pose] = ()
        self._predicted = scene.add_line_segments(
            '/arm/predicted', np.zeros((1, 2, 3)), PREDICTED, thickness=2 * ROPE, visible=False)
        self._prediction = scene.add_label('/arm/prediction', 'predicted',
                                           anchor='center-center', visible=False)
        self._ghost = scene.add_mesh_simple(
            '/arm/ghost', np.zeros((2 * SIDES, 3)), _faces(2), color=GHOST, opacity=GHOST_OPACITY,
            visible=False, cast_shadow=False, side='double')

    def show(self, state: ArmState, target: tuple[tuple[float, float], ...]) -> None:
        """Bring the scene up to date; target: points (x, z) m of the shape that is gone to."""
        count = self._chain.segments
        stiff: Sequence[bool | None] = (None,) * count  # a stale shape is drawn grey
        angles = state.joint_angles or ()
        if len(angles) == self._chain.joints and max(map(abs, angles)) < np.pi:  # false for nan
            self._joint_angles = angles
            if len(state.tensions or ()) == len(self._tensions):
                self._tensions = state.tensions or ()
            stiff = state.stiff if len(state.stiff) == count else stiff
        self._root.visible = bool(self._joint_angles)
        if not self._joint_angles:
            return
        drawn = (self._joint_angles, stiff, *(round(t, 1) for t in self._tensions))
        if repr(drawn) != repr(self._drawn):  # nan is not equal to itself
            self._drawn = drawn
            self._move(np.array(self._joint_angles))
            self._colour(stiff, self._tensions)
        self._show_ghost(target if state.progress else ())
        self._show_seen(state.measured_discs)
        measured = state.estimate is not None and state.estimate.measured
        self._show_predicted(state.predicted_disc_poses or () if measured else ())

    def _move(self, joint_angles: Array) -> None:
        self._discs.vertices = self._disc_vertices(joint_angles).astype(np.float32)
        for skin, vertices in zip(self._skins, self._skin_vertices(joint_angles), strict=True):
            skin.vertices = vertices.astype(np.float32)
        self._guides = self._chain.guide_points(joint_angles)
        middle = self._chain.backbone(joint_angles)
        n = self._chain.joints_per_segment
        for s, label in enumerate(self._labels):
            x, z, angle = middle[s * n + n // 2]
            aside = 0.8 * self._chain.arm.segments[0].outer_diameter
            label.position = (x + aside * np.cos(angle), 0.0, z - aside * np.sin(angle))

    def _colour(self, stiffness: Sequence[bool | None], tensions: Sequence[float]) -> None:
        for s, (skin, stiff) in enumerate(zip(self._skins, stiffness, strict=True)):
            skin.color = segment_colour(stiff)
            name = 'not known' if stiff is None else 'stiff' if stiff else 'soft'
            self._labels[s].text = f'{s + 1} {name}'
        for t, (tendon, tension) in enumerate(zip(self._tendons, tensions, strict=True)):
            is_slack = tension == 0.0
            pieces = _dashes(self._guides[t]) if is_slack else np.stack(
                [self._guides[t][:-1], self._guides[t][1:]], axis=1)
            points = np.zeros((len(pieces), 2, 3), dtype=np.float32)
            points[:, :, 0::2] = pieces
            tendon.points = points
            tendon.colors = np.array(tension_colour(tension, self._limit), dtype=np.uint8)
            tendon.thickness = ROPE if is_slack else 2 * ROPE

    def _show_ghost(self, line: tuple[tuple[float, float], ...]) -> None:
        if len(line) > 1 and line != self._ghost_line:
            if len(line) != len(self._ghost_line):  # another number of vertices needs other faces
                self._ghost.faces = _faces(len(line)).astype(np.uint32)
            self._ghost_line = line
            self._ghost.vertices = self._ghost_vertices(np.array(line)).astype(np.float32)
        self._ghost.visible = len(line) > 1

    def _show_seen(self, discs: Sequence[Pose | None]) -> None:
        """Draw an outline around every disc where a sensor sees it, on the side of the camera."""
        if discs == self._seen_discs:
            return
        self._seen_discs = discs
        outlines = [self._outline(n, disc) for n, disc in enumerate(discs)
                    if disc is not None and n < len(self._chain.arm.discs)
                    and np.isfinite((disc.x, disc.z, disc.angle)).all()]
        if outlines:
            self._seen.points = np.concatenate(outlines).astype(np.float32)
        self._seen.visible = bool(outlines)

    def _show_predicted(self, poses: Sequence[Pose]) -> None:
        """Draw the outline of the arm as the model alone has it, on the side of the camera."""
        if poses == self._predicted_discs:
            return
        self._predicted_discs = poses
        points = np.array([(p.x, p.z, p.angle) for p in poses])
        known = (len(poses) == 2 * len(self._chain.arm.discs)
                 and bool((np.abs(points) < MAX_PLACE).all()))
        if known:
            self._predicted.points = np.concatenate([
                *(self._outline(n, poses[2 * n]) for n in range(len(self._chain.arm.discs))),
                *(self._edges(*points[2 * n + 1:2 * n + 3]) for n in range(self._chain.segments)),
            ]).astype(np.float32)
            x, z, angle = points[-1]
            aside = 0.6 * self._chain.arm.segments[0].outer_diameter
            self._prediction.position = (x + aside * np.sin(angle), 0.0,
                                         z + aside * np.cos(angle))
        self._predicted.visible = self._prediction.visible = known

    def _edges(self, lower: Array, upper: Array) -> Array:
        """Return both edges of a segment between two poses (x, z, angle), (k, 2, 3) m."""
        half = 0.5 * SKIN * max(s.outer_diameter for s in self._chain.arm.segments)
        line = _between(lower, upper)
        edges = []
        for side in (-half, half):
            edge = np.column_stack([line[:, 0] + side * np.cos(line[:, 2]),
                                    np.full(len(line), -half * OUTLINE),
                                    line[:, 1] - side * np.sin(line[:, 2])])
            edges.append(np.stack([edge[:-1], edge[1:]], axis=1))
        both: Array = np.concatenate(edges)
        return both

    def _outline(self, n: int, pose: Pose) -> Array:
        """Return the four edges of a disc, (4, 2, 3) m."""
        arm = self._chain.arm
        half = max(s.outer_diameter for s in arm.segments) / 2.0 * OUTLINE
        up = np.array([np.sin(pose.angle), 0.0, np.cos(pose.angle)])
        right = np.array([np.cos(pose.angle), 0.0, -np.sin(pose.angle)])
        bottom = np.array([pose.x, -half, pose.z])
        corners = bottom + np.array([-half * right, half * right,
                                     half * right + arm.discs[n].height * up,
                                     -half * right + arm.discs[n].height * up])
        edges: Array = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        return edges

    # Shapes of meshes.

    def _disc_vertices(self, joint_angles: Array) -> Array:
        """Return the vertices (k, 3) of all discs, m."""
        points, guides = self._chain.points(joint_angles), self._chain.guides
        discs = []
        for k in range(len(points) // 2):
            ends = np.repeat(points[2 * k:2 * k + 2], len(DISC_RADII) // 2, axis=0)
            radius = guides[max(0, k - 1):k + 1].max() + 2 * ROPE
            discs.append(_tube(ends[:, 0], ends[:, 1], ends[:, 2], radius * DISC_RADII))
        return np.concatenate(discs)

    def _skin_vertices(self, joint_angles: Array) -> list[Array]:
        """Return the vertices (rings * SIDES, 3) of every segment's skin, m."""
        rows = self._chain.backbone(joint_angles)
        n = self._chain.joints_per_segment
        joints = np.arange(n)
        skins = []
        for s, segment in enumerate(self._chain.arm.segments):
            part = rows[s * n:s * n + n]
            x, z, angle = (np.interp(self._stations, joints, column) for column in part.T)
            pleats = 1.0 + PLEAT * np.cos(2 * np.pi * self._stations)
            skins.append(_tube(x, z, angle, 0.5 * SKIN * segment.outer_diameter * pleats))
        return skins

    def _ghost_vertices(self, line: Array) -> Array:
        """Return a thin tube along points (k, 2), m."""
        x, z = line.T
        radius = np.full(len(line), 0.3 * self._chain.arm.segments[0].outer_diameter)
        return _tube(x, z, np.arctan2(np.gradient(x), np.gradient(z)), radius)


def _between(lower: Array, upper: Array) -> Array:
    """Return a smooth line (k, 3) of x, z, angle that leaves and arrives along the poses."""
    t = np.linspace(0.0, 1.0, PIECES + 1)[:, None]
    chord = np.hypot(*(upper[:2] - lower[:2]))
    begin, end = (chord * np.array([np.sin(p[2]), np.cos(p[2])]) for p in (lower, upper))
    places = ((2 * t**3 - 3 * t**2 + 1) * lower[:2] + (t**3 - 2 * t**2 + t) * begin
              + (3 * t**2 - 2 * t**3) * upper[:2] + (t**3 - t**2) * end)
    line: Array = np.column_stack([places, lower[2] + t[:, 0] * (upper[2] - lower[2])])
    return line


def _dashes(points: Array) -> Array:
    """Return the dashes of a line through points (k, 2), shape (pieces, 2, 2)."""
    steps = np.linspace(0.0, 1.0, 2 * DASHES)[:, None, None]
    fine = points[:-1] + steps * (points[1:] - points[:-1])
    pieces: Array = np.stack([fine[:-1:2], fine[1::2]], axis=2).reshape(-1, 2, 2)
    return pieces


def _tube(x: Array, z: Array, angle: Array, radius: Array) -> Array:
    """Return the vertices (rings * SIDES, 3) around a line in the x-z plane."""
    around = np.linspace(0.0, 2 * np.pi, SIDES, endpoint=False)
    across = radius[:, None] * np.cos(around)
    vertices = np.empty((len(x), SIDES, 3))
    vertices[:, :, 0] = x[:, None] + across * np.cos(angle)[:, None]
    vertices[:, :, 1] = radius[:, None] * np.sin(around)
    vertices[:, :, 2] = z[:, None] - across * np.sin(angle)[:, None]
    return vertices.reshape(-1, 3)


def _faces(rings: int) -> Array:
    """Return the triangles (k, 3) of such a tube, seen from outside."""
    ring, side = np.meshgrid(np.arange(rings - 1), np.arange(SIDES), indexing='ij')
    a = (ring * SIDES + side).ravel()
    b = (ring * SIDES + (side + 1) % SIDES).ravel()
    return np.concatenate([np.stack([a, b, a + SIDES], axis=1),
                           np.stack([b, b + SIDES, a + SIDES], axis=1)])
