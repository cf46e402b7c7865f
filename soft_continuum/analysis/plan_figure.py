# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a plan: one panel for each step, or a moving picture."""

from collections.abc import Sequence
from io import BytesIO
from math import ceil
from pathlib import Path
from typing import Any

from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
import numpy as np
from PIL import Image
from scipy.spatial import ConvexHull

from soft_continuum.analysis.figures import DPI, draw_arm, draw_in_space, SOFT
from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Array
from soft_continuum.obstacles import Box, Capsule, Mesh, Obstacle, Sphere
from soft_continuum.sequencing.planner import WHOLE_ARM
from soft_continuum.sequencing.reach import Reach

SUFFIXES = '.png', '.svg', '.pdf', '.gif'
COLUMNS = 4
FRAMES = 24  # of each step of a moving picture
FRAME, LAST_FRAME = 60, 1500  # ms
ROUND = 24  # corners of a circle
PATH, GOAL, OBSTACLE = 'tab:blue', 'tab:green', 'tab:red'
MARGIN = 0.03  # m around all that is drawn


def plan_figure(path: Path, start: Any, found: Reach, obstacles: Sequence[Obstacle], goals: Array
                ) -> None:
    """
    Write a picture of a plan that has steps, in mm.

    path: its suffix, one of SUFFIXES, tells the kind.  start: the state at the start.  goals:
    (k, 3) m, where the tip shall be.  A planar arm, and what is around it, is seen along y.
    """
    picture = _Picture(start, found, obstacles, goals)
    if path.suffix == '.gif':
        picture.move(path)
    else:
        picture.write(path)


class _Picture:
    """What is drawn again and again."""

    def __init__(self, start: Any, found: Reach, obstacles: Sequence[Obstacle], goals: Array
                 ) -> None:
        assert found.plan is not None
        self.planar = isinstance(start.chain.arm, Arm)
        self.goals, self.steps = goals, found.steps
        self.titles = [f'{number}: ' + (
            'the whole arm' if move.segment == WHOLE_ARM else f'segment {move.segment + 1}')
            for number, move in enumerate(found.plan.moves, start=1)]
        self.soft = [move.segment for move in found.plan.moves]
        self.start, self.end = start, found.steps[-1].states[-1]
        self.patches = [patch for one in obstacles for patch in _faces(one)]
        states = [start, *(state for step in found.steps for state in step.states)]
        points = 1e3 * np.vstack([goals, np.zeros((1, 3)), *(s.backbone for s in states)])
        around = 1e3 * (MARGIN + start.chain.disc_radii.max())
        self.low, self.high = points.min(axis=0) - around, points.max(axis=0) + around
        self.tips = [1e3 * np.array([s.backbone[-1] for s in step.states])
                     for step in found.steps]

    def write(self, path: Path) -> None:
        """Write a panel for the start and for the end of each step."""
        count = 1 + len(self.steps)
        columns = min(count, COLUMNS)
        rows = ceil(count / columns)
        width, _, height = self.high - self.low
        tall = min(7.0, max(2.5, 3.2 * height / width)) if self.planar else 3.6
        figure = Figure(figsize=(3.6 * columns, (tall + 0.8) * rows), layout='constrained')
        self._draw(self._axes(figure, rows, columns, 1), self.start, 'start', None, 0)
        for number, step in enumerate(self.steps):
            axes = self._axes(figure, rows, columns, number + 2)
            self._draw(axes, step.states[-1], self.titles[number], self.soft[number], number + 1)
        figure.savefig(path, dpi=DPI)

    def move(self, path: Path) -> None:
        """Write a moving picture."""
        figure = Figure(figsize=(5.0, 5.0))
        frames, times = [], []
        for number, step in enumerate(self.steps):
            chosen = np.unique(np.linspace(0, len(step.states) - 1, FRAMES).round().astype(int))
            for i in chosen.tolist():
                figure.clear()
                self._draw(self._axes(figure, 1, 1, 1), step.states[i], self.titles[number],
                           self.soft[number], number, self.tips[number][:i + 1])
                drawn = BytesIO()
                figure.savefig(drawn, format='png', dpi=DPI)
                frames.append(Image.open(drawn).convert('RGB').quantize(48))
                times.append(FRAME)
        times[-1] = LAST_FRAME
        frames[0].save(path, save_all=True, append_images=frames[1:], loop=0, duration=times,
                       optimize=True)

    def _axes(self, figure: Figure, rows: int, columns: int, number: int) -> Any:
        return figure.add_subplot(
            rows, columns, number, **({} if self.planar else {'projection': '3d'}))

    def _draw(self, axes: Any, state: Any, title: str, soft: int | None, done: int,
              running: Array | None = None) -> None:
        """Draw a state with the way of the tip in the steps that are done, and in this one."""
        if self.planar:
            draw_arm(axes, state.chain, state.joint_angles, [] if soft is None else [soft])
            axes.set_ylabel('z in mm')
        else:
            draw_in_space(axes, state)
        picked = [0, 2] if self.planar else [0, 1, 2]
        if self.planar:
            axes.add_collection(PolyCollection(
                [_outline(face[:, ::2]) for face in self.patches], facecolor=OBSTACLE, alpha=0.35,
                edgecolor='none', zorder=0.5))
        else:
            axes.add_collection3d(Poly3DCollection(
                [part for face in self.patches for part in _hull(face)], facecolor=OBSTACLE,
                alpha=0.25, edgecolor='none'))
        for tips in (*self.tips[:done], *([] if running is None else [running])):
            axes.plot(*tips[:, picked].T, color=PATH, linewidth=1.2)
        axes.plot(*(1e3 * self.goals[:, picked]).T, 'x', color=GOAL, markersize=8,
                  markeredgewidth=2)
        for name, k in zip('xy' if self.planar else 'xyz', picked, strict=True):
            axes.set(**{f'{name}lim': (self.low[k], self.high[k])})
        if not self.planar:
            axes.set_box_aspect(self.high - self.low, zoom=0.88)
        axes.set_title(title, color='black' if soft is None else SOFT)


def _faces(obstacle: Obstacle) -> list[Array]:
    """Return convex parts of an obstacle as points of them, (n, 3), mm."""
    shape, place = obstacle.shape, np.array(obstacle.position)
    if isinstance(shape, Mesh):
        parts = [np.asarray(shape.vertices)[corners] for corners in np.asarray(shape.triangles)]
    elif isinstance(shape, Box):
        parts = [np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5)
                           for z in (-0.5, 0.5)]) * shape.size]
    else:
        around = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
        circle = np.column_stack([np.cos(around), np.sin(around), np.zeros(ROUND)])
        up = np.array([0.0, 0.0, 1.0])
        ball = np.vstack([np.cos(t) * circle + np.sin(t) * up
                          for t in np.linspace(-np.pi / 2, np.pi / 2, ROUND // 2)])
        if isinstance(shape, Sphere):
            parts = [shape.radius * ball]
        else:
            edge = shape.radius * (ball if isinstance(shape, Capsule) else circle)
            parts = [np.vstack([edge + side * shape.length / 2 * up for side in (-1.0, 1.0)])]
    return [1e3 * (part @ obstacle.rotation.T + place) for part in parts]


def _outline(points: Array) -> Array:
    """Return the corners of the convex hull of points in a plane, in their order."""
    if len(points) == 3:
        return points
    outline: Array = points[ConvexHull(points).vertices]
    return outline


def _hull(points: Array) -> list[Array]:
    """Return the triangles of the convex hull of points in space."""
    return [points] if len(points) == 3 else [points[s] for s in ConvexHull(points).simplices]
