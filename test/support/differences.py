# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Derivatives of equilibria beside differences of solves."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from soft_continuum.mechanics import Linearisation, Statics, Wrench
from support.spatial_arms import turns


def command(statics, state, sliding=()):
    """Return the pulls of the motors: those of the paths, and the stretch; slack paid out."""
    return np.where(state.tensions > 0.0, statics.commanded_pulls(state, sliding),
                    state.pulls - state.slack - 1e-3)


def changed(state, arm):
    """Return statics of another arm, and the state as one of it."""
    statics = Statics(arm)
    return statics, replace(state, chain=statics.chain)


def assert_is_difference(found, k, more, less, step, tolerance=2e-5):
    """Check column k of a sensitivity against the difference of two states."""
    for name, wanted in (
            ('points', more.poses[:, :3] - less.poses[:, :3]),
            ('tensions', more.tensions - less.tensions), ('bending', more.bending - less.bending),
            ('turned', turns(less.rotations, more.rotations)),
            ('paths', less.pulls - more.pulls)):
        wanted = wanted / (2.0 * step)
        scale = max(1e-3, np.abs(wanted).max())
        assert getattr(found, name)[..., k] == pytest.approx(wanted, abs=tolerance * scale), name


def assert_are_differences(statics, state, soft, sliding=(), tolerance=2e-5, step=1e-4):
    """Check all derivatives of a state, which loads and jams have, against differences."""
    arm, at = statics.chain.arm, command(statics, state, sliding)
    line = Linearisation(statics, state, sliding)
    segments, discs = len(arm.segments), len(arm.discs) - 1
    more = {'sliding': sliding, 'vacuum': state.vacuum or None}

    def check(found, k, make, step=step, unit=1.0):
        """Compare with the states of arms, pulls or held shapes that ``make`` returns."""
        ends = []
        for change in (step, -step):
            made, model, start, pulls = make(change), statics, state, at
            if isinstance(made, np.ndarray) and made.ndim == 1:
                pulls = at + made
            elif isinstance(made, np.ndarray):
                start = state.with_held(state.chain, made)
            else:
                model, start = changed(state, made)
            ends.append(model.solve(start, pulls, soft, **more))
        assert_is_difference(found, k, *ends, step * unit, tolerance)

    pulls = line.pulls()
    for t in range(len(at)):
        check(pulls, t, lambda d, t=t: d * np.eye(len(at))[t], 0.02 * step)
    check(line.payload(), 0, lambda d: replace(arm, payload=arm.payload + d))
    ways = (0, 2) if arm.planar else range(3)
    forces = line.forces()
    for disc in {1, discs}:
        for way in ways:
            def loaded(d, kind, disc=disc, way=way):
                load = Wrench(disc, **{kind: tuple(d * np.eye(3)[way])})
                return replace(arm, wrenches=(*arm.wrenches, load))

            check(forces, 3 * (disc - 1) + way, lambda d, of=loaded: of(d, 'force'))
            if not arm.planar:
                check(line.moments(), 3 * (disc - 1) + way, lambda d, of=loaded: of(d, 'moment'))
    ratios, held = line.stiffness_ratio(), line.held_shape()
    tables = any(segment.soft_law is not None for segment in arm.segments)
    factors = None if tables else (
        line.bending_stiffness() if arm.planar else line.stiffness_factors())
    for s, segment in enumerate(arm.segments):
        def with_segment(s=s, segment=segment, **changes):
            return replace(arm, segments=(
                *arm.segments[:s], replace(segment, **changes), *arm.segments[s + 1:]))

        if not tables:
            check(factors, s, lambda d, of=with_segment, one=segment: of(
                **{name: getattr(one, name) * (1.0 + d) for name in (
                    'stiffness_x', 'stiffness_y', 'torsional_stiffness')}),
                unit=segment.stiffness_y if arm.planar else 1.0)
        if segment.jam.law is None and segment.jam.ratio < inf:
            ratio = segment.jam.ratio
            check(ratios, s, lambda d, of=with_segment, one=segment.jam: of(
                jam=replace(one, ratio=one.ratio * (1.0 + d))), unit=ratio)
        else:
            for part in (ratios.turned, ratios.tensions):
                assert part[..., s] == pytest.approx(0.0, abs=1e-12)
        for axis in np.flatnonzero(arm.bending_axes[s]):
            one = np.zeros((segments, 2))
            one[s, axis] = 1.0
            check(held, 2 * s + axis, lambda d, one=one: d * one)
    if not tables:
        scale = [s.stiffness_y for s in arm.segments] if arm.planar else 1.0
        every = line.all()
        for part in ('turned', 'tensions', 'paths', 'tip'):
            parts = [getattr(one, part) for one in (held, factors, ratios, pulls, line.payload())]
            parts[1] = parts[1] * scale
            assert getattr(every, part) == pytest.approx(
                np.concatenate(parts, axis=-1), rel=1e-9, abs=1e-12)
