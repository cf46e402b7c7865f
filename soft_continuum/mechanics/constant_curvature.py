# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Constant-curvature kinematics: every segment is an arc, loads are neglected (paper, III, [17]).

Webster and Jones, Design and Kinematic Modeling of Constant Curvature Continuum Robots: A Review,
Int. J. Robotics Research 29 (2010).  An arc is described by its rotation vector, here called
bending, (x, y) in rad about the axes of the disc below it.  Unlike arc parameters it is not
singular for a straight segment.
"""

from collections.abc import Sequence
from math import sin

import numpy as np
from numpy.typing import ArrayLike

from soft_continuum.mechanics._checks import is_number, real_array, soft_flags, whole
from soft_continuum.mechanics.arm import Arm, ArmError, Array

SMALL = 1e-3  # rad, for derivatives
DETERMINED = 1e-3  # least over largest singular value of pulls by bendings


def poses(arm: Arm, bending: ArrayLike) -> tuple[Array, Array]:
    """
    Return the poses of the discs for bending (segments, 2), rad.

    Returns the bottom and top centre of every disc, base first, (2 * discs, 3), m, and the
    orientation of every disc, (discs, 3, 3).  Bending (..., segments, 2) adds leading dimensions
    to both.  Raises ArmError for bending that does not match the arm.
    """
    bent = _checked(arm, bending)
    if not bent[..., 0].any():
        flat, headings = _about_y(arm, bent[..., 1])
        return flat, _turns_about_y(headings)
    many = bent.shape[:-2]
    turns, place, turn = _rotations(bent), np.zeros((*many, 3)), np.eye(3)
    arcs = _along(np.array([s.length for s in arm.segments]), bent)
    places, oriented = [], []
    for k, disc in enumerate(arm.discs):
        oriented.append(np.broadcast_to(turn, (*many, 3, 3)))
        places.append(place)
        place = place + disc.height * turn[..., 2]
        places.append(place)
        if k < len(arm.segments):
            place = place + (turn @ arcs[..., k, :, None])[..., 0]
            turn = turn @ turns[..., k, :, :]
    return np.stack(places, axis=-2), np.stack(oriented, axis=-3)


def tips(arm: Arm, bending: ArrayLike) -> tuple[Array, Array]:
    """Return position (..., 3), m, and orientation (..., 3, 3) of the tip."""
    bent = _checked(arm, bending)
    if not bent[..., 0].any():
        places, headings = _about_y(arm, bent[..., 1])
        return places[..., -1, :], _turns_about_y(headings[..., -1])
    places, turns = poses(arm, bent)
    return places[..., -1, :], turns[..., -1, :, :]


def pulls(arm: Arm, bending: ArrayLike) -> Array:
    """
    Return the pull (tendons,) m of every tendon for bending (segments, 2), rad.

    Tendons run straight from guide to guide, at the ends of a segment and at its spacers.
    Raises ArmError for bending that does not match the arm.
    """
    bent = _checked(arm, bending)
    if bent.ndim != 2:
        raise ArmError(f'one shape at a time; given: {bending!r}')
    places = arm.guide_places
    parts = np.linspace(0.0, 1.0, arm.spacers + 2)
    lengths = np.array([segment.length for segment in arm.segments])
    along = parts[:, None] * bent[:, None, :]  # (segments, guides, 2)
    angle = np.hypot(along[..., 0], along[..., 1])
    # Rodrigues' formula for guides with z = 0 and an axis in the plane of x and y.
    across = along[..., 0] * places[..., 1] - along[..., 1] * places[..., 0]
    once, twice = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi)**2
    guides = np.stack([
        places[..., 0] + twice * along[..., 1] * across,
        places[..., 1] - twice * along[..., 0] * across,
        once * across], axis=-1)
    guides += _along(lengths[:, None] * parts, along)
    straight = np.hypot(np.linalg.norm(np.diff(places, axis=2), axis=-1),
                        lengths[:, None] / (arm.spacers + 1))
    spans = np.linalg.norm(np.diff(guides, axis=2), axis=-1)
    found: Array = np.nansum(straight - spans, axis=(1, 2))
    return found


def bending(arm: Arm, pulls_of: ArrayLike, start: ArrayLike | None = None,
            soft: Sequence[bool] | None = None) -> Array:
    """
    Return the bending (segments, 2), rad, for given pulls.

    pulls_of: (tendons,) m, nan or -inf for a slack tendon.  start: bending (segments, 2), rad, to
    begin at, which stiff segments keep (default: straight).  soft: one flag per segment (default:
    all).  A segment bends only about axes of finite stiffness.  Inconsistent pulls are fitted by
    least squares; for a planar arm the result is the least bending that its tendons allow, and
    the middle where both are too short.

    Raises ArmError when the tendons do not determine the bending, ValueError for other sizes.
    """
    given = real_array(pulls_of, 'pulls must be numbers (m), or nan')
    if given.shape != (len(arm.tendons),):
        raise ValueError(f'pulls must be {len(arm.tendons)} numbers (m), one for each tendon')
    bent = np.zeros((len(arm.segments), 2)) if start is None else _checked(arm, start).copy()
    flags = soft_flags([True] * len(bent) if soft is None else soft, len(bent))
    given = np.where(np.isfinite(given), given, np.nan)
    if arm.planar:
        return _of_a_pair(arm, given, bent, flags)
    from scipy.optimize import least_squares  # 0.3 s that nodes that find none need not wait for

    free = arm.bending_axes & np.array(flags)[:, None]
    carries = np.isfinite(given)

    def left(some: Array) -> Array:
        bent[free] = some
        found: Array = (pulls(arm, bent) - given)[carries]
        return found

    unknown = int(free.sum())
    found = least_squares(
        left, bent[free], xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale=0.1, method='trf')
    values = np.linalg.svd(found.jac, compute_uv=False)
    if len(values) < unknown or values[-1] < DETERMINED * values[0]:
        raise ArmError(
            f'{int(carries.sum())} tendons do not determine {unknown} bendings; give the pulls of '
            'others, or make fewer segments soft')
    bent[free] = found.x
    return bent


def _of_a_pair(arm: Arm, given: Array, bent: Array, soft: Sequence[bool]) -> Array:
    """Return the least bending that a right and a left tendon allow; see ``bending``."""
    if sum(soft) != 1:
        raise ArmError('two tendons determine the bending of one soft segment; soft: '
                       f'{list(soft)}')
    index = list(soft).index(True)
    limit, bent[index] = arm.segments[index].bending_angle_limit, 0.0
    bounds = []
    for sign, pull, other in zip((1.0, -1.0), given, pulls(arm, bent).tolist(), strict=True):
        try:
            angle = -limit if np.isnan(pull) else bending_angle(arm, index, pull - other)
        except ArmError:  # paid out or pulled in beyond the limit
            angle = -limit if pull < other else limit
        bounds.append(sign * angle)
    least, most = bounds
    bent[index, 1] = np.clip(0.0, least, most) if least <= most else 0.5 * (least + most)
    return bent


def bending_angle(arm: Arm, segment: int, pull: float) -> float:
    """
    Return the angle (rad) at which the right tendon is ``pull`` m shorter in a segment (0-based).

    arm: planar.  Negative pulls (tendon paid out) give negative angles.  Raises ArmError when
    the pull exceeds the bending angle limit of the segment.
    """
    from scipy.optimize import brentq  # 0.3 s that nodes that find none need not wait for

    if not (whole(segment) and 0 <= segment < len(arm.segments) and is_number(pull)):
        raise ValueError(f'a segment, 0 to {len(arm.segments) - 1}, and a number (m) are needed; '
                         f'given: {segment!r}, {pull!r}')
    limit = arm.segments[segment].bending_angle_limit
    # At large angles the pull decreases again: use the monotonic range around zero.
    grid = np.linspace(-limit, limit, 721)
    rising = np.diff([_right_pull(arm, segment, a) for a in grid]) > 0.0
    turns = np.flatnonzero(~rising)
    least = grid[turns[turns < 360].max() + 1] if np.any(turns < 360) else -limit
    most = grid[turns[turns >= 360].min()] if np.any(turns >= 360) else limit
    low, high = _right_pull(arm, segment, least), _right_pull(arm, segment, most)
    if not low <= pull <= high:
        raise ArmError(
            f'a pull of {pull:g} m needs more than the bending angle limit of {limit:g} rad; '
            f'allowed: {low:.4g} to {high:.4g} m')
    return float(brentq(
        lambda a: _right_pull(arm, segment, a) - pull, least, most, xtol=1e-15, rtol=1e-14))


def chord(length: float, angle: float) -> float:
    """Return the chord in m of an arc of ``length`` m and ``angle`` rad."""
    half = angle / 2.0
    return length * (1.0 - half * half / 6.0 if abs(half) < 1e-4 else sin(half) / half)


def _right_pull(arm: Arm, segment: int, angle: float) -> float:
    """Return the shortening (m) of a planar arm's right tendon in one bent segment."""
    length = arm.segments[segment].length
    lower, upper = (arm.tendons[0].offset_at(segment, part) for part in (0.0, 1.0))
    # Seen along the chord both end planes are turned by half the angle, to opposite sides.
    across = (upper - lower) * np.cos(angle / 2.0)
    along = (upper + lower) * np.sin(angle / 2.0)
    return float(np.hypot(length, upper - lower)
                 - np.hypot(chord(length, angle) - along, across))


