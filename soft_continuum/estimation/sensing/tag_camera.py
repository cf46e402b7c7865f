# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Poses of the discs of an arm from one image of its tags.

The fixed tags determine the pose of base_link in the frame of the camera, and the focal length if
they are at different depths.  All visible tags of a disc determine its pose, within the plane of
the arm if it has one.  An ambiguous disc, such as one with a single tag seen frontally that may
tilt, is not measured.

Each of these poses is that of a body with tags, from all their corners at once, by generalised
least squares: an offset of a tag on its body moves its four corners together, so their covariance
is that of single corners plus that of the stated deviation of the tag (Hartley and Zisserman,
Multiple View Geometry, 2nd edition, chapter 5).  Each tag gives two initial poses, and each may
lead to a different minimum.  A body that moves in a plane is fitted within it: tilt and depth of a
single tag are poorly measured.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from soft_continuum.colours import Colour, MEASURED, MODEL
from soft_continuum.estimation.sensing.corners import TagDetector
from soft_continuum.estimation.sensing.layout import (
    CORNERS,
    Corners,
    Layout,
    MIN_FIXED,
    off_a_line,
    PlacedTags,
    RingLayout,
    Tag,
)
from soft_continuum.estimation.sensing.lens import Lens
from soft_continuum.estimation.sensing.pictures import is_black, Picture
from soft_continuum.estimation.sensing.tare import SensorError
from soft_continuum.mechanics.arm import Array, SPATIAL_AXES
from soft_continuum.mechanics.rotations import (
    compose,
    cross_matrices,
    levers,
    matrices,
    matrix_angle,
    quaternions,
    rotate,
    UNKNOWN,
    UP,
)

CORNER_DEVIATION = 0.1  # px, of each corner of a tag
FULL_WIDTH = 32.0  # px of such a tag
ITERATIONS, HALVINGS = 20, 6
DONE = 1e-7  # m and rad: a smaller step is the last one
SAME, NEAR = 0.01, 0.05  # rad between two poses that are, or lead to, one minimum
UNCALIBRATED = 0.01  # relative, standard: of a focal length that the straight arm corrects
MAX_STRAIGHT_MISFIT = 6.0
"""Of corners over what is expected of them, both squared: more is a bent arm."""
MAX_RESIDUAL = 2.0  # px, RMS of each coordinate: tags beyond it are not where they were said to be
MAX_SCALE_ERROR = 0.03  # relative, of the edge of a printed tag
FAR_OFF = 0.5  # relative size error that no printer causes
MAX_MISFIT = 16.0  # of corners over what is expected of them, both squared
STEADY = 0.2  # px: with less of fixed tags, the view of a planar arm follows their noise
NOISY = 1.5  # such a misfit of fixed tags, beyond which corners are worse than expected
CLEARER = 12.0  # by which the misfit of every other pose of a disc is larger
MIN_WIDTH = 16.0  # px, 2 per module: of a tag seen more from its side corners are not exact
MIN_TILT = 0.35  # rad by which a tag that is seen alone has to look past the camera
MAX_TURN = 0.1  # rad, standard: a disc that is known worse than that is not measured
MIN_CHORD, MAX_CHORD = 0.5, 1.05  # of a segment's length, between the discs at its ends
OVERLAY_SIZE = 640  # px, longer edge of what is drawn
JPEG_QUALITY = 75  # of the JPEG
FAR = 1e3  # m, where no arm is
ON_CURVE = 12  # points of a segment's middle line
PIXEL_BITS = 4  # bits after the point of a pixel, as OpenCV draws


# The pose of a body.

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
            if any(matrix_angle(start.turn, g.turn) < NEAR for _, g in found):
                continue
            misfit, guess = self._refined(start)
            if np.isfinite(misfit) and all(
                    matrix_angle(guess.turn, g.turn) > SAME for _, g in found):
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
            turned = quaternions(base.turn.T @ turn) * [*self._moves[3:], True]
            turn = base.turn @ matrices(turned / np.linalg.norm(turned))
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


# Discs.

@dataclass(frozen=True)
class DiscPose:
    """
    Measured pose of the bottom of a disc in base_link, m and rad.

    pose, covariance: position and quaternion x, y, z, w, (7,), and (6, 6) of the position and of
    a rotation vector along the axes of base_link.  by_tags: (7,), the pose without offsets.
    """

    pose: Array
    covariance: Array
    by_tags: Array


