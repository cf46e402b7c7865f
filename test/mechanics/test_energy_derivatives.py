# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The solver's moments and matrix are derivatives of an energy that was written separately."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import _kernel, Statics
from soft_continuum.mechanics.arm import Wrench
from soft_continuum.mechanics.laws import Jam, MomentCurvature
from soft_continuum.mechanics.plane.joints import tension_ratios
from support.energy_reference import Reference
from support.general_arms import arms, between, FEW, masks, paper_like

SOFT_TABLE = MomentCurvature((0.0, 1.0, 4.0), (0.0, 0.05, 0.3))
STIFF_TABLE = MomentCurvature((0.0, 0.7, 3.0), (0.0, 300.0, 900.0))
JAMS = st.sampled_from([Jam(), Jam(6.0), Jam(law=STIFF_TABLE)])


@st.composite
def points(draw):
    """Return (statics, reference, problem, joint angles, tensions) of no equilibrium at all."""
    arm = draw(arms(jam=JAMS, friction=True))
    arm = replace(
        arm, payload=0.05, wrenches=(Wrench(len(arm.segments), (0.4, 0.0, -0.3)),
                                   Wrench(draw(st.integers(0, 1)), (-0.2, 0.0, 0.1))),
        segments=tuple(replace(s, soft_law=SOFT_TABLE if draw(st.booleans()) else None)
                       for s in arm.segments))
    statics = Statics(arm)
    joints = statics.chain.bodies
    held = 0.2 * np.array([draw(between(-1.0, 1.0)) for _ in range(joints)])
    start = statics.chain.state(held)
    problem = statics.problem(start, draw(masks(arm)), np.zeros(2))
    free = problem.system.group >= 0
    moved = 0.3 * np.array([draw(between(-1.0, 1.0)) for _ in range(joints)])
    reference = Reference(arm, problem.stiff, held)
    angles = held + np.where(reference.free, moved, 0.0)
    assert free.any()
    tensions = np.array([draw(between(0.0, 20.0)), draw(between(0.0, 20.0))])
    return statics, reference, problem, angles, tensions


def onto_groups(problem, per_joint):
    """Return derivatives by the absolute angles of the rigid groups, from those by the joints."""
    group = problem.system.group
    lead = np.zeros((problem.groups, len(group)))
    for i, k in enumerate(group):  # a group that turns opens its first joint and shuts the next
        below = group[i - 1] if i > 0 else -1
        if k != below:
            lead[k, i] += 1.0
            if below >= 0:
                lead[below, i] -= 1.0
    return np.tensordot(lead, per_joint, axes=1), lead


def moment_balance(*arguments):
    return _kernel.functions().moment_balance(*arguments)


def dense_system(*arguments):
    return _kernel.functions().dense_system(*arguments)


def arguments(problem, angles, tensions, ratios):
    return (np.cumsum(angles), tensions, tuple(problem.system._replace(ratios=ratios)),
            problem.groups)


@FEW
@given(points())
def test_the_moment_balance_is_the_gradient_of_the_energy(case):
    statics, reference, problem, angles, tensions = case
    ones = np.ones((2, len(problem.stiff)))
    found = moment_balance(*arguments(problem, angles, tensions, ones))
    expected, _ = onto_groups(problem, reference.moments(angles, tensions))
    assert found == pytest.approx(expected, rel=1e-10, abs=1e-10)


@FEW
@given(points())
def test_the_matrix_is_the_hessian_of_the_energy(case):
    statics, reference, problem, angles, tensions = case
    ones = np.ones((2, len(problem.stiff)))
    hessian, force, reach = dense_system(*arguments(problem, angles, tensions, ones))
    _, lead = onto_groups(problem, angles)
    # Off the kinks of the tables; there the second derivative is one-sided.
    scale = max(1.0, np.abs(hessian).max())
    curved = lead @ reference.hessian(angles, tensions, step=1e-7) @ lead.T
    assert hessian == pytest.approx(hessian.T, abs=1e-10 * scale)
    assert hessian == pytest.approx(curved, abs=2e-6 * scale)
    gradients, _ = onto_groups(problem, reference.span_gradients(angles).sum(axis=2))
    assert force == pytest.approx(gradients, abs=1e-12)
    assert reach == pytest.approx(gradients, abs=1e-12)


@FEW
@given(points(), st.sampled_from([(1, 1), (1, -1), (-1, 0)]))
def test_with_friction_each_span_pulls_with_its_share_of_the_tension(case, sliding):
    statics, reference, problem, angles, tensions = case
    ratios = tension_ratios(statics.chain, angles, sliding)
    given_ = arguments(problem, angles, tensions, ratios)
    expected, _ = onto_groups(problem, reference.moments(angles, tensions, ratios))
    assert moment_balance(*given_) == pytest.approx(expected, rel=1e-10, abs=1e-10)
    _, force, reach = dense_system(*given_)
    gradients = reference.span_gradients(angles)
    shares, _ = onto_groups(problem, (gradients * ratios).sum(axis=2))
    lengths, _ = onto_groups(problem, gradients.sum(axis=2))
    assert force == pytest.approx(shares, abs=1e-12)
    assert reach == pytest.approx(lengths, abs=1e-12)


@FEW
@given(arms(), st.data())
def test_the_chains_own_energy_is_that_of_springs_weights_and_forces(arm, data):
    arm = replace(arm, payload=0.1, wrenches=(Wrench(len(arm.segments), (0.5, 0.0, -1.0)),))
    chain, reference = Statics(arm).chain, Reference(arm)
    angles = np.array([data.draw(between(-0.5, 0.5)) for _ in range(chain.bodies)])
    straight = np.zeros(chain.bodies)
    rise = reference.energy(angles) - reference.energy(straight)
    assert chain.energy(angles) - chain.energy(straight) == pytest.approx(rise, abs=1e-12)
    assert chain.energy(straight) == pytest.approx(0.0, abs=1e-15)
    assert chain.straight_paths - chain.paths(angles) == pytest.approx(
        reference.pulls(angles), abs=1e-13)


def test_beyond_its_limit_the_jam_adds_its_limit_and_no_stiffness():
    statics = Statics(paper_like(1, Jam(6.0, yield_moment=0.02), bodies=2))
    problem = statics.problem(statics.chain.straight(), (False,), np.zeros(2))
    angles, ones = np.array([0.1, -0.1, 0.0]), np.ones((2, 1))
    given_ = arguments(problem, angles, np.zeros(2), ones)
    spring = statics.chain.joint_stiffness[0]
    expected, lead = onto_groups(
        problem, spring * angles + 0.02 * np.sign(angles))
    assert moment_balance(*given_) == pytest.approx(expected)
    hessian, _, _ = dense_system(*given_)
    tangents = np.diag([spring, spring, 6.0 * spring])
    assert hessian == pytest.approx(lead @ tangents @ lead.T)