def _about_y(arm: Arm, angles: Array) -> tuple[Array, Array]:
    """Return ``poses`` of segments bent about y (..., segments), rad; the angle of each disc."""
    ends = np.insert(np.cumsum(angles, axis=-1), 0, 0.0, axis=-1)  # of every disc
    lengths = np.array([segment.length for segment in arm.segments])
    heights = np.array([disc.height for disc in arm.discs])
    steps = np.zeros((*angles.shape[:-1], 2 * len(heights), 2))  # to bottom and top of every disc
    for where, size, heading in (
            (slice(1, None, 2), heights, ends),
            (slice(2, None, 2), lengths * np.sinc(0.5 * angles / np.pi), ends[..., :-1]
             + 0.5 * angles)):
        steps[..., where, 0] = size * np.sin(heading)
        steps[..., where, 1] = size * np.cos(heading)
    places = np.zeros((*steps.shape[:-1], 3))
    places[..., ::2] = np.cumsum(steps, axis=-2)
    return places, ends


def _turns_about_y(angles: Array) -> Array:
    """Return the rotations (..., 3, 3) by angles (...), rad."""
    turns = np.zeros((*angles.shape, 3, 3))
    turns[..., 0, 0] = turns[..., 2, 2] = np.cos(angles)
    turns[..., 0, 2] = np.sin(angles)
    turns[..., 2, 0] = -turns[..., 0, 2]
    turns[..., 1, 1] = 1.0
    return turns


