# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Files as testing machines write them."""

from pathlib import Path

import numpy as np
import pytest

from soft_continuum.lab.analysis.curves import read_curves
from soft_continuum.lab.analysis.delimited import MeasurementError

SLOPE = 72.0  # N/m, the paper's
LENGTH, LEVER_ARM = 0.07, 0.025  # m


def ramp(largest=0.010, points=101):
    """Return displacements (m) of one way up."""
    return np.linspace(0.0, largest, points)


def noisy(slope, displacement, rng, stddev=0.002):
    """Return forces (N) of a linear segment with independent noise."""
    return slope * displacement + rng.normal(0.0, stddev, displacement.size)


def export(path, repetitions, header='displacement [mm],force [N]', delimiter=',', decimal='.',
           preamble=(), factors=(1e3, 1.0), encoding='utf-8'):
    """Write repetitions, pairs of displacement (m) and force (N), below one another."""
    lines = [*preamble, header]
    for displacement, force in repetitions:
        for u, f in zip(displacement, force, strict=True):
            cells = [f'{factors[0] * u:.9g}', f'{factors[1] * f:.9g}']
            lines.append(delimiter.join(cell.replace('.', decimal) for cell in cells))
    path.write_text('\n'.join(lines) + '\n', encoding=encoding)
    return path


def cantilever(law, force, length=LENGTH, lever_arm=LEVER_ARM, steps=2000):
    """Return displacements (m) of a clamped segment by summing its curvature over its length."""
    s = lever_arm + length * (np.arange(steps) + 0.5) / steps
    curvature = np.interp(np.multiply.outer(force, s), law.moments, law.curvatures)
    return (curvature * s).sum(axis=1) * length / steps


def read(text, *named, **given):
    """Return the curves of a file with this text, as read_curves finds them."""
    path = Path('a.csv')
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_curves([path], *named, **given)


def refused(message, text, *named, **given):
    """Check that the file is refused with what matches the message."""
    with pytest.raises(MeasurementError, match=message):
        read(text, *named, **given)
