# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The convergence analysis gives the paper's twelve bodies."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.analysis.convergence import converge
from soft_continuum.mechanics.arm import SECOND_ORDER
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.parameters.files import load_description
from support import specimen_data as data

PAPER = arm_from_parameters(load_description()).without_gravity()
ANGLES = [np.radians(36.0)] * 3


def test_without_gravity_the_arm_converges_at_twelve_bodies():
    found = converge(PAPER, ANGLES, 1e-3, 16)
    assert found.converged == 12
    row = int(np.flatnonzero(found.bodies == 12)[0])
    assert found.angles[row] == pytest.approx(ANGLES)
    assert np.all(found.change[row] < 1e-3)
    assert found.change[row - 1].max() == pytest.approx(0.001051, abs=1e-6)


def test_the_error_is_ten_times_the_change():
    found = converge(PAPER, ANGLES, 1e-3, 16)
    assert found.error[10] == pytest.approx([0.0095, 0.0108, 0.0124], abs=1e-4)


def test_second_order_springs_converge_with_fewer_bodies():
    found = converge(replace(PAPER, discretisation=SECOND_ORDER), ANGLES, 1e-3, 16)
    assert found.converged is not None
    assert found.converged < 8


def test_gravity_asks_for_one_body_more():
    assert converge(data.DESCRIBED, ANGLES, 1e-3, 16).converged > 12


def test_an_analysis_that_ends_too_early_has_no_result():
    found = converge(PAPER, ANGLES, 1e-3, 12)
    assert found.converged is None
    assert np.all(np.isnan(found.change[-1]))
