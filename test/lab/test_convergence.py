# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The convergence analysis gives the paper's twelve bodies, and the same in space."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from soft_continuum.lab.analysis.convergence import converge, main
from soft_continuum.mechanics.arm import SECOND_ORDER
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.ros.description import load_description
from support import specimen_data as data
from support.spatial_arms import in_space
from support.two_rods import ARM

PAPER = arm_from_parameters(load_description()).without_gravity()
TENDON_ARM = Path(__file__).parents[2] / 'config' / 'tendon_arm.yaml'
ANGLES = [np.radians(36.0)] * 3


def test_without_gravity_the_arm_converges_at_twelve_bodies_with_ten_times_the_error():
    found = converge(PAPER, ANGLES, 1e-3, 16)
    assert found.converged == 12
    row = int(np.flatnonzero(found.bodies == 12)[0])
    assert found.angles[row] == pytest.approx(ANGLES)
    assert np.all(found.change[row] < 1e-3)
    assert found.change[row - 1].max() == pytest.approx(0.001051, abs=1e-6)
    assert found.error[10] == pytest.approx([0.0095, 0.0108, 0.0124], abs=1e-4)


def test_second_order_springs_converge_with_fewer_bodies_and_gravity_asks_for_one_more():
    second = replace(PAPER, discretisation=SECOND_ORDER)
    assert 2 <= converge(second, ANGLES, 1e-3, 16).converged < 8
    assert converge(data.DESCRIBED, ANGLES, 1e-3, 16).converged > 12


def test_an_analysis_that_ends_too_early_has_no_result():
    found = converge(PAPER, ANGLES, 1e-3, 12)
    assert found.converged is None
    assert np.all(np.isnan(found.change[-1]))


def test_a_planar_arm_converges_in_space_as_it_does_in_the_plane():
    angles = np.radians([36.0, 20.0, 36.0])
    one, other = (converge(arm, angles, 1e-3, 5) for arm in (PAPER, in_space(PAPER)))
    assert other.bodies.tolist() == one.bodies.tolist() == [2, 3, 4, 5]
    assert other.angles == pytest.approx(one.angles, rel=1e-6)
    assert other.error == pytest.approx(one.error, rel=1e-4)


def test_with_spacers_the_bodies_are_multiples_of_their_spans():
    found = converge(ARM.without_gravity(), (0.6, 0.6), 0.01, 16, jamming=False)
    assert found.bodies.tolist() == [4, 8, 12, 16]
    assert found.angles[0] == pytest.approx([0.6, 0.6], abs=1e-5)  # as the arm is described
    assert np.all(np.diff(found.error, axis=0) < 0.0)
    assert found.converged == 8


def test_too_few_bodies_to_compare_are_refused(capsys):
    assert main(['--params-file', str(TENDON_ARM), '--most', '19']) == 2
    assert 'multiples of 10, so up to 19 bodies' in capsys.readouterr().err
