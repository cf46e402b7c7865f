# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Derivatives of spatial equilibria are those of solves, and in the plane the planar ones."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.mechanics import Jam, Linearisation, Statics
from soft_continuum.mechanics.arm import mounted, Wrench
from soft_continuum.mechanics.space.sensitivity import SpaceLinearisation
from soft_continuum.mechanics.space.statics import SpaceStatics
from support import paper_arm as paper
from support.differences import assert_is_difference, changed, command
from support.spatial_arms import random_state, stretching, three_segments

SEEDS = range(8)


def test_friction_is_refused():
    arm = three_segments()
    arm = replace(arm, segments=(replace(arm.segments[0], friction=0.01), *arm.segments[1:]))
    statics = SpaceStatics(arm)
    with pytest.raises(ValueError, match='no friction'):
        SpaceLinearisation(statics, statics.chain.straight())


@pytest.mark.parametrize('seed', SEEDS)
def test_by_pulls(seed):
    statics, state, soft = random_state(seed)
    found, at, step = SpaceLinearisation(statics, state).pulls(), command(state), 1e-6
    for t in range(len(at)):
        more, less = (statics.solve(state, at + change * np.eye(len(at))[t], soft)
                      for change in (step, -step))
        assert_is_difference(found, t, more, less, step)


@pytest.mark.parametrize('stretch', [np.inf, 2000.0])
@pytest.mark.parametrize('sliding', [(1, -1, 1), (-1, 0, 1)])
def test_by_pulls_and_payload_where_tendons_rub(stretch, sliding):
    arm = three_segments(payload=0.05)
    arm = replace(arm, tendons=tuple(replace(
        tendon, friction=0.3, axial_stiffness=stretch, twist=3.0) for tendon in arm.tendons))
    statics, soft = SpaceStatics(arm), (True, False, True)
    state = statics.solve(statics.chain.straight(), (0.012, -0.003, 0.008), soft, sliding=sliding)
    at = statics.commanded_pulls(state, sliding) - state.slack
    line, step = SpaceLinearisation(statics, state, sliding), 1e-5
    for t in range(3):
        more, less = (statics.solve(state, at + change * np.eye(3)[t], soft, sliding=sliding)
                      for change in (step, -step))
        assert_is_difference(line.pulls(), t, more, less, step)
    more, less = (one.solve(start, at, soft, sliding=sliding) for one, start in (
        changed(state, replace(arm, payload=arm.payload + change)) for change in (1e-4, -1e-4)))
    assert_is_difference(line.payload(), 0, more, less, 1e-4)
    frictionless = SpaceLinearisation(statics, state).pulls()
    assert np.abs(line.pulls().tensions - frictionless.tensions).max() > 0.05 * np.abs(
        frictionless.tensions).max()  # it counts


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('which', ['all', 'first'])
def test_by_tensions(seed, which):
    statics, state, soft = random_state(seed)
    given = state.tensions + 0.1
    if which == 'first':
        given[1:] = np.nan
    state = statics.solve(state, command(state), soft, tensions=given)
    at = command(state)
    found, step = SpaceLinearisation(statics, state, tensions=given).tensions(), 1e-3
    for t in np.flatnonzero(np.isfinite(given)):
        more, less = (statics.solve(state, at, soft, tensions=given + change * np.eye(4)[t])
                      for change in (step, -step))
        assert_is_difference(found, t, more, less, step)
    assert not found.points[..., np.isnan(given)].any()


@pytest.mark.parametrize('seed', SEEDS)
def test_by_payload_forces_and_moments(seed):
    statics, state, soft = random_state(seed)
    arm, linear, step = statics.chain.arm, SpaceLinearisation(statics, state), 1e-4
    disc = len(arm.segments)

    def check(found, k, make):
        more, less = (start[0].solve(start[1], command(state), soft) for start in (
            changed(state, make(change)) for change in (step, -step)))
        assert_is_difference(found, k, more, less, step)

    check(linear.payload(), 0, lambda d: replace(arm, payload=arm.payload + d))
    forces, moments = linear.forces(), linear.moments()
    for way in range(3):
        one = np.eye(3)[way]
        for d in {1, disc}:
            k = 3 * (d - 1) + way
            check(forces, k, lambda x, d=d, one=one: replace(
                arm, wrenches=(*arm.wrenches, Wrench(d, tuple(x * one)))))
            check(moments, k, lambda x, d=d, one=one: replace(
                arm, wrenches=(*arm.wrenches, Wrench(d, moment=tuple(x * one)))))


