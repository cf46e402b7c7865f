# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Vacuum and tensions of the last minute."""

from collections import deque
from collections.abc import Sequence

import numpy as np
import viser
from viser import uplot

from soft_continuum.client.state import ArmState
from soft_continuum.mechanics.chain import Array

INTERVAL = 0.2  # s between two samples
LENGTH = 301  # samples: a minute
TIMES = np.linspace(-INTERVAL * (LENGTH - 1), 0.0, LENGTH)
AXIS_ENDS = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # where an axis may end
OFF_CHART = -1e4
TIME_SHIFT = 1e-6  # s
SEGMENT_COLOURS = ('#1b6ca8', '#e08e0b', '#2a9d55', '#8e44ad', '#c0392b', '#16a085')
TENDON_COLOURS = ('#d62828', '#2980d7')


class History:
    """Samples of vacuum (kPa) and tensions (N), the oldest first."""

    def __init__(self, segments: int, tendons: int, ambient_pressure: float) -> None:
        """Start without any; ambient_pressure: Pa."""
        self._ambient = ambient_pressure
        self._unknown = (np.nan,) * tendons
        self.vacuum: deque[tuple[float, ...]] = deque(
            [(np.nan,) * segments] * LENGTH, maxlen=LENGTH)
        self.tensions: deque[tuple[float, ...]] = deque([self._unknown] * LENGTH, maxlen=LENGTH)

    def sample(self, state: ArmState) -> None:
        """Take a sample, once every INTERVAL; what is not known is nan."""
        pressures = state.pressures or (None,) * len(self.vacuum[-1])
        self.vacuum.append(tuple(
            np.nan if p is None else (self._ambient - p) * 1e-3 for p in pressures))
        self.tensions.append(state.tensions or self._unknown)


class Chart:
    """One plot over the last minute, from zero up."""

    def __init__(self, gui: viser.GuiApi, title: str, names: Sequence[str],
                 colours: Sequence[str], top: float) -> None:
        """Add it, with a curve for each name; ``top``: where its axis ends at first."""
        self._gui, self._top, self._shift = gui, top, 0.0
        self._series = (uplot.Series(label='time'),
                        *(uplot.Series(label=name, stroke=colours[i % len(colours)], width=2)
                          for i, name in enumerate(names)))
        self._rows = np.full((LENGTH, len(names)), np.nan)
        self._box = gui.add_folder(title)
        self._plot = self._add()

    def _add(self) -> viser.GuiUplotHandle:
        with self._box:
            return self._gui.add_uplot(
                _drawn(self._rows), self._series, height=210, padding=(10, 14, 0, 0),
                scales={'x': uplot.Scale(time=False),
                        'y': uplot.Scale(range=(0.0, self._top))},
                axes=(uplot.Axis(), uplot.Axis()), legend=uplot.Legend(live=False))

    def show(self, samples: Sequence[tuple[float, ...]]) -> None:
        """Draw the samples, if they differ from those that are drawn."""
        rows = np.array(samples)
        if np.array_equal(rows, self._rows, equal_nan=True):
            return
        self._rows = rows
        largest = np.max(rows, initial=0.0, where=np.isfinite(rows))
        top = next((top for top in AXIS_ENDS if top >= largest), AXIS_ENDS[-1])
        if top > self._top:  # viser loses the other axis when a scale of a plot is changed
            self._top = top
            self._plot.remove()
            self._plot = self._add()
        else:
            # uPlot leaves the time axis away when new data come at exactly the same times.
            self._shift = TIME_SHIFT - self._shift
            times, *curves = _drawn(rows)
            self._plot.data = (times + self._shift, *curves)


def _drawn(rows: Array) -> tuple[Array, ...]:
    """Return times and curves, with nan far below the axis: uPlot would draw a line across it."""
    return TIMES, *np.ascontiguousarray(np.nan_to_num(rows, nan=OFF_CHART).T)
