# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
How measured points change with what is not known of the arm, over all steps of a shape.

Linearisation (mechanics) differentiates one equilibrium.  A shape is a path of them: what a step
leaves behind, locked or held by jams, is where the next one starts.  Each step is differentiated
implicitly, and hands its derivatives on.  The balance of moments is written out here for complex
numbers, so that its derivatives by complex steps are exact to rounding.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from soft_continuum.analysis.measured_shapes import sliding, Step
from soft_continuum.mechanics.chain import Array, Equilibrium, RigidChain
from soft_continuum.mechanics.joints import HELD, JAM, SOFT
from soft_continuum.mechanics.statics import Statics

COMPLEX_STEP = 1e-30
DIFFERENCE = 1e-5  # of a parameter's scale: the coefficients are linear in most and smooth in all


@dataclass(frozen=True, eq=False)
class _Coefficients:
    """What the balance depends on besides the state: all that unknowns can change."""

    springs: Array
    jams: Array
    loads: Array
    guides: Array
    friction: Array
    straight_length: Array
    compliance: Array


def _coefficients(models: Sequence[Statics], start: Equilibrium, stiff: Sequence[bool]
                  ) -> _Coefficients:
    """Return those of several arms, along the first axis of each."""
    rows = []
    for statics in models:
        joints, chain = statics.laws.joints(start, stiff, None), statics.chain
        rows.append((joints[:, SOFT], joints[:, JAM], chain.load_coefficients, chain.guides,
                     chain.arm.tendon.friction, chain.straight_length, statics.compliance))
    return _Coefficients(*map(np.array, zip(*rows, strict=True)))


def _balance(chain: RigidChain, c: _Coefficients, directions: Sequence[int], angles: Any,
             tensions: Any, held: Any) -> Any:
    """
    Return moments on the joints and excess of the tendons' lengths, (rows, joints + 2).

    angles, held: (states, joints) rad, tensions: (states, 2) N; real or complex.  Rows are those
    of one arm in several states, or of several arms in one state.
    """
    per, segments = chain.joints_per_segment, chain.segments
    theta = np.cumsum(angles, axis=-1)
    turning = c.loads[..., 0] * np.cos(theta) - c.loads[..., 1] * np.sin(theta)
    moments = c.springs * angles + c.jams * (angles - held) + _from_tip(turning)
    local = np.cumsum(angles.reshape(-1, segments, per), axis=-1)  # against the disc below
    bodies, disc = local[..., :-1], local[..., -1]
    lengths = chain.body_lengths.reshape(segments, per)[:, :-1]
    along_x, along_z = lengths * np.sin(bodies), lengths * np.cos(bodies)
    lower, upper = c.guides[..., 0], c.guides[..., 1]
    excess = []
    for tendon, side in enumerate((1.0, -1.0)):
        x = along_x.sum(axis=-1) + side * (upper * np.cos(disc) - lower)
        z = along_z.sum(axis=-1) - side * upper * np.sin(disc)
        span = np.sqrt(x * x + z * z)
        # What a joint turns: the bodies from it on, and the guide on the upper disc.
        last = np.zeros((*disc.shape, 1))
        dx = (_from_tip(np.concatenate([along_z, last], axis=-1))
              - (side * upper * np.sin(disc))[..., None])
        dz = (-_from_tip(np.concatenate([along_x, last], axis=-1))
              - (side * upper * np.cos(disc))[..., None])
        pull = (x[..., None] * dx + z[..., None] * dz) / span[..., None]
        if c.friction.any() and directions[tendon]:
            kept = _kept(chain, c, side, directions[tendon], x, z, disc)
        else:
            kept = np.ones(segments)
        force = tensions[:, tendon, None] * kept
        moments = moments + (force[..., None] * pull).reshape(moments.shape)
        excess.append(span.sum(axis=-1) - c.straight_length
                      - c.compliance[:, tendon] * tensions[:, tendon])
    return np.concatenate([moments, np.stack(excess, axis=-1)], axis=-1)


def _from_tip(values: Any) -> Any:
    """Return the sum of each value and all after it, along the last axis."""
    return np.cumsum(values[..., ::-1], axis=-1)[..., ::-1]