class CameraView:
    """The view of a camera of base_link."""

    def __init__(self, base: PoseFit, lens: Lens, deviation: float) -> None:
        """
        Take the pose of base_link in the frame of the camera.

        deviation: px, of each corner of a tag of a disc.
        """
        self.base, self._lens, self.deviation = base, lens, deviation

    def project(self, points: Array) -> Array:
        """Project points (k, 3) m in base_link, (k, 2) px; nan behind the camera."""
        places = points @ self.base.turn.T + self.base.shift
        depths = np.where(places[:, 2:] > 0.0, places[:, 2:], np.nan)
        pixels: Array = (places[:, :2] / depths * self.base.focal * np.diag(self._lens.matrix)[:2]
                         + self._lens.matrix[:2, 2])
        return pixels

    def pose(self, fit: PoseFit) -> Array:
        """Return the pose (7,) in base_link of a body seen by the camera."""
        back = self.base.turn.T
        return np.concatenate([back @ (fit.shift - self.base.shift),
                               quaternions(back @ fit.turn)])

    def covariance(self, fit: PoseFit, factor: float) -> Array:
        """
        Return the covariance (6, 6) of that pose, along the axes of base_link.

        factor: by which the squares of the corners are larger than expected.
        """
        back = np.kron(np.eye(2), self.base.turn.T)
        # What moves base_link moves what is seen of the body alike.
        by_base = fit.response.copy()
        by_base[:, :6] = by_base[:, :6] @ levers(fit.shift - self.base.shift)
        found = factor * (fit.covariance + by_base @ self.base.covariance @ by_base.T)[:6, :6]
        covariance: Array = back @ found @ back.T
        return covariance


@dataclass(frozen=True)
class TagDetections:
    """
    Detections in one image.

    discs: by number, base first.  numbers: of all detected tags, including foreign ones.
    stddev: px, of the corners by their residuals, less the effect of tag offsets; nan without
    measurements.  problems: as text.  corners: by number of the tag, (4, 2) px, without the
    distortion of the lens.  view: the projection; None unless the fixed tags determine it.
    """

    discs: Mapping[int, DiscPose]
    numbers: tuple[int, ...]
    stddev: float
    problems: tuple[str, ...]
    corners: Mapping[int, Array]
    view: CameraView | None = None

    @property
    def by_tags(self) -> dict[int, Array]:
        """Poses (7,) of the discs without offsets, by number."""
        return {n: disc.by_tags for n, disc in self.discs.items()}


