# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a plan: one panel for each step, or an animation."""

from collections.abc import Sequence
from math import ceil
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from soft_continuum.analysis.figures import DPI, new_figure
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.drawing import draw_arm, projection_of, SOFT
from soft_continuum.obstacles import Obstacle
from soft_continuum.obstacles.drawing import draw_obstacles
from soft_continuum.sequencing.plans import Reach, WHOLE_ARM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES = '.png', '.svg', '.pdf', '.gif'
COLUMNS = 4
FRAMES = 20  # of each step of an animation
RATE, REST = 12, 6  # frames per second, and that many at the end of each step
PATH, GOAL = 'tab:blue', 'tab:green'
GIF_DPI = 90
MARGIN = 0.03  # m around all that is drawn


def plan_figure(path: Path, start: Any, found: Reach, obstacles: Sequence[Obstacle], goals: Array
                ) -> None:
    """
    Write a picture of a plan that has steps, in mm.

    path: its suffix, one of SUFFIXES, selects the kind.  start: the state at the start.  goals:
    (k, 3) m, of the tip.  Planar arms and their obstacles are seen along y.
    """
    picture = _Picture(start, found, obstacles, goals)
    if path.suffix == '.gif':
        picture.move(path)
    else:
        picture.write(path)


class _Picture:
    """Drawing shared by all panels and frames."""

    def __init__(self, start: Any, found: Reach, obstacles: Sequence[Obstacle], goals: Array
                 ) -> None:
        assert found.plan is not None
        arm = start.chain.arm
        self.projection, self.picked = projection_of(arm), np.flatnonzero(arm.pose_axes[:3])
        self.goals, self.steps, self.obstacles = goals, found.steps, obstacles
        self.titles = [f'{number}: ' + (
            'the whole arm' if move.segment == WHOLE_ARM else f'segment {move.segment + 1}')
            for number, move in enumerate(found.plan.moves, start=1)]
        self.soft = [move.segment for move in found.plan.moves]
        self.start, self.end = start, found.steps[-1].states[-1]
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
        tall = min(7.0, max(2.5, 3.2 * height / width)) if self.projection is None else 3.6
        figure = new_figure(3.6 * columns, (tall + 0.8) * rows)
        self._draw(self._axes(figure, rows, columns, 1), self.start, 'start', None, 0)
        for number, step in enumerate(self.steps):
            axes = self._axes(figure, rows, columns, number + 2)
            self._draw(axes, step.states[-1], self.titles[number], self.soft[number], number + 1)
        figure.savefig(path, dpi=DPI)

    def move(self, path: Path) -> None:
        """Write an animation."""
        from matplotlib.animation import PillowWriter
        from matplotlib.figure import Figure
        figure = Figure(figsize=(5.0, 5.0))
        writer = PillowWriter(fps=RATE)
        with writer.saving(figure, path, GIF_DPI):
            for number, step in enumerate(self.steps):
                chosen = np.unique(np.linspace(0, len(step.states) - 1, FRAMES).round())
                for i in chosen.astype(int).tolist():
                    figure.clear()
                    self._draw(self._axes(figure, 1, 1, 1), step.states[i], self.titles[number],
                               self.soft[number], number, self.tips[number][:i + 1])
                    writer.grab_frame()
                for _ in range(REST):
                    writer.grab_frame()

    def _axes(self, figure: 'Figure', rows: int, columns: int, number: int) -> Any:
        return figure.add_subplot(rows, columns, number, projection=self.projection)

    def _draw(self, axes: Any, state: Any, title: str, soft: int | None, done: int,
              running: Array | None = None) -> None:
        """Draw a state with the path of the tip in previous steps and in this one."""
        draw_arm(axes, state)
        draw_obstacles(axes, self.obstacles)
        for tips in (*self.tips[:done], *([] if running is None else [running])):
            axes.plot(*tips[:, self.picked].T, color=PATH, linewidth=1.2)
        axes.plot(*(1e3 * self.goals[:, self.picked]).T, 'x', color=GOAL, markersize=8,
                  markeredgewidth=2)
        for name, k in zip('xyz', self.picked, strict=False):
            axes.set(**{f'{name}lim': (self.low[k], self.high[k])})
        if self.projection is None:
            axes.set_ylabel('z in mm')
        else:
            axes.set_box_aspect(self.high - self.low, zoom=0.88)
            axes.locator_params(axis='y', nbins=4)  # seen nearly end on
        axes.set_title(title, color='black' if soft is None else SOFT)