@pytest.mark.parametrize('seed', SEEDS)
def test_by_stiffness_ratio_and_held_shape(seed):
    statics, state, soft = random_state(seed)
    arm, linear = statics.chain.arm, SpaceLinearisation(statics, state)
    factors, ratios, held = linear.stiffness_factors(), linear.stiffness_ratio(), \
        linear.held_shape()
    for s, segment in enumerate(arm.segments):
        def with_segment(one, s=s):
            return replace(arm, segments=(*arm.segments[:s], one, *arm.segments[s + 1:]))

        for found, step, make in (
                (factors, 1e-4, lambda f, one=segment: replace(
                    one, stiffness_x=one.stiffness_x * f, stiffness_y=one.stiffness_y * f,
                    torsional_stiffness=one.torsional_stiffness * f)),
                (ratios, 1e-3, lambda f, one=segment: replace(
                    one, jam=Jam(one.jam.ratio + f - 1.0)))):
            more, less = (start[0].solve(start[1], command(state), soft) for start in (
                changed(state, with_segment(make(f))) for f in (1.0 + step, 1.0 - step)))
            assert_is_difference(found, s, more, less, step)
        here = np.arange(statics.chain.bodies) // statics.chain.joints_per_segment == s
        for axis in (0, 1):
            turn = np.outer(here, np.eye(3)[axis]) / here.sum()
            more, less = (statics.solve(replace(state, held=state.held + d * turn),
                                        command(state), soft) for d in (1e-4, -1e-4))
            assert_is_difference(held, 2 * s + axis, more, less, 1e-4)


@pytest.mark.parametrize('jam', [Jam(), Jam(20.0)])
@pytest.mark.parametrize('pulls', [(0.006, -0.02), (-0.02, 0.004)])
def test_a_planar_arm_has_the_planar_derivatives(jam, pulls):
    flat = paper.build(bodies_per_segment=6)
    flat = replace(flat, gravity=mounted(0.4), segments=tuple(
        replace(s, jam=jam) for s in flat.segments))
    soft = (True, False, True)
    planar, solid = Statics(flat), SpaceStatics(flat)
    one = Linearisation(planar, planar.solve(planar.chain.straight(), pulls, soft))
    other = SpaceLinearisation(solid, solid.solve(solid.chain.straight(), pulls, soft))
    stiffness = np.array([s.stiffness_y for s in flat.segments])
    every, in_plane = slice(None), [0, 2, 3, 5, 6, 8]  # of forces along x, y, z
    pairs = [(one.pulls(), every, other.pulls(), every, 1.0),
             (one.payload(), every, other.payload(), every, 1.0),
             (one.forces(), in_plane, other.forces(), in_plane, 1.0),
             (one.bending_stiffness(), every, other.stiffness_factors(), every, stiffness),
             (one.held_shape(), [1, 3, 5], other.held_shape(), [1, 3, 5], 1.0)]
    if jam != Jam():
        pairs.append((one.stiffness_ratio(), every, other.stiffness_ratio(), every, 1.0))
    for wanted, of_wanted, found, of_found, unit in pairs:
        for name in ('tensions', 'paths', 'poses', 'bending'):
            assert getattr(found, name)[..., of_found] == pytest.approx(
                getattr(wanted, name)[..., of_wanted] * unit, rel=1e-8, abs=1e-8), name
        assert found.tip[[0, 2, 4]][:, of_found] == pytest.approx(
            wanted.tip[[0, 2, 4]][:, of_wanted] * unit, abs=1e-8)
        assert found.tip[[1, 3, 5]][:, of_found] == pytest.approx(0.0, abs=1e-8)


def test_a_load_cell_and_a_motor_are_reciprocal():
    """The tension of one tendon by the pull of another is that of the other by the one."""
    statics = SpaceStatics(three_segments(gravity=(3.0, 0.0, 9.0)))
    state = statics.solve(statics.chain.straight(), (0.006, 0.0045, -0.002), (True,) * 3)
    found = SpaceLinearisation(statics, state).pulls().tensions
    assert np.count_nonzero(state.tensions) >= 2
    assert found == pytest.approx(found.T, rel=1e-7)


def test_where_all_is_rigid_only_tendons_that_stretch_answer():
    statics = SpaceStatics(stretching(
        three_segments(tendons=3, gravity=(0.0, 0.0, 0.0)), (1e-4, 1e-4, 0.0)))
    state = statics.solve(statics.chain.straight(), (0.001, 0.002, -0.001), (False,) * 3)
    found = SpaceLinearisation(statics, state).pulls()
    assert found.tensions == pytest.approx(np.diag([1e4, 1e4, 0.0]))
    assert not found.points.any()


def test_a_state_of_another_arm_and_tensions_of_another_size_are_refused():
    statics = SpaceStatics(three_segments())
    with pytest.raises(ValueError, match='another arm'):
        SpaceLinearisation(statics, SpaceStatics(three_segments(turn=1.0)).chain.straight())
    with pytest.raises(ValueError, match='each of the 3 tendons'):
        SpaceLinearisation(statics, statics.chain.straight(), tensions=(1.0,))