class TagCamera:
    """Measures the discs of an arm in images of one camera, by their tags."""

    def __init__(self, layout: Layout, lens: Lens, stuck: Any = ()) -> None:
        """
        Store the tag layout and the camera calibration.

        stuck: tag offsets; none for tags at their nominal positions.  Raises SensorError for
        impossible ones.
        """
        self.layout, self.lens = layout, lens
        self._tags = tags = straight_tags(layout, lens, stuck) if stuck and isinstance(
            layout, RingLayout) else layout.placed(stuck)
        self._known = frozenset(tags.fixed).union(*tags.rings)
        self._tilts = bool(layout.axes.all())  # tags may be seen from their side, or not at all
        self._full_width = FULL_WIDTH if self._tilts else 0.0
        self._detector = TagDetector(lens, () if self._tilts else self._known, 1 + self._tilts)

    def measure(self, picture: Picture) -> TagDetections:
        """Return the detections in a grey image (height, width)."""
        if picture.shape[::-1] != self.lens.size:
            return TagDetections({}, (), np.nan, (
                f'the image has {picture.shape[1]} x {picture.shape[0]} px, the calibration '
                f'{self.lens.size[0]} x {self.lens.size[1]}; calibrate the camera at this '
                'resolution',), {})
        numbers, corners, problems = self._find(picture)
        view = self._view(picture, corners)
        if isinstance(view, str):
            return TagDetections({}, numbers, np.nan, (*problems, view), corners)
        fits: dict[int, PoseFit] = {}
        for n in range(len(self.layout.heights)):
            fit = self._fit(n, corners, view)
            if isinstance(fit, str):
                problems.append(fit)
            elif fit is not None:
                fits[n] = fit
        if self._tilts and (wrong_scale := self._wrong_scale(view, fits)):
            return TagDetections({}, numbers, np.nan, (*problems, wrong_scale), corners, view)
        poses = {n: view.pose(fit) for n, fit in fits.items()}
        wrong, on_wrong_discs = implausible_spacing(poses, self.layout)
        fits = {n: fit for n, fit in fits.items() if n not in wrong}
        used = [view.base, *fits.values()]
        factor = sum(fit.misfit for fit in used) / sum(fit.freedom for fit in used)
        return TagDetections(
            {n: DiscPose(compose(poses[n], self._tags.offsets[n]),
                         self._covariance(n, poses[n], view.covariance(fit, max(1.0, factor))),
                         poses[n]) for n, fit in fits.items()},
            numbers, view.deviation * float(np.sqrt(factor)), (*problems, *on_wrong_discs),
            corners, view)

    def _find(self, picture: Picture) -> tuple[tuple[int, ...], dict[int, Array], list[str]]:
        """Return all numbers, the corners of this layout's tags, px, and problems."""
        found = self._detector.detect(picture)
        count = Counter(n for n, _ in found)
        problems = [f'{times} tags with the number {n} are seen; remove the wrong one'
                    for n, times in sorted(count.items()) if times > 1 and n in self._known]
        corners = {n: c for n, c in found if n in self._known and count[n] == 1
                   and (width(c) >= MIN_WIDTH or not self._tilts)}
        return tuple(sorted(count)), corners, problems

    def _view(self, picture: Picture, corners: Mapping[int, Array]) -> CameraView | str:
        """Return the view of base_link, or why it is unknown."""
        fixed, layout = self._tags.fixed, self.layout
        seen = [n for n in fixed if n in corners]
        if len(seen) < MIN_FIXED:
            return self._too_few(picture, corners, len(seen))
        if not off_a_line(np.array([fixed[n].centre for n in seen])):
            return 'the visible fixed tags are in a line; uncover the others'
        given = ([fixed[n] for n in seen], [corners[n] for n in seen], self.lens,
                 self._tags.focal, self._tags.focal_stddev)
        deviation = CORNER_DEVIATION if self._tilts else STEADY
        group = TagGroup(*given, deviation=deviation, full_width=self._full_width)
        fits, of_discs = group.fits(), CORNER_DEVIATION
        if not fits:
            return f'the fixed tags do not fit; are they at {layout.fixed_parameter}?'
        off = fits[0].misfit / fits[0].freedom
        if not self._tilts and off > NOISY:
            of_discs = deviation * float(np.sqrt(off))
            group = TagGroup(*given, deviation=of_discs, full_width=self._full_width)
            fits = group.fits()
        factor = group.size_factor(fits[0])
        if MAX_SCALE_ERROR < abs(factor - 1.0) < FAR_OFF:
            return (f'the fixed tags are {factor * layout.fixed_size * 1e3:.1f} mm large, '
                    f'measured by their distances, not {layout.fixed_size * 1e3:.1f} mm: '
                    f'print at 100 %, or correct {layout.fixed_parameter}')
        if _does_not_fit(fits[0], off) or abs(factor - 1.0) >= FAR_OFF:
            return (f'the fixed tags do not fit by {fits[0].residual:.1f} px; are they where '
                    f'{layout.fixed_parameter} says, and is this calibration of this camera?')
        return CameraView(fits[0], self.lens, of_discs)

    def _too_few(self, picture: Picture, corners: Mapping[int, Array], seen: int) -> str:
        """Return the problem of an image without enough fixed tags, and a remedy."""
        why = 'are they covered, are they in the image, sharp and lit?'
        if is_black(picture):
            why = 'the image is black: is the lens covered, is there light?'
        elif not corners and self._detector.numbers(cv2.flip(picture, 1)):
            why = 'the image is mirrored: turn that off in the driver of the camera'
        return (f'{seen} of {len(self.layout.fixed)} fixed tags are seen; needed: {MIN_FIXED}; '
                f'{why}')

    def _fit(self, n: int, corners: Mapping[int, Array], view: CameraView) -> PoseFit | str | None:
        """Return the pose of a disc, why it is unknown, or None when it is not seen."""
        ring = self._tags.rings[n]
        seen = [number for number in ring if number in corners]
        fits = TagGroup(
            [ring[k] for k in seen], [corners[k] for k in seen], self.lens, view.base.focal,
            base=view.base, axes=self.layout.axes, deviation=view.deviation,
            full_width=self._full_width).fits() if seen else []
        if not fits:
            return None
        best = fits[0]
        if _does_not_fit(best, best.misfit / best.freedom):
            return (f'the tags of disc {n} do not fit by {best.residual:.1f} px; is each in its '
                    'place, flat, and of the size tags.disc_size?')
        alone = len(seen) == 1 and _tilt(ring[seen[0]], best) < MIN_TILT
        unclear = any(fit.misfit - best.misfit < CLEARER for fit in fits[1:])
        if self._tilts and (alone or unclear or np.linalg.eigvalsh(
                best.covariance[3:6, 3:6])[-1] > MAX_TURN**2):
            return (f'only tag {", ".join(map(str, seen))} of disc {n} is seen, too frontally to '
                    'measure its orientation; turn the ring, or move the camera')
        return best

    def _wrong_scale(self, view: CameraView, fits: Mapping[int, PoseFit]) -> str:
        """Return a problem of the size of the rings, judged by the base; empty for none."""
        size = np.linalg.norm(fits[0].shift if 0 in fits else view.base.shift)
        factor = float(np.linalg.norm(view.base.shift) / size)
        if abs(factor - 1.0) <= MAX_SCALE_ERROR:
            return ''
        return (f'the tags of disc 0 are {factor * self.layout.disc_size * 1e3:.1f} mm large, '
                f'measured by the fixed tags, not {self.layout.disc_size * 1e3:.1f} mm: print at '
                '100 %, or correct tags.disc_size; is the ring of the base where it should be?')

    def _covariance(self, n: int, pose: Array, by_tags: Array) -> Array:
        """Return the covariance of a disc, with the offset of its ring."""
        # A ring that is turned about its middle shifts the bottom of the disc.
        lever = levers(-self.layout.heights[n] * rotate(pose[3:], UP))
        found = by_tags + lever * self._tags.ring_spread**2 @ lever.T
        measured = np.outer(self.layout.axes, self.layout.axes)
        covariance: Array = np.where(measured, found, UNKNOWN * np.eye(6))
        return covariance


