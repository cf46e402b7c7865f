# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from soft_continuum.sequencing.timing import monotone_cubic


@pytest.mark.parametrize('points', [2, 3, 9])
@pytest.mark.parametrize('kind', ['any', 'rising', 'level in places'])
def test_the_monotone_cubic_is_that_of_scipy(points: int, kind: str) -> None:
    random = np.random.default_rng(points)
    for _ in range(20):
        x = np.cumsum(random.uniform(1e-3, 2.0, points))
        y = random.normal(size=(points, 2))
        if kind != 'any':
            y = np.cumsum(np.abs(y), axis=0)
        if kind == 'level in places':
            y[1] = y[0]
        at = np.linspace(x[0], x[-1], 40)
        assert monotone_cubic(x, y)(at) == pytest.approx(PchipInterpolator(x, y)(at), abs=1e-12)