def _rotations(vectors: Array) -> Array:
    """Return the rotations (..., 3, 3) by rotation vectors about x and y (..., 2): Rodrigues."""
    angle = np.hypot(vectors[..., 0], vectors[..., 1])[..., None, None]
    cross = np.zeros((*vectors.shape[:-1], 3, 3))
    cross[..., 0, 2], cross[..., 2, 0] = vectors[..., 1], -vectors[..., 1]
    cross[..., 2, 1], cross[..., 1, 2] = vectors[..., 0], -vectors[..., 0]
    found: Array = (np.eye(3) + np.sinc(angle / np.pi) * cross
                    + 0.5 * np.sinc(0.5 * angle / np.pi)**2 * (cross @ cross))
    return found


def _along(lengths: Array, bend: Array) -> Array:
    """Return the ends (..., 3), m, of arcs of lengths (...), m, and bending (..., 2), rad."""
    angle = np.hypot(bend[..., 0], bend[..., 1])
    aside = 0.5 * np.sinc(0.5 * angle / np.pi)**2
    found: Array = lengths[..., None] * np.stack(
        [aside * bend[..., 1], -aside * bend[..., 0], np.sinc(angle / np.pi)], axis=-1)
    return found


def _checked(arm: Arm, bending_of: ArrayLike) -> Array:
    bent = real_array(bending_of, 'bending must be numbers (rad)')
    if bent.shape[-2:] != (len(arm.segments), 2) or not np.all(np.isfinite(bent)):
        raise ArmError(f'bending must be two finite numbers (rad), about x and y, for each of the '
                       f'{len(arm.segments)} segments; given: {bending_of!r}')
    return bent


def fully_actuated(arm: Arm) -> bool:
    """
    Return whether the tendons alone set the bending of each segment while all are soft.

    That is, their lengths determine all bendings; of a segment whose tendons lie in one plane,
    those in it.  Two tendons along three segments do not; without jamming such an arm bends as a
    whole.
    """
    rates = np.zeros((len(arm.segments), 2, len(arm.tendon_names)))
    for segment, axis in np.argwhere(arm.bending_axes):
        bending = np.zeros((len(arm.segments), 2))
        bending[segment, axis] = SMALL
        rates[segment, axis] = (pulls(arm, bending) - pulls(arm, -bending)) / (2.0 * SMALL)
    small = DETERMINED * np.abs(rates).max(initial=0.0)
    each = np.linalg.matrix_rank(rates, tol=small)
    together = np.linalg.matrix_rank(rates.reshape(-1, rates.shape[-1]), tol=small)
    return bool(each.all() and together == each.sum())
