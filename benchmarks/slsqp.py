# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The same minimum of the energy, found by scipy's general-purpose SLSQP."""

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.plane.chain import PlaneChain


def solver(chain: PlaneChain, start: Array, pull: float) -> Callable[[], Array]:
    """
    Return a call that finds the joint angles of a weightless arm for one right pull (m).

    start: joint angles (joints,) rad.
    """
    stiffness = chain.joint_stiffness
    scale = 1.0 / stiffness.mean()
    length = chain.straight_paths[0] - pull
    segments, joints = chain.segments, chain.joints_per_segment
    bodies = chain.body_lengths.reshape(segments, joints).copy()
    bodies[:, -1] = 0.0  # the discs are no part of a span
    lower, upper = chain.guides.T

    def spans(q: Array) -> tuple[Array, Array, Array, Array]:
        theta = np.cumsum(q)
        sine, cosine = np.sin(theta).reshape(segments, -1), np.cos(theta).reshape(segments, -1)
        below_sine, below_cosine = np.append(0.0, sine[:-1, -1]), np.append(1.0, cosine[:-1, -1])
        x = (bodies * sine).sum(axis=1) + upper * cosine[:, -1] - lower * below_cosine
        z = (bodies * cosine).sum(axis=1) - upper * sine[:, -1] + lower * below_sine
        return x, z, sine, cosine

    def room(q: Array) -> float:
        x, z, _, _ = spans(q)
        return float(10.0 * (length - np.hypot(x, z).sum()))

    def room_gradient(q: Array) -> Array:
        x, z, sine, cosine = spans(q)
        span = np.hypot(x, z)
        ux, uz = (x / span)[:, None], (z / span)[:, None]
        by_theta = bodies * (ux * cosine - uz * sine)
        by_theta[:, -1] -= upper * (ux[:, 0] * sine[:, -1] + uz[:, 0] * cosine[:, -1])
        by_theta[:-1, -1] += lower[1:] * (ux[1:, 0] * sine[:-1, -1] + uz[1:, 0] * cosine[:-1, -1])
        return -10.0 * np.cumsum(by_theta.ravel()[::-1])[::-1]

    constraint = {'type': 'ineq', 'fun': room, 'jac': room_gradient}

    def run() -> Array:
        found = minimize(
            lambda q: 0.5 * scale * float(stiffness @ q**2), start, method='SLSQP',
            jac=lambda q: scale * stiffness * q, constraints=[constraint],
            options={'ftol': 1e-16, 'maxiter': 1000})
        return np.asarray(found.x)

    return run
