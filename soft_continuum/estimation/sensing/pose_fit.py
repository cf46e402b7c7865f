# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The pose of a body with tags in the frame of a camera, from all their corners at once.

Generalised least squares: an offset of a tag on its body moves its four corners together, so their
covariance is that of single corners plus that of the stated deviation of the tag
(Hartley and Zisserman, Multiple View Geometry, 2nd edition, chapter 5).  Each tag gives two
initial poses, and each may lead to a different minimum.  A body that moves in a plane is fitted
within it: tilt and depth of a single tag are poorly measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from soft_continuum.estimation.sensing.layout import CORNERS, Tag
from soft_continuum.estimation.sensing.lens import Lens
from soft_continuum.estimation.sensing.pictures import Array
from soft_continuum.mechanics.arm import SPATIAL_AXES
from soft_continuum.mechanics.orientations import cross_matrices, matrices, quaternions

CORNER_DEVIATION = 0.1  # px, of each corner of a tag
FULL_WIDTH = 32.0  # px of such a tag
ITERATIONS, HALVINGS = 20, 6
DONE = 1e-7  # m and rad: a smaller step is the last one
SAME, NEAR = 0.01, 0.05  # rad between two poses that are, or lead to, one minimum


@dataclass(frozen=True)
class PoseFit:
    """
    A minimum: pose of the body in the frame of the camera (x right, y down, z forward).

    turn: (3, 3).  shift: (3,) m.  focal: focal length over the calibrated one.  covariance: (7, 7)
    of shift (m) and of a rotation vector (rad) in the axes of the camera, about the origin of the
    body, and of the focal length (relative), by corners and tags; 0 for what was not fitted.
    response: (7, 7), change of the fit per change of what is seen, as by these seven.  misfit: sum
    of squares over their covariance.  freedom: corners less unknowns.  residual: px, RMS of
    each coordinate.
    """

    turn: Array
    shift: Array
    focal: float
    covariance: Array
    response: Array
    misfit: float
    freedom: int
    residual: float


