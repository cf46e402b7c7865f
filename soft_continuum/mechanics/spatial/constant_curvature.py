# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Constant-curvature kinematics in space: every segment is an arc, loads are neglected.

Webster and Jones, Design and Kinematic Modeling of Constant Curvature Continuum Robots: A Review,
Int. J. Robotics Research 29 (2010).  As there, an arc is described by its rotation vector, here
called bending, (x, y) in rad about the axes of the disc below it: it has no direction that becomes
singular in the straight segment, as arc parameters have.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from soft_continuum.mechanics._checks import real_array, soft_flags
from soft_continuum.mechanics.arm import Arm, ArmError
from soft_continuum.mechanics.chain import Array

DETERMINED = 1e-3  # least over largest singular value of pulls by bendings


def poses(arm: Arm, bending: ArrayLike) -> tuple[Array, Array]:
    """
    Return where the discs of any arm are for bending (segments, 2), rad.

    Those are bottom and top centre of every disc, base first, (2 * discs, 3), m, and the
    orientation of every disc, (discs, 3, 3).  For many shapes (..., segments, 2) at once both
    have as many.  Raises ArmError for bending that is not that of the arm.
    """
    bent = _checked(arm, bending)
    many = bent.shape[:-2]
    turns, place, turn = _rotations(bent), np.zeros((*many, 3)), np.eye(3)
    places, oriented = [], []
    for k in range(len(arm.discs)):
        oriented.append(np.broadcast_to(turn, (*many, 3, 3)))
        places.append(place)
        place = place + arm.discs[k].height * turn[..., 2]
        places.append(place)
        if k < len(arm.segments):
            arc = _along_arc(arm.segments[k].length, np.ones(1), bent[..., k, :])
            place = place + (turn @ arc[..., 0, :, None])[..., 0]
            turn = turn @ turns[..., k, :, :]
    return np.stack(places, axis=-2), np.stack(oriented, axis=-3)


def pulls(arm: Arm, bending: ArrayLike) -> Array:
    """
    Return the pull (tendons,) m of every tendon for bending (segments, 2), rad.

    Tendons run straight from guide to guide: those at the ends of a segment, and its spacers.
    Raises ArmError for bending that is not that of the arm.
    """
    found = np.zeros(len(arm.tendons))
    bent = _checked(arm, bending)
    if bent.ndim != 2:
        raise ArmError(f'one shape at a time; given: {bending!r}')
    for segment, bend in enumerate(bent):
        found += segment_pulls(arm, segment, bend)
    return found


def segment_pulls(arm: Arm, segment: int, bend: ArrayLike) -> Array:
    """Return by how much each tendon shortens (tendons,), m, in one segment (0-based) bent so."""
    parts = np.linspace(0.0, 1.0, arm.spacers + 2)
    length = arm.segments[segment].length
    below = arm.discs[0].height + sum(
        s.length + d.height for s, d in zip(arm.segments[:segment], arm.discs[1:], strict=False))
    guides = np.zeros((len(arm.tendons), len(parts), 3))
    for t, tendon in enumerate(arm.tendons):
        if tendon.end > segment:
            angle = tendon.angle + tendon.twist * (below + parts * length)
            offset = np.array([tendon.offset_at(segment, part) for part in parts])
            guides[t, :, 0], guides[t, :, 1] = offset * np.cos(angle), offset * np.sin(angle)
    passes = np.array([tendon.end > segment for tendon in arm.tendons], dtype=bool)
    bent, straight = (
        np.diff(_guides_on_arc(length, parts, b, guides), axis=1)
        for b in (np.asarray(bend, dtype=float), np.zeros(2)))
    shorter = np.linalg.norm(straight, axis=2) - np.linalg.norm(bent, axis=2)
    return np.where(passes, shorter.sum(axis=1), 0.0)


def bending(arm: Arm, pulls_of: ArrayLike, start: ArrayLike | None = None,
            soft: Sequence[bool] | None = None) -> Array:
    """
    Return the bending (segments, 2), rad, that any number of tendons give with their pulls.

    pulls_of: (tendons,) m, nan for a tendon that is slack.  start: bending (segments, 2) rad to
    begin at, which segments that are not soft keep (default: straight).  soft: one flag per
    segment (default: all).  A segment bends only about axes of finite stiffness.  Where pulls do
    not fit together, the sum of the squares of what is left is least.

    Raises ArmError when the tendons do not determine the bending, ValueError for other sizes.
    """
    from scipy.optimize import least_squares  # 0.3 s that nodes that find none need not wait for

    given = real_array(pulls_of, 'pulls must be numbers (m), or nan')
    if given.shape != (len(arm.tendons),):
        raise ValueError(f'pulls must be {len(arm.tendons)} numbers (m), one for each tendon')
    bent = np.zeros((len(arm.segments), 2)) if start is None else _checked(arm, start).copy()
    flags = soft_flags([True] * len(bent) if soft is None else soft, len(bent))
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
            'others, or let fewer segments be soft')
    bent[free] = found.x
    return bent


def _rotations(vectors: Array) -> Array:
    """Return the rotations (..., 3, 3) by rotation vectors about x and y (..., 2): Rodrigues."""
    angle = np.hypot(vectors[..., 0], vectors[..., 1])[..., None, None]
    cross = np.zeros((*vectors.shape[:-1], 3, 3))
    cross[..., 0, 2], cross[..., 2, 0] = vectors[..., 1], -vectors[..., 1]
    cross[..., 2, 1], cross[..., 1, 2] = vectors[..., 0], -vectors[..., 0]
    found: Array = (np.eye(3) + np.sinc(angle / np.pi) * cross
                    + 0.5 * np.sinc(0.5 * angle / np.pi)**2 * (cross @ cross))
    return found


def _along_arc(length: float, parts: Array, bend: Array) -> Array:
    """Return points (..., n, 3), m, at parts (n,) along arcs (..., 2) that begin along z."""
    angle = parts * np.hypot(bend[..., 0], bend[..., 1])[..., None]
    aside = 0.5 * np.sinc(0.5 * angle / np.pi)**2 * parts
    found: Array = (length * parts)[:, None] * np.stack(
        [aside * bend[..., 1, None], -aside * bend[..., 0, None], np.sinc(angle / np.pi)], axis=-1)
    return found


def _guides_on_arc(length: float, parts: Array, bend: Array, guides: Array) -> Array:
    """Return guides (tendons, n, 3), m, of discs at parts (n,) along an arc."""
    turned = np.einsum('nij,tnj->tni', _rotations(parts[:, None] * bend), guides)
    found: Array = turned + _along_arc(length, parts, bend)
    return found


def _checked(arm: Arm, bending_of: ArrayLike) -> Array:
    bent = np.asarray(bending_of, dtype=float)
    if bent.shape[-2:] != (len(arm.segments), 2) or not np.all(np.isfinite(bent)):
        raise ArmError(f'bending must be two finite numbers (rad), about x and y, for each of the '
                       f'{len(arm.segments)} segments; given: {bending_of!r}')
    return bent
