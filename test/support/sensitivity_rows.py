# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""States and their derivatives as rows that can be compared."""

import numpy as np


def numbers(statics, state):
    """Return joint angles, tensions and tip pose in one row."""
    tip = statics.chain.points(state.joint_angles)[-1]
    return np.concatenate([state.joint_angles, state.tensions, tip])


def column(sensitivity, k):
    """Return the derivatives of ``numbers`` by parameter k."""
    return np.concatenate([sensitivity.joint_angles[:, k], sensitivity.tensions[:, k],
                           sensitivity.tip[:, k]])