class TagGroup:
    """Tags of one body, and their positions in an image."""

    def __init__(self, tags: Sequence[Tag], pixels: Sequence[Array], lens: Lens,
                 focal: float = 1.0, focal_stddev: float = 0.0, base: PoseFit | None = None,
                 axes: NDArray[np.bool_] = SPATIAL_AXES, deviation: float = CORNER_DEVIATION,
                 full_width: float = FULL_WIDTH) -> None:
        """
        Take corners (4, 2) px without distortion.

        focal: focal length over the calibrated one.  focal_stddev: of that; 0: not fitted.
        axes: (6,), along and about which axes of ``base`` the body may be displaced from it.
        deviation: px, of each corner of a tag of ``full_width`` px; those of a narrower one are
        worse by the square.
        """
        self._tags, self._lens = tags, lens
        self._pixels = np.array(pixels)
        self._points = np.array([tag.corners for tag in tags])
        self._centres = np.array([tag.centre for tag in tags])
        self._axes = np.array([tag.axes.T for tag in tags])
        self._spreads = np.array([tag.spread for tag in tags])
        widths = np.array([width(corners) for corners in self._pixels])
        noise = deviation * np.maximum(1.0, full_width / widths)**2
        self._noise = noise[:, None, None]**2 * np.eye(8)
        self._focal, self._given = np.diag(lens.matrix)[:2], focal
        self._base, self._moves = base, axes
        turn = np.eye(3) if base is None else base.turn
        every = np.eye(7)
        every[:3, :3] = every[3:6, 3:6] = turn
        self._free = every[:, [*axes, focal_stddev > 0.0]]
        """(7, n), shift, rotation vector and focal length per unknown."""
        self._stiff = 1.0 / focal_stddev**2 if focal_stddev else 0.0
        self._last: _Guess | None = None

    def fits(self) -> list[PoseFit]:
        """Return the minima that were found, the best first; none if no tag fits."""
        found: list[tuple[float, _Guess]] = []
        for start in self._starts():
            if any(angle(start.turn, g.turn) < NEAR for _, g in found):
                continue
            misfit, guess = self._refined(start)
            if np.isfinite(misfit) and all(angle(guess.turn, g.turn) > SAME for _, g in found):
                found.append((misfit, guess))
        return [self._fit(*minimum) for minimum in sorted(found, key=lambda one: one[0])]

    def size_factor(self, fit: PoseFit) -> float:
        """Return the measured size of the tags, from their distances, over the stated one."""
        guess = _Guess(fit.turn, fit.shift, fit.focal)
        places = self._points @ fit.turn.T + fit.shift
        errors, jacobian, weights = self._system(guess)
        by_size = (self._jacobian(places, fit.focal) @ (
            (self._points - self._centres[:, None]) @ fit.turn.T)[..., None])[..., 0]
        columns = np.concatenate([jacobian[..., :6], by_size.reshape(len(jacobian), 8, 1)], axis=2)
        return 1.0 + float(_solved(*_normal(columns, weights, errors))[6])

    def placed(self, fit: PoseFit) -> list[Tag]:
        """Return the tags with their most likely offsets, given the pose of the body."""
        guess, found = _Guess(fit.turn, fit.shift, fit.focal), []
        errors, _, _ = self._system(guess)
        arms = self._points @ fit.turn.T
        by_tag = self._by_tag(fit.turn, arms, self._jacobian(arms + fit.shift, fit.focal))
        for tag, error, moves, noise in zip(
                self._tags, errors, by_tag @ self._spreads, self._noise, strict=True):
            weighted = np.linalg.solve(noise, moves).T
            covariance = np.linalg.inv(np.eye(6) + weighted @ moves)
            step = tag.spread @ covariance @ weighted @ error
            found.append(tag.moved(step[:3], step[3:],
                                   tag.spread @ np.linalg.cholesky(covariance)))
        return found

    def _starts(self) -> 'list[_Guess]':
        """Return the poses of the body that each tag alone gives: two, one in a plane."""
        found, poses = [], 2 if self._moves.all() else 1
        for tag, pixels in zip(self._tags, self._pixels, strict=True):
            square = np.column_stack([tag.size * CORNERS, np.zeros(4)])  # as OpenCV wants them
            _, vectors, shifts, _ = cv2.solvePnPGeneric(
                square, pixels, self._lens.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
            solved = [(vector, shift) for vector, shift in zip(vectors, shifts, strict=True)
                      if np.isfinite(vector).all() and np.isfinite(shift).all()]
            for vector, shift in solved[:poses]:
                turn = cv2.Rodrigues(vector)[0] @ tag.axes
                found.append(self._allowed(turn, shift.ravel() - turn @ tag.centre))
        return found

    def _allowed(self, turn: Array, shift: Array) -> '_Guess':
        """Return a pose that the body can have, near another one."""
        if (base := self._base) is not None and not self._moves.all():
            place = self._moves[:3] * (base.turn.T @ (shift - base.shift))
            turned = quaternions((base.turn.T @ turn)[None]) * [*self._moves[3:], True]
            turn = base.turn @ matrices(turned / np.linalg.norm(turned))[0]
            shift = base.turn @ place + base.shift
        return _Guess(turn, shift, self._given)

    def _refined(self, guess: '_Guess') -> 'tuple[float, _Guess]':
        """Return the misfit and the minimum reached from a start; infinite for none."""
        misfit = self._misfit(guess)
        for _ in range(ITERATIONS):
            if not np.isfinite(misfit):
                break
            step = self._step(guess)
            if np.abs(step).max() < DONE:
                return misfit, guess.moved(step)
            for _ in range(HALVINGS):
                moved = guess.moved(step)
                after = self._misfit(moved)
                if after <= misfit:
                    break
                step = step / 2.0
            else:
                break
            guess, misfit = moved, after
        return misfit, guess

    def _fit(self, misfit: float, guess: '_Guess') -> PoseFit:
        errors, jacobian, weights = self._system(guess)
        free, matrix = self._free, self._normal(guess)[0]
        covariance = free @ np.linalg.inv(free.T @ matrix @ free) @ free.T
        return PoseFit(guess.turn, guess.shift, guess.focal, covariance, covariance @ matrix,
                       misfit, errors.size - int(self._moves.sum()),
                       float(np.sqrt(np.mean(errors**2))))

    def _step(self, guess: '_Guess') -> Array:
        """Return the Gauss-Newton step (7,) of what is free."""
        free, (matrix, pull) = self._free, self._normal(guess)
        step: Array = free @ _solved(free.T @ matrix @ free, free.T @ pull)
        return step

    def _normal(self, guess: '_Guess') -> tuple[Array, Array]:
        """Return matrix (7, 7) and right-hand side of the normal equations."""
        errors, jacobian, weights = self._system(guess)
        matrix, pull = _normal(jacobian, weights, errors)
        matrix[6, 6] += self._stiff
        pull[6] += self._stiff * np.log(self._given / guess.focal)
        return matrix, pull

    def _misfit(self, guess: '_Guess') -> float:
        """Return the sum of squares over their covariance; infinite behind the camera."""
        if (self._points @ guess.turn[2] + guess.shift[2]).min() <= 0.0:
            return np.inf
        errors, _, weights = self._system(guess)
        return float(np.einsum('ki,kij,kj->', errors, weights, errors)
                     + self._stiff * np.log(self._given / guess.focal)**2)

    def _system(self, guess: '_Guess') -> tuple[Array, Array, Array]:
        """
        Return errors (tags, 8) px, their Jacobian (tags, 8, 7) by the guess, and weights.

        The seventh column is for the logarithm of the focal length.
        """
        if guess is not self._last:  # a guess that fits better is where the next step begins
            self._last, self._found = guess, self._find_system(guess)
        return self._found

    def _find_system(self, guess: '_Guess') -> tuple[Array, Array, Array]:
        turn = guess.turn
        arms = self._points @ turn.T
        places = arms + guess.shift
        seen = places[..., :2] / places[..., 2:] * self._focal * guess.focal
        jacobian = self._jacobian(places, guess.focal)
        by_pose = _moved(jacobian, np.broadcast_to(np.eye(3), (len(arms), 3, 3)), arms)
        spread = self._by_tag(turn, arms, jacobian) @ self._spreads
        weights = np.asarray(np.linalg.inv(
            self._noise + spread @ spread.transpose(0, 2, 1)), dtype=float)
        errors: Array = (self._pixels - self._lens.matrix[:2, 2] - seen).reshape(-1, 8)
        by_all: Array = np.concatenate([by_pose, seen.reshape(-1, 8, 1)], axis=2)
        return errors, by_all, weights

    def _by_tag(self, turn: Array, arms: Array, jacobian: Array) -> Array:
        """Return the Jacobian of pixels by motions of each tag along its axes, (tags, 8, 6)."""
        return _moved(jacobian, turn @ self._axes, arms - (self._centres @ turn.T)[:, None])

    def _jacobian(self, places: Array, focal: float) -> Array:
        """Return the Jacobian of pixels by points (tags, 4, 3) in the camera, (tags, 4, 2, 3)."""
        jacobian = np.zeros((*places.shape[:2], 2, 3))
        scale = focal * self._focal / places[..., 2:]
        jacobian[..., 0, 0], jacobian[..., 1, 1] = scale[..., 0], scale[..., 1]
        jacobian[..., 2] = -scale * places[..., :2] / places[..., 2:]
        return jacobian


@dataclass(frozen=True)
class _Guess:
    """A pose of the body in the frame of the camera, and a focal length, as of PoseFit."""

    turn: Array
    shift: Array
    focal: float

    def moved(self, step: Array) -> '_Guess':
        """Return the guess after a step (7,): shift, rotation vector, focal length."""
        return _Guess(cv2.Rodrigues(step[3:6])[0] @ self.turn, self.shift + step[:3],
                      self.focal * float(np.exp(step[6])))


def width(corners: Array) -> float:
    """Return the least height of a tag (4, 2) over its longest edge, px."""
    (ax, ay), (bx, by) = corners[2] - corners[0], corners[3] - corners[1]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max()
    return float(max(1.0, abs(ax * by - ay * bx) / 2.0 / max(1.0, longest)))


def angle(one: Array, other: Array) -> float:
    """Return the angle between two rotation matrices, rad."""
    return float(np.arccos(np.clip((np.trace(one.T @ other) - 1.0) / 2.0, -1.0, 1.0)))


def _moved(jacobian: Array, axes: Array, arms: Array) -> Array:
    """
    Return the Jacobian of pixels by shift, then turn, along ``axes``, (tags, 8, 6).

    jacobian: (tags, 4, 2, 3).  axes: (tags, 3, 3), columns.  arms: (tags, 4, 3), from the centre
    of the turn.
    """
    turned = -cross_matrices(arms) @ axes[:, None]
    shifted = np.broadcast_to(axes[:, None], turned.shape)
    found: Array = (jacobian @ np.concatenate([shifted, turned], axis=-1)).reshape(
        len(jacobian), 8, 6)
    return found


def _normal(jacobian: Array, weights: Array, errors: Array) -> tuple[Array, Array]:
    """Return matrix and right-hand side of the normal equations."""
    weighted = jacobian.transpose(0, 2, 1) @ weights
    return (weighted @ jacobian).sum(axis=0), (weighted @ errors[..., None]).sum(axis=0)[:, 0]


def _solved(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right), dtype=float)
