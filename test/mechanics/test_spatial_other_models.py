# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The example arm of tdcr-modeling, whose rod was solved by shooting between its discs."""

import numpy as np
import pytest

from benchmarks.tdcr import ALL_FORCE, LOADS, MODELS, state


@pytest.mark.parametrize('load', [0, 1])
def test_a_chain_converges_to_a_cosserat_rod_between_discs(load):
    reference = np.array(MODELS[ALL_FORCE][load])
    away = [np.linalg.norm(state(bodies, LOADS[load], True).tip - reference)
            for bodies in (2, 4, 8)]
    assert away[0] > 3.0 * away[1] > 9.0 * away[2]
    assert away[2] < 2e-4


def test_a_spacer_converges_to_a_disc():
    away = [np.linalg.norm(state(bodies, LOADS[1]).tip - MODELS[ALL_FORCE][1])
            for bodies in (2, 5, 10)]
    assert away[0] > 2.0 * away[1] > 3.0 * away[2]
