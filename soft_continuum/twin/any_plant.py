# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm as a dynamic plant in MuJoCo: what planar and spatial ones have in common.

Of soft_continuum.mechanics it uses the description of the arm only: a loop that is closed on its
own statics would prove nothing.  The chain is the described one, springs between rigid bodies.
A jam adds a spring to each joint, about the angle that it had when the vacuum came, in series with
a dry friction: beyond the yield moment that angle creeps.  A tendon is a longest length.  Friction
at its guides (Capstan) is a force along each span that follows the tension, in the direction in
which its motor moved last: MuJoCo's own dry friction lets go at rest.
The arm touches obstacles, without friction, but not itself.
"""

from abc import ABC, abstractmethod

import mujoco
import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Arm, PAPER
from soft_continuum.twin.differences import Differences, TwinError

Array = NDArray[np.float64]

TIME_STEP = 0.002  # s
TIGHTENING = 0.02  # of the excess of a taut tendon, in each time step
LOOSENING = 0.01  # of what a slack tendon was tightened by, in each time step
MAX_TIGHTENING = 1e-3  # m
STRETCHING = 0.05  # of what a tendon has yet to stretch, in each time step: at once, it chatters
SLIP = 5e-3 * TIME_STEP  # m by which a tendon slips in each time step
PRESLIDING = 5e-5  # m of a motor until the friction has turned round


class AnyPlant(ABC):
    """
    The arm, at rest and straight in the beginning, all segments soft.

    Arrays have one entry for each tendon (m, N), joint (rad), or segment.
    """

    def __init__(self, arm: Arm, differences: Differences, model: str, springs: Array,
                 jams: Array) -> None:
        """
        Build the arm with its differences; raises TwinError for what MuJoCo cannot be given.

        model: MJCF; its tendons are those of the arm, then spans.  springs: stiffness of every
        joint about its axes, (joints, axes), N m/rad.  jams: to what jams are proportional.
        """
        self.arm, self.differences = arm, differences
        self._per_segment = arm.bodies_per_segment + 1
        self._springs, self._jams = springs, jams
        self._model = mujoco.MjModel.from_xml_string(model)
        self._data = mujoco.MjData(self._model)
        self._load()
        mujoco.mj_forward(self._model, self._data)
        if self._data.ncon:
            touched = self._model.geom(self._data.contact.geom[0].min()).name
            raise TwinError(f'{touched} is where the straight arm is, with which the twin begins; '
                            'move it')
        tendons = len(arm.tendon_names)
        self._tendons = slice(tendons)
        self._straight = self._data.ten_length[self._tendons].copy()
        self._sliding = np.zeros(tendons)  # 1: pulled in, -1: paid out
        self._random = np.random.default_rng(differences.seed)
        self._jam, self._held = np.zeros_like(springs), np.zeros_like(springs)
        self._stiff = np.zeros(len(arm.segments), dtype=bool)
        self._pulled = np.zeros(tendons)  # by the motors, less the backlash
        self._tightening = np.zeros(tendons)
        self._compliance = np.full(tendons, differences.tendon_compliance)  # m/N
        self._stretched = np.zeros(tendons)  # m
        self._slipped = np.zeros(tendons)  # m, of each tendon in its clamp
        self._acceleration = np.zeros(self._model.nv)  # rad/s^2
        self._set_springs()

    # What a sensor could see.

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return float(self._data.time)

    @property
    @abstractmethod
    def joint_names(self) -> list[str]:
        """Names of the joints, base first."""

    @property
    @abstractmethod
    def joint_angles(self) -> Array:
        """Angles of all joints, base first, (joints,), rad."""

    @property
    @abstractmethod
    def poses(self) -> Array:
        """Bottom and top of every disc: x, y, z (m), quaternion x, y, z, w, (2 * discs, 7)."""

    @property
    def speed(self) -> float:
        """Speed of the fastest joint, rad/s."""
        return float(np.abs(self._data.qvel).max())

    @property
    def tensions(self) -> Array:
        """Tension of each tendon at the base, (tendons,), N."""
        limits = self._data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON
        found = np.zeros(len(self._straight))
        found[self._data.efc_id[limits]] = self._data.efc_force[limits]
        return found

    @property
    def motions(self) -> Array:
        """
        Angular velocity and specific force of every disc, (discs, 6), rad/s and m/s^2.

        In the frame of the disc, and at its origin, the bottom centre: z along the disc, y the
        axis of bending in the plane.  Specific force is acceleration less gravity: what
        accelerometers measure.
        """
        model, data, frame = self._model, self._data, mujoco.mjtObj.mjOBJ_XBODY
        data.qacc[:] = self._acceleration  # nothing uses it any more
        mujoco.mj_rnePostConstraint(model, data)
        velocity, acceleration = np.zeros((2, len(self.arm.discs), 6))
        acceleration[0, 3:] = -model.opt.gravity
        for k in range(1, len(self.arm.discs)):
            body = self._disc(k)
            mujoco.mj_objectVelocity(model, data, frame, body, velocity[k], 1)
            mujoco.mj_objectAcceleration(model, data, frame, body, acceleration[k], 1)
        return np.hstack([velocity[:, :3], acceleration[:, 3:]])

    @property
    def energy(self) -> float:
        """Kinetic and potential energy, J."""
        mujoco.mj_energyPos(self._model, self._data)
        mujoco.mj_energyVel(self._model, self._data)
        return float(self._data.energy.sum())

    # Time.

    def step(self, pulls: Array, vacuum: Array) -> None:
        """
        Let one time step pass.

        pulls: (tendons,) m, by how much each motor has pulled its tendon in.  vacuum: (segments,),
        parts of full vacuum.
        """
        self._set_jams(np.asarray(vacuum, dtype=float))
        given, tensions = self.differences, self.tensions
        before = self._pulled
        self._pulled = np.clip(before, pulls - given.backlash, pulls)
        self._sliding = np.clip(
            self._sliding + (self._pulled - before) / PRESLIDING, -1.0, 1.0)
        self._slipped += SLIP * (tensions > given.slip_tension)
        self._stretched += STRETCHING * (self._compliance * tensions - self._stretched)
        longest = (self._straight - self._pulled - given.zero_offset + self._slipped
                   + self._stretched)
        excess = self._data.ten_length[self._tendons] - longest
        self._tightening += np.where(tensions > 0.0, TIGHTENING * excess,
                                     -LOOSENING * self._tightening)
        np.clip(self._tightening, 0.0, MAX_TIGHTENING, out=self._tightening)
        self._model.tendon_range[self._tendons, 1] = longest - self._tightening
        if given.guide_friction > 0.0:
            self._data.qfrc_applied[:] = self._friction(tensions)
        speeds = self._data.qvel.copy()
        mujoco.mj_step(self._model, self._data)
        # Over the step: at an instant, what is as stiff as a jam has none that says anything.
        self._acceleration = (self._data.qvel - speeds) / TIME_STEP

    def _friction(self, tensions: Array) -> Array:
        """Return what the spans pull less, or more, than the base: forces on the joints, N m."""
        of_span, turned = self._turned()
        gain = np.expm1(-self.differences.guide_friction * (self._sliding[of_span] * turned))
        moments: Array = -(tensions[of_span] * gain) @ self._span_slopes()
        return moments

    def _span_slopes(self) -> Array:
        """Return how the length of each span grows with each joint, (spans, joints), m."""
        model = self._model
        slopes = np.zeros((model.ntendon, model.nv))
        mujoco.mju_sparse2dense(slopes, self._data.ten_J, model.ten_J_rownnz, model.ten_J_rowadr,
                                model.ten_J_colind)
        return slopes[len(self._straight):]

    def _set_jams(self, vacuum: Array) -> None:
        """Let the jams follow the vacuum, and creep where they bear too much."""
        q, given = self._angles(), self.differences
        held = np.clip((vacuum - given.soft_below) / (1.0 - given.soft_below), 0.0, 1.0)
        part = np.repeat(held, self._per_segment)[:, None]
        jam = (given.stiff_ratio - 1.0) * part * self._jams
        divisor = np.where(jam > 0.0, jam, 1.0)
        # What grows holds the present angle: the moment of the jam does not change by it.
        grows = jam > self._jam
        self._held[grows] = (q - self._jam / divisor * (q - self._held))[grows]
        self._jam = jam
        stiff = held > 0.5
        for segment in np.flatnonzero(stiff & ~self._stiff):
            shift = self._shift() * given.lock_in_shift / self._per_segment
            joints = slice(segment * self._per_segment, (segment + 1) * self._per_segment)
            self._held[joints] += np.where(jam[joints] > 0.0, shift, 0.0)
        self._stiff = stiff
        moment = jam * (q - self._held)
        size = np.linalg.norm(moment, axis=1)
        beyond = size > given.yield_moment * part[:, 0]
        self._held[beyond] = (q - moment / np.where(size > 0.0, size, 1.0)[:, None]
                              * given.yield_moment * part / divisor)[beyond]
        self._set_springs()

    # What differs.

    @abstractmethod
    def _load(self) -> None:
        """Apply the forces of the description."""

    @abstractmethod
    def _angles(self) -> Array:
        """Return by how much every joint is bent about its axes, (joints, axes), rad."""

    @abstractmethod
    def _set_springs(self) -> None:
        """Give MuJoCo the springs and the jams of the joints."""

    @abstractmethod
    def _shift(self) -> Array:
        """Return a random direction, times up to 1, in which a segment that locks in bends."""

    @abstractmethod
    def _turned(self) -> tuple[NDArray[np.intp], Array]:
        """Return of every span its tendon, and by how much that has turned up to it, rad."""

    def _disc(self, number: int) -> int:
        """Return the body of a disc above the base."""
        return int(self._model.body(f'b{number * self._per_segment - 1}').id)


def joint_stiffness(arm: Arm, stiffnesses: Array) -> Array:
    """
    Return the stiffness of every joint of segments about its axes, (joints, axes), N m/rad.

    stiffnesses: (segments, axes), N m^2.
    """
    lengths = [segment.length for segment in arm.segments]
    return np.concatenate([
        row / _spring_lengths(length, arm.bodies_per_segment, arm.discretisation)[:, None]
        for length, row in zip(lengths, stiffnesses, strict=True)])


def _spring_lengths(length: float, bodies: int, discretisation: str) -> Array:
    """Return the length of segment, m, that each of its joints stands for."""
    if discretisation == PAPER:
        return np.full(bodies + 1, length / (bodies + 1))
    lengths = np.full(bodies + 1, length / bodies)
    lengths[[0, -1]] /= 2.0
    return lengths


def stiffness_factors(arm: Arm, differences: Differences) -> Array:
    """
    Return the factor of each segment, (segments,).

    Raises TwinError for another number, and for segments that are no linear springs.
    """
    if any(getattr(segment, 'soft_law', None) is not None for segment in arm.segments):
        raise TwinError('the twin knows linear springs only; the description has a measured '
                        'moment-curvature law')
    factors = differences.stiffness_factors
    if len(factors) not in (1, len(arm.segments)):
        raise TwinError(f'{len(factors)} stiffness factors are given; the arm has '
                        f'{len(arm.segments)} segments')
    return np.broadcast_to(np.array(factors), len(arm.segments))
