# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Derivatives in space beside differences of solves."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.mechanics.space.statics import SpaceStatics
from support.spatial_arms import turns


def command(state):
    """Return the pulls of the motors: those of the paths, and the stretch; slack paid out."""
    return state.pulls + state.chain.arm.compliance * state.tensions - np.where(
        state.tensions > 0.0, 0.0, state.slack + 1e-3)


def changed(state, arm):
    """Return statics of another arm, and the state as one of it."""
    statics = SpaceStatics(arm)
    return statics, replace(state, chain=statics.chain)


def assert_is_difference(found, k, more, less, step, tolerance=2e-5):
    """Check column k of a sensitivity against the difference of two states."""
    for name in ('points', 'tensions', 'bending'):
        wanted = (getattr(more, name) - getattr(less, name)) / (2.0 * step)
        scale = max(1e-3, np.abs(wanted).max())
        assert getattr(found, name)[..., k] == pytest.approx(wanted, abs=tolerance * scale), name
    wanted = turns(less.rotations, more.rotations) / (2.0 * step)
    scale = max(1e-3, np.abs(wanted).max())
    assert found.turned[..., k] == pytest.approx(wanted, abs=tolerance * scale)
    wanted = -(more.pulls - less.pulls) / (2.0 * step)
    assert found.paths[..., k] == pytest.approx(
        wanted, abs=tolerance * max(1e-3, np.abs(wanted).max()))