def _kept(chain: RigidChain, c: _Coefficients, side: float, direction: int, x: Any, z: Any,
          disc: Any) -> Any:
    """Return the tension in each span over that at the base, by Capstan (..., segments)."""
    heights = np.array([d.height for d in chain.arm.discs])
    # Headings of the spans, and of the rope inside the disc below each, against that disc.
    inside = np.arctan(side * (c.guides[:, 1:, 0] - c.guides[:, :-1, 1]) / heights[1:-1])
    inside = np.concatenate([np.zeros((len(inside), 1)), inside], axis=-1)
    span = np.arctan(x / z)
    into = _size(span - inside)  # at the lower guide of each segment
    out = _size(inside[:, 1:] + disc[..., :-1] - span[..., :-1])  # at its upper guide
    first = np.zeros((*x.shape[:-1], 1))
    wrapped = np.cumsum(into, axis=-1) + np.concatenate(
        [first, np.cumsum(out, axis=-1)], axis=-1)
    return np.exp(-c.friction[:, None] * direction * wrapped)


def _size(value: Any) -> Any:
    return value * np.where(np.real(value) < 0.0, -1.0, 1.0)


def derivatives_of_points(
        statics_at: Callable[[Array], Statics], values: Array, scales: Array,
        steps: Sequence[Step], states: Sequence[Equilibrium]) -> Array:
    """
    Return derivatives of a shape's calculation points by the unknowns, (2 * discs, 2, k), m.

    statics_at: of the arm with values (k,) for its unknowns.  scales: (k,) of a change of each
    that is small.  states: the equilibrium after each step, as ``simulate_steps`` returns them.  A
    slack tendon is taken to stay slack and a taut one taut.
    """
    statics = statics_at(values)
    beside = [(statics_at(values + h), statics_at(values - h))
              for h in np.diag(DIFFERENCE * scales)]
    chain = statics.chain
    turned = np.zeros((chain.joints, len(values)))
    held = np.zeros_like(turned)
    start = chain.straight()
    for step, state in zip(steps, states, strict=True):
        turned, held = _step(statics, beside, scales, start, step, state, turned, held)
        start = state
    theta = np.cumsum(states[-1].joint_angles)
    swept = np.cumsum(turned, axis=0)
    lengths = chain.body_lengths[:, None]
    ends = np.zeros((chain.joints + 1, 2, len(values)))
    ends[1:, 0] = np.cumsum(lengths * np.cos(theta)[:, None] * swept, axis=0)
    ends[1:, 1] = np.cumsum(-lengths * np.sin(theta)[:, None] * swept, axis=0)
    derivatives = np.zeros((2 * chain.segments + 2, 2, len(values)))
    derivatives[2::2], derivatives[3::2] = ends[chain.last_joint], ends[chain.last_joint + 1]
    return derivatives


def _step(statics: Statics, beside: Sequence[tuple[Statics, Statics]], scales: Array,
          start: Equilibrium, step: Step, state: Equilibrium, turned: Array, held: Array
          ) -> tuple[Array, Array]:
    """Return the derivatives of joint angles and held angles after a step, (joints, k)."""
    chain, stiff = statics.chain, state.stiff
    per, count = chain.joints_per_segment, chain.joints
    directions = sliding(start, step)
    # A jam holds the shape that its segment had when it was last soft.
    was_soft = np.repeat([not s for s in start.stiff], per)
    held = np.where(was_soft[:, None], turned, held)
    locked = np.repeat([s and segment.jam.rigid for s, segment in
                        zip(stiff, chain.arm.segments, strict=True)], per)
    taut = np.nan_to_num(state.tensions) > 0.0
    free = np.concatenate([~locked, taut])
    here = np.concatenate([state.joint_angles, np.nan_to_num(state.tensions)])
    joints = statics.laws.joints(start, stiff, None)

    def balance(models: Sequence[Statics], at: Any) -> Any:
        return _balance(chain, _coefficients(models, start, stiff), directions,
                        at[:, :count], at[:, count:], joints[:, HELD])

    matrix = balance([statics], here + 1j * COMPLEX_STEP * np.eye(len(here))).imag.T / COMPLEX_STEP
    more, less = (balance(models, here[None]) for models in zip(*beside, strict=True))
    right_side = (more - less).T / (2.0 * DIFFERENCE * scales)
    right_side += matrix[:, :count][:, locked] @ turned[locked]
    right_side[:count] -= joints[:, JAM, None] * held
    moved = np.linalg.solve(matrix[free][:, free], -right_side[free])
    turned = turned.copy()
    turned[~locked] = moved[:int((~locked).sum())]
    return turned, held