def implausible_spacing(poses: Mapping[int, Array], layout: Layout) -> tuple[set[int], list[str]]:
    """
    Return the discs at distances that the segment between them does not allow, and why.

    poses: (7,), of the detected discs.
    """
    wrong: set[int] = set()
    problems = []
    lengths = layout.segment_lengths
    for n in sorted(poses.keys() & {above - 1 for above in poses}):
        along = rotate(poses[n][3:], UP)
        top = poses[n][:3] + layout.disc_heights[n] * along
        chord = float(np.linalg.norm(poses[n + 1][:3] - top))  # to the bottom of that above
        if not MIN_CHORD * lengths[n] <= chord <= MAX_CHORD * lengths[n]:
            wrong |= {n, n + 1}
            problems.append(
                f'discs {n} and {n + 1} are seen {chord * 1e3:.0f} mm apart, though segment '
                f'{n + 1} between them has {lengths[n] * 1e3:.0f} mm; are the tags on the right '
                'discs?')
    return wrong, problems


def _tilt(tag: Tag, fit: PoseFit) -> float:
    """Return the angle between a tag's normal and the line of sight, rad."""
    place = fit.turn @ tag.centre + fit.shift
    return float(np.arccos(-(fit.turn @ tag.axes[2]) @ place / np.linalg.norm(place)))


def _does_not_fit(fit: PoseFit, off: float) -> bool:
    """Return whether corners are off by more than pixels and, ``off``, than is expected."""
    return fit.residual > MAX_RESIDUAL and off > MAX_MISFIT


# Tags of the straight arm.

