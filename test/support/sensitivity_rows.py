# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""States and their derivatives as rows that can be compared."""

import numpy as np


def numbers(statics, state):
    """Return joint angles, tensions and tip pose in one row."""
    tip = state.points[-1]
    return np.concatenate([state.joint_angles, state.tensions, tip])


def hinges(sensitivity):
    """Return the derivatives of the joint angles of a planar arm, (joints, k)."""
    return np.diff(sensitivity.turned[:, 1], axis=0, prepend=0.0)


def column(sensitivity, k):
    """Return the derivatives of ``numbers`` by parameter k."""
    return np.concatenate([hinges(sensitivity)[:, k], sensitivity.tensions[:, k],
                           sensitivity.tip[[0, 2, 4], k]])
