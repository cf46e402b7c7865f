# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The last minute of vacuum, tensions and measured errors: a small chart for each."""

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import groupby
from math import degrees, isfinite, nan

from soft_continuum.client.state import ArmState
from soft_continuum.colours import Colour, UNKNOWN

LENGTH = 301  # samples, one every 0.2 s: a minute
HEIGHT = 24  # px
ERROR_ENDS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0)  # mm or degrees
AXIS_ENDS = (10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)  # possible ends of an axis


class History:
    """
    Samples of a minute, the oldest first; nan where one is missing.

    vacuum: kPa.  tensions: N.  prediction: mm between the measured tip and the open-loop
    prediction.  error: of the shape being set, mm, or degrees while error_is_angle.
    """

    def __init__(self, segments: int, tendons: int, ambient_pressure: float) -> None:
        """Start empty; ambient_pressure: Pa."""
        self._ambient = ambient_pressure
        self.vacuum, self.tensions = (
            tuple(deque([nan] * LENGTH, maxlen=LENGTH) for _ in range(count))
            for count in (segments, tendons))
        self.prediction, self.error = (deque([nan] * LENGTH, maxlen=LENGTH) for _ in range(2))
        self.error_is_angle = True

    def sample(self, state: ArmState) -> None:
        """Take a sample, one every 0.2 s."""
        vacuum = [None if p is None else (self._ambient - p) * 1e-3 for p in state.pressures]
        _append(self.vacuum, vacuum)
        _append(self.tensions, state.tensions or ())
        estimate, progress = state.estimate, state.progress
        off = estimate.predicted_tip_error if estimate and estimate.measured else None
        error = progress.error if progress and progress.aim else None
        if error is not None and progress is not None:
            is_angle = progress.aim != 'tip'
            if is_angle is not self.error_is_angle:  # one axis has one unit
                self.error.extend([nan] * LENGTH)
                self.error_is_angle = is_angle
            error = degrees(error) if is_angle else 1e3 * error
        _append((self.prediction, self.error), (None if off is None else 1e3 * off, error))


def _append(series: Sequence[deque[float]], values: Sequence[float | None]) -> None:
    known = len(values) == len(series)
    for i, one in enumerate(series):
        value = values[i] if known else None
        one.append(nan if value is None or not isfinite(value) else value)


def axis_end(series: Iterable[Iterable[float]], ends: Sequence[float] = AXIS_ENDS) -> float:
    """Return the smallest of ``ends`` for an axis from 0 that fits all samples."""
    largest = max((v for one in series for v in one if isfinite(v)), default=0.0)
    return next((end for end in ends if end >= largest), ends[-1])


def chart(samples: Sequence[float], top: float, colour: Colour) -> str:
    """Return samples as an SVG, from 0 to ``top``; gaps (nan) are grey."""
    lines, gaps, start = [], [], 0
    for known, group in groupby(samples, isfinite):
        values = list(group)
        if known:
            lines.append('M' + 'L'.join(_corners(start, values, top)))
        else:
            gaps.append(f'M{start - 1} 0h{len(values) + 1}v{HEIGHT}h-{len(values) + 1}z')
        start += len(values)
    return (
        f'<svg viewBox="0 0 {LENGTH - 1} {HEIGHT}" preserveAspectRatio="none" width="100%" '
        f'height="{HEIGHT}" style="display:block;border-bottom:1px solid #99a">'
        f'<path class="gap" d="{"".join(gaps)}" fill="rgb{UNKNOWN}" fill-opacity="0.45"/>'
        f'<path class="line" d="{"".join(lines)}" fill="none" stroke="rgb{colour}" '
        'stroke-width="1.6" vector-effect="non-scaling-stroke"/></svg>')


def _corners(start: int, values: Sequence[float], top: float) -> list[str]:
    """Return the points of a line, without those between two points of equal height."""
    heights = [round(HEIGHT - 1 - (HEIGHT - 2) * min(1.0, max(0.0, v / top)), 1) for v in values]
    last = len(heights) - 1
    points = [f'{start + i} {y:g}' for i, y in enumerate(heights)
              if i in (0, last) or not heights[i - 1] == y == heights[i + 1]]
    return points if last else [points[0], f'{start + 0.5} {heights[0]:g}']