def straight_tags(layout: RingLayout, lens: Lens, corners: Corners) -> PlacedTags:
    """
    Return the tags corrected by their corners on the straight arm, and the focal length.

    There the tags are at their nominal positions apart from their offsets, like the fixed ones but
    nearer to the camera.  So together they determine the view and the focal length, and then each
    one its offset.  The remaining error along the view is not attributed to a misaligned ring: it
    would point in another direction when the disc turns.

    Raises SensorError for an arm that is not straight.
    """
    ring = np.diag(layout.ring_spread)
    before, heights = layout.placed({}), layout.straight_heights
    # The offset of a ring counts as offsets of its tags, so that visible tags determine it.
    rings = [{n: replace(tag, spread=np.sqrt(tag.spread**2 + ring**2))
              for n, tag in tags.items()} for tags in before.rings]
    every = dict(before.fixed) | {
        n: _raised(tag, height) for tags, height in zip(rings, heights, strict=True)
        for n, tag in tags.items()}
    seen = [n for n in every if n in corners]
    group = TagGroup([every[n] for n in seen], [corners[n] for n in seen], lens,
                     focal_stddev=UNCALIBRATED)
    if len(seen) < len(heights) or not (fits := group.fits()):
        raise SensorError('no tags are seen that the straight arm can calibrate')
    placed = dict(zip(seen, group.placed(fits[0]), strict=True))
    off, number = max((float(np.linalg.norm(placed[n].centre - every[n].centre)), n)
                      for n in seen)
    if fits[0].misfit > MAX_STRAIGHT_MISFIT * fits[0].freedom:
        raise SensorError(
            f'tag {number} is seen {off * 1e3:.1f} mm from its position on the straight arm, '
            'others too; is the arm straight, does tags.fixed_poses fit?')
    return PlacedTags(
        {n: placed.get(n, tag) for n, tag in before.fixed.items()},
        tuple({n: _raised(placed[n], -height) if n in placed else tag
               for n, tag in tags.items()}
              for tags, height in zip(rings, heights, strict=True)),
        before.offsets, np.zeros(6), fits[0].focal, float(np.sqrt(fits[0].covariance[6, 6])))


def _raised(tag: Tag, height: float) -> Tag:
    return replace(tag, centre=tag.centre + np.array([0.0, 0.0, height]))


# A drawing.

def overlay(picture: Picture, camera: TagCamera | None = None, seen: TagDetections | None = None,
            model: Array | None = None) -> bytes:
    """
    Return a JPEG of a grey image (height, width), 640 px large, with overlays.

    seen: its detections; tags are drawn in MEASURED.  model: (2 * discs, 7), poses of bottom and
    top of each disc in base_link, m and quaternion x, y, z, w, as in disc_poses, drawn in MODEL
    if enough fixed tags are seen.
    """
    scale = OVERLAY_SIZE / max(picture.shape)
    height, width = (max(1, round(scale * edge)) for edge in picture.shape)
    small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    drawn = cv2.cvtColor(small, cv2.COLOR_GRAY2BGR)
    if camera is not None and seen is not None:
        for corners in seen.corners.values():
            _draw(drawn, camera.lens.distorted(corners) * scale, MEASURED, closed=True)
        if seen.view is not None and model is not None and np.abs(model).max() < FAR:
            for points, closed in _wireframe(model, camera.layout.rim):
                pixels = seen.view.project(points)
                _draw(drawn, camera.lens.distorted(pixels) * scale, MODEL, closed)
    return bytes(cv2.imencode('.jpg', drawn, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1])


def _wireframe(model: Array, rim: Array) -> list[tuple[Array, bool]]:
    """Return the outlines of the discs and the middle lines of the segments, as (k, 3) points."""
    lines = []
    outlines = [np.array([pose[:3] + rotate(pose[3:], point) for point in rim]) for pose in model]
    for bottom, top in zip(outlines[::2], outlines[1::2], strict=True):
        lines += [(bottom, True), (top, True)]
        lines += [(np.array(side), False) for side in zip(bottom, top, strict=True)]
    for top, bottom in zip(model[1::2], model[2::2], strict=False):
        lines.append((_curve(top, bottom), False))
    return lines


def _curve(begin: Array, end: Array) -> Array:
    """Return points (k, 3) on the cubic curve between two poses, tangent to both."""
    t = np.linspace(0.0, 1.0, ON_CURVE)[:, None]
    length = np.linalg.norm(end[:3] - begin[:3])
    leaves, arrives = (rotate(pose[3:], UP) * length for pose in (begin, end))
    points: Array = ((1.0 + 2.0 * t) * (1.0 - t)**2 * begin[:3] + t * (1.0 - t)**2 * leaves
                     + t**2 * (3.0 - 2.0 * t) * end[:3] + t**2 * (t - 1.0) * arrives)
    return points


def _draw(picture: Picture, points: Array, colour: Colour, closed: bool) -> None:
    """Draw a line through points (k, 2) px, unless OpenCV cannot represent them."""
    if np.isfinite(points).all() and np.abs(points).max() < 1e5:
        pixels = np.round(points * 2**PIXEL_BITS).astype(np.int32)
        cv2.polylines(picture, [pixels], closed, colour[::-1], 2, cv2.LINE_AA, PIXEL_BITS)
