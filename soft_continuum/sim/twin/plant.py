# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm as a dynamic plant in MuJoCo.

It only uses the description of the arm from soft_continuum.mechanics: closing a loop on the
suite's own statics would prove nothing.  The chain is the described one, springs between rigid
bodies.  A jam adds a spring to each joint, about its angle when the vacuum was applied, in series
with dry friction: beyond the yield moment that angle creeps.  A tendon is an upper limit of a
length.  Friction at its guides (Capstan) is a force along each span that follows the tension, in
the direction in which its motor moved last: MuJoCo's own dry friction lets go at rest.  The arm
touches obstacles, without friction, but not itself.

The springs of MuJoCo's ball joints are isotropic and have no preload.  So each ball has three
actuators instead, about the rows of J^-1: with the rotation vector phi of the joint, and the
velocity omega of the body in its own frame, phi' = J^-1 omega (Chirikjian, Stochastic Models,
Information Theory, and Lie Groups, volume 2, 10.86).  Their damping is a property of the model,
which MuJoCo integrates implicitly: this keeps stiff ones stable.  Infinite stiffness in the
description becomes RIGID times that of the softest bending.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import cos, inf, pi, sin
from typing import Any

import mujoco
import numpy as np

from soft_continuum.mechanics.arm import Arm, Array, PAPER
from soft_continuum.sim.twin.model_errors import CylinderObstacle, ModelErrors, TwinError

TIME_STEP = 0.002  # s
TIGHTENING = 0.02  # of the excess of a taut tendon, in each time step
LOOSENING = 0.01  # of what a slack tendon was tightened by, in each time step
MAX_TIGHTENING = 1e-3  # m
STRETCHING = 0.05  # of what a tendon has yet to stretch, in each time step: at once, it chatters
SLIP = 5e-3 * TIME_STEP  # m by which a tendon slips in each time step
PRESLIDING = 5e-5  # m of a motor until the friction has turned round
RIGID = 1e6
HINGE_ARMATURE = 1e-3  # kg m^2: with less, taut tendons chatter at this time step
ARMATURE, HEAVIEST = 5e-4, 30.0
"""
Armature of each ball, kg m^2 per N m/rad; stiffness up to this many times its spring counts.
MuJoCo solves for tensions as if joints moved freely, which stiff ones do not.  Without this
armature tensions chatter.
"""
# MuJoCo lets a taut tendon be some tenths of a mm too long: it is tightened until it is not.
LIMIT = 'solreflimit="0.01 1" solimplimit="0.9 0.95 0.001 0.5 1"'
CONTACT = 'condim="1" solref="0.01 1" solimp="0.99 0.999 0.001 0.5 1"'
ARM = 'contype="1" conaffinity="0"'
"""Contact with obstacles, without self-contact."""


class Plant:
    """
    The arm, initially at rest and straight, with all segments soft.

    Arrays have one entry for each tendon (m, N), joint (rad), or segment.
    """

    def __init__(self, arm: Arm, model_errors: ModelErrors) -> None:
        """Build the arm with these errors; raises TwinError for unsupported arms."""
        self.arm, self.model_errors = arm, model_errors
        self._per_segment = arm.bodies_per_segment + 1
        self._joints = (Hinges if arm.planar else Balls)(
            arm, _stiffnesses(arm, model_errors), model_errors.damping_time)
        tendons = len(arm.tendons)
        turns = np.random.default_rng([model_errors.seed, 2]).normal(
            0.0, 0.0 if arm.planar else model_errors.angle_error, tendons)
        guides = _guides(arm, turns.tolist())
        spans = [(t, low.body + 1, high.body + 1) for t, each in enumerate(guides)
                 for low, high in zip(each, each[1:], strict=False) if high.ends_span]
        self._span_tendons, firsts, ends = np.array(spans, dtype=np.intp).reshape(-1, 3).T
        self._begins, self._span_parts = np.unique(firsts, return_inverse=True)
        """The first joint of each stretch between guides, and the last stretch of each span."""
        self._passed = slice(ends.max(initial=0))
        """Joints that a tendon passes."""
        self._model = mujoco.MjModel.from_xml_string(
            _model(arm, guides, self._joints, model_errors))
        self._data = mujoco.MjData(self._model)
        for wrench in arm.wrenches:
            if wrench.disc > 0:  # the base does not move
                self._data.xfrc_applied[self._disc(wrench.disc)] += wrench.force + wrench.moment
        mujoco.mj_forward(self._model, self._data)
        if self._data.ncon:
            touched = self._model.geom(self._data.contact.geom[0].min()).name
            raise TwinError(f'{touched} overlaps the straight arm, in which the twin starts; move '
                            'it')
        self._tendons = slice(tendons)
        self._straight = self._data.ten_length[self._tendons].copy()
        self._sliding = np.zeros(tendons)  # 1: pulled in, -1: paid out
        self._random = np.random.default_rng(model_errors.seed)
        self._jam = np.zeros_like(self._joints.springs)
        self._held = np.zeros_like(self._joints.springs)
        self._vacuum = np.zeros(len(arm.segments))
        self._stiff = np.zeros(len(arm.segments), dtype=bool)
        self._part = np.zeros((len(self._jam), 1))  # of full vacuum that jams, at each joint
        self._pulled = np.zeros(tendons)  # by the motors, less the backlash
        self._tightening = np.zeros(tendons)
        self._compliance = model_errors.tendon_compliance + arm.compliance  # m/N
        self._stretched = np.zeros(tendons)  # m
        self._slipped = np.zeros(tendons)  # m, of each tendon in its clamp
        self._acceleration = np.zeros(self._model.nv)  # rad/s^2
        self._set_jams(self._vacuum)

    # What a sensor could see.

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return float(self._data.time)

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints, base first."""
        return self._joints.names

    @property
    def joint_angles(self) -> Array:
        """Angles of all joints about their axes, base first, rad; of a ball a rotation vector."""
        return self._joints.angles(self._data).ravel()

    @property
    def poses(self) -> Array:
        """Bottom and top of every disc: x, y, z (m), quaternion x, y, z, w, (2 * discs, 7)."""
        found = np.zeros((len(self.arm.discs), 2, 7))
        found[0, :, 6] = 1.0
        for k in range(1, len(self.arm.discs)):
            body = self._disc(k)
            w, x, y, z = self._data.xquat[body]
            found[k, :, 3:] = (x, y, z, w) if w >= 0.0 else (-x, -y, -z, -w)
            found[k, :, :3] = self._data.xpos[body]
            found[k, 1, :3] += self.arm.discs[k].height * self._data.xmat[body, 2::3]
        found[0, 1, 2] = self.arm.discs[0].height
        return found.reshape(-1, 7)

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
        axis of bending in the plane.  Specific force is acceleration minus gravity, as
        accelerometers measure it.
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
        return float(self._data.energy.sum()) + self._joints.energy(
            self._data, self._jam, self._held)

    # Time.

    def step(self, pulls: Array, vacuum: Array) -> None:
        """
        Let one time step pass.

        pulls: (tendons,) m, of the motors.  vacuum: (segments,), parts of full vacuum.
        """
        self._set_jams(np.asarray(vacuum, dtype=float))
        given, tensions = self.model_errors, self.tensions
        before = self._pulled
        self._pulled = np.minimum(np.maximum(before, pulls - given.backlash), pulls)
        self._slipped += SLIP * (tensions > given.slip_tension)
        self._stretched += STRETCHING * (self._compliance * tensions - self._stretched)
        longest = (self._straight - self._pulled - given.zero_offset + self._slipped
                   + self._stretched)
        excess = self._data.ten_length[self._tendons] - longest
        self._tightening += np.where(tensions > 0.0, TIGHTENING * excess,
                                     -LOOSENING * self._tightening)
        self._tightening = np.minimum(np.maximum(self._tightening, 0.0), MAX_TIGHTENING)
        self._model.tendon_range[self._tendons, 1] = longest - self._tightening
        if given.guide_friction > 0.0:
            self._sliding = np.clip(
                self._sliding + (self._pulled - before) / PRESLIDING, -1.0, 1.0)
            self._data.qfrc_applied[:] = self._friction(tensions)
        speeds = self._data.qvel.copy()
        mujoco.mj_step(self._model, self._data)
        # Over the step: at an instant, what is as stiff as a jam has none that says anything.
        self._acceleration = (self._data.qvel - speeds) / TIME_STEP

    def _friction(self, tensions: Array) -> Array:
        """Return what the spans pull less, or more, than the base: forces on the joints, N m."""
        bent = np.add.reduceat(self._joints.angles(self._data)[self._passed], self._begins)
        turned = np.cumsum(np.linalg.norm(bent[:, :2], axis=1))[self._span_parts]
        of_span = self._span_tendons
        gain = np.expm1(-self.model_errors.guide_friction * (self._sliding[of_span] * turned))
        moments: Array = -(tensions[of_span] * gain) @ self._span_jacobian()
        return moments

    def _span_jacobian(self) -> Array:
        """Return how the length of each span grows with each joint, (spans, joints), m."""
        model = self._model
        jacobian = np.zeros((model.ntendon, model.nv))
        mujoco.mju_sparse2dense(jacobian, self._data.ten_J, model.ten_J_rownnz, model.ten_J_rowadr,
                                model.ten_J_colind)
        return jacobian[len(self._straight):]

    def _set_jams(self, vacuum: Array) -> None:
        """Let the jams follow the vacuum, and creep where they bear too much."""
        q = self._joints.angles(self._data)
        if (vacuum != self._vacuum).any():
            self._jam_by(vacuum, q)
        moment = self._jam * (q - self._held)
        size = np.sqrt((moment * moment).sum(axis=1))
        beyond = size > self.model_errors.yield_moment * self._part[:, 0]
        if beyond.any():
            self._held[beyond] = q[beyond] - (
                moment[beyond] / size[beyond, None] * self.model_errors.yield_moment
                * self._part[beyond] / np.where(self._jam > 0.0, self._jam, 1.0)[beyond])
        self._joints.pull(self._model, self._data, q, self._jam, self._held)

    def _jam_by(self, vacuum: Array, q: Array) -> None:
        """Let the jams be as stiff as another vacuum makes them, with joints at angles ``q``."""
        given, self._vacuum = self.model_errors, vacuum.copy()
        held = np.clip((vacuum - given.soft_below) / (1.0 - given.soft_below), 0.0, 1.0)
        self._part = np.repeat(held, self._per_segment)[:, None]
        jam = (given.stiff_ratio - 1.0) * self._part * self._joints.jams
        # What grows holds the present angle: the moment of the jam does not change by it.
        grows = jam > self._jam
        self._held[grows] = (q - self._jam / np.where(jam > 0.0, jam, 1.0)
                             * (q - self._held))[grows]
        self._jam = jam
        stiff = held > 0.5
        for segment in np.flatnonzero(stiff & ~self._stiff):
            shift = self._joints.direction(self._random) * given.lock_in_shift / self._per_segment
            joints = slice(segment * self._per_segment, (segment + 1) * self._per_segment)
            self._held[joints] += np.where(jam[joints] > 0.0, shift, 0.0)
        self._stiff = stiff

    def _disc(self, number: int) -> int:
        """Return the body of a disc above the base."""
        return int(self._model.body(f'b{number * self._per_segment - 1}').id)


class Hinges:
    """
    Joints that turn about y, with springs of MuJoCo.

    springs: (joints, axes), N m/rad.  jams: stiffness to which jams are proportional.  actuator:
    MJCF of the actuator of a joint.  shape: of the contact geometry, by half a width and half a
    length.
    """

    actuator = ''
    shape = 'type="box" size="{0!r} {0!r} {1!r}"'

    def __init__(self, arm: Arm, stiffnesses: Array, damping_time: float) -> None:
        """Take the stiffnesses of segments about x, y and z, (segments, 3), N m^2; s."""
        self.springs = self.jams = _of_joints(arm, stiffnesses[:, 1:2])
        self._damping_time = damping_time
        self.names = [f'joint_{n}' for n in range(1, len(self.springs) + 1)]

    def element(self, joint: int) -> str:
        """Return the MJCF of a joint, 0-based."""
        return (f'<joint name="j{joint}" type="hinge" axis="0 1 0" stiffness="1" '
                f'armature="{HINGE_ARMATURE!r}"/>')

    def angles(self, data: Any) -> Array:
        """Return the rotation of every joint about its axes, (joints, axes), rad."""
        return np.array(data.qpos[:, None])

    def pull(self, model: Any, data: Any, turned: Array, jam: Array, held: Array) -> None:
        """
        Give MuJoCo the springs, and jams (joints, axes) N m/rad that hold angles in rad.

        turned: the present angles.
        """
        total = self.springs + jam
        model.jnt_stiffness[:] = total[:, 0]
        model.qpos_spring[:] = (jam * held / total)[:, 0]
        model.dof_damping[:] = self._damping_time * total[:, 0]

    def energy(self, data: Any, jam: Array, held: Array) -> float:
        """Return the energy of springs and jams outside of MuJoCo's model, J."""
        return 0.0

    def direction(self, random: np.random.Generator) -> Array:
        """Return a random rotation direction (axes,) of a joint, times up to 1."""
        return random.uniform(-1.0, 1.0, 1)


class Balls:
    """The same about every axis; angles are rotation vectors in the frame of the body below."""

    shape = 'type="cylinder" size="{!r} {!r}"'
    actuator = ''.join(
        f'<general joint="j{{0}}" gear="{int(axis == 0)} {int(axis == 1)} {int(axis == 2)}" '
        'biastype="affine"/>' for axis in range(3))

    def __init__(self, arm: Arm, stiffnesses: Array, damping_time: float) -> None:
        """Take the stiffnesses as of Hinges."""
        softest = stiffnesses[:, :2].min(axis=1, keepdims=True)
        finite = stiffnesses < inf
        self.jams = _of_joints(arm, np.where(finite, stiffnesses, 0.0))
        self.springs = _of_joints(arm, np.where(finite, stiffnesses, RIGID * softest))
        self._damping_time = damping_time
        self.names = [f'joint_{n}_{axis}' for n in range(1, len(self.springs) + 1)
                      for axis in 'xyz']

    def element(self, joint: int) -> str:
        """Return the MJCF of a joint, 0-based."""
        armature = ARMATURE * float(self.springs[joint, :2].min())
        return f'<joint name="j{joint}" type="ball" armature="{armature!r}"/>'

    def angles(self, data: Any) -> Array:
        """Return the rotation of every joint about its axes, (joints, axes), rad."""
        turns = data.qpos.reshape(-1, 4)
        sines = np.linalg.norm(turns[:, 1:], axis=1)
        angles = 2.0 * np.arctan2(sines, np.abs(turns[:, 0]))
        factors = np.where(sines > 0.0, angles / np.maximum(sines, 1e-300), 2.0)
        found: Array = (np.copysign(factors, turns[:, 0]))[:, None] * turns[:, 1:]
        return found

    def pull(self, model: Any, data: Any, turned: Array, jam: Array, held: Array) -> None:
        """Give MuJoCo the springs and jams as Hinges.pull."""
        total = self.springs + jam
        data.ctrl[:] = -(self.springs * turned + jam * (turned - held)).ravel()
        model.actuator_gear[:, :3] = _inverse_jacobians(turned).reshape(-1, 3)
        heaviest = HEAVIEST * self.springs[:, :2].min(axis=1, keepdims=True)
        armature = ARMATURE * np.minimum(total, heaviest).ravel()
        before = model.dof_armature
        data.qvel *= np.minimum(1.0, before / armature)  # no energy comes from it
        before[:] = armature
        model.actuator_biasprm[:, 2] = -self._damping_time * total.ravel()

    def energy(self, data: Any, jam: Array, held: Array) -> float:
        """Return the energy of springs and jams outside of MuJoCo's model, J."""
        turned = self.angles(data)
        return 0.5 * float((self.springs * turned**2 + jam * (turned - held)**2).sum())

    def direction(self, random: np.random.Generator) -> Array:
        """Return a random rotation direction (axes,) of a joint, times up to 1."""
        direction, size = random.uniform(0.0, 2.0 * pi), random.uniform(0.0, 1.0)
        return np.array([size * cos(direction), size * sin(direction), 0.0])


def _of_joints(arm: Arm, stiffnesses: Array) -> Array:
    """Return the stiffness of every joint, (joints, axes), N m/rad; given (segments, axes)."""
    n = arm.bodies_per_segment
    parts = np.full(n + 1, 1.0 / (n + 1)) if arm.discretisation == PAPER else np.array(
        [0.5 / n, *[1.0 / n] * (n - 1), 0.5 / n])
    lengths = np.outer([segment.length for segment in arm.segments], parts).ravel()
    found: Array = np.repeat(stiffnesses, n + 1, axis=0) / lengths[:, None]
    return found


def _inverse_jacobians(vectors: Array) -> Array:
    """Return J^-1 of rotation vectors (joints, 3), (joints, 3, 3)."""
    square = (vectors**2).sum(axis=1)
    angle = np.sqrt(np.maximum(square, 1e-8))
    factor = np.where(square < 1e-4, 1.0 / 12.0 + square / 720.0,
                      1.0 / angle**2 - (1.0 + np.cos(angle)) / (2.0 * angle * np.sin(angle)))
    x, y, z = vectors.T
    none = np.zeros_like(x)
    cross = np.array([[none, -z, y], [z, none, -x], [-y, x, none]]).transpose(2, 0, 1)
    found: Array = np.eye(3) + 0.5 * cross + factor[:, None, None] * (cross @ cross)
    return found


class Sensors:
    """
    A load cell in each tendon, and an IMU at the bottom centre of each disc, base first.

    Their readings are ground truth with the errors of the preset of the plant.
    """

    def __init__(self, plant: Plant) -> None:
        """Draw the constant errors, independently of those of the plant."""
        self._plant, given = plant, plant.model_errors
        self._random = np.random.default_rng([given.seed, 1])
        tendons = len(plant.arm.tendon_names)
        self._zero = self._random.normal(0.0, given.load_cell_zero, tendons)
        self._scale = 1.0 + self._random.normal(0.0, given.load_cell_scale, tendons)
        shape = len(plant.arm.discs), 3
        self._bias = np.hstack([self._random.normal(0.0, size, shape)
                                for size in (given.gyro_bias, given.accelerometer_bias)])
        self._noise = np.repeat([given.gyro_noise, given.accelerometer_noise], 3)

    def tensions(self) -> Array:
        """Return the readings of the load cells, (tendons,), N."""
        size = self._plant.model_errors.tension_noise
        noise = self._random.normal(0.0, size, len(self._zero))
        shown: Array = self._zero + self._scale * self._plant.tensions + noise
        return shown

    def motions(self) -> Array:
        """Return angular velocities and specific forces, (discs, 6), as Plant.motions."""
        shown: Array = self._plant.motions + self._bias + self._random.normal(
            0.0, self._noise, self._bias.shape)
        return shown


@dataclass(frozen=True)
class Guide:
    """
    Where a tendon passes a body (-1: the base): x, y, z from its lower end, m.

    ends_span: whether the guide before it is in the same segment.
    """

    name: str
    body: int
    place: tuple[float, float, float]
    ends_span: bool


def _guides(arm: Arm, turns: list[float]) -> list[list[Guide]]:
    """Return the guides of each tendon, base first; turns: rad, of all of a tendon."""
    found: list[list[Guide]] = []
    n, spans = arm.bodies_per_segment, arm.spacers + 1
    for t, tendon in enumerate(arm.tendons):
        guides, bottom = [], arm.discs[0].height
        for s, segment in enumerate(arm.segments[:tendon.end]):
            for k in range(spans + 1):
                along = k / spans * segment.length
                angle = tendon.angle + turns[t] + tendon.twist * (bottom + along)
                offset = tendon.offset_at(s, k / spans)
                on_top = k == 0  # of the disc below
                guides.append(Guide(
                    f's{t}_{s}_{k}', s * (n + 1) + (-1 if on_top else k * n // spans),
                    (offset * cos(angle), offset * sin(angle),
                     arm.discs[s].height if on_top else 0.0), not on_top))
            bottom += segment.length + arm.discs[s + 1].height
        found.append(guides)
    return found


def _model(arm: Arm, guides: list[list[Guide]], joints: Hinges | Balls, model_errors: ModelErrors
           ) -> str:
    """Return the arm as MJCF, in base_link: z along the straight arm."""
    sites: dict[int, str] = {}
    for guide in (guide for each in guides for guide in each):
        sites[guide.body] = sites.get(guide.body, '') + _site(guide.name, *guide.place)
    lines, below, joint = [sites.get(-1, '')], arm.discs[0].height, 0
    for segment, disc in zip(arm.segments, arm.discs[1:], strict=True):
        n = arm.bodies_per_segment
        for length, mass in [(segment.length / n, segment.mass / n)] * n + [
                (disc.height, disc.mass)]:
            lines.append(_body(f'b{joint}', below, joints.element(joint), length,
                                     model_errors.mass_factor * mass))
            if model_errors.obstacles and length:
                half, shape = segment.outer_diameter / 2.0, joints.shape
                lines.append(f'<geom {shape.format(half, length / 2.0)} '
                             f'pos="0 0 {length / 2.0!r}" {ARM} {CONTACT}/>')
            lines.append(sites.get(joint, ''))
            below, joint = length, joint + 1
    lines.append(_payload(below, arm.payload))
    tendons = [_tendon([guide.name for guide in each], 10.0 * arm.length) for each in guides]
    if model_errors.guide_friction > 0.0:
        tendons += [_tendon([low.name, high.name]) for each in guides
                    for low, high in zip(each, each[1:], strict=False) if high.ends_span]
    return _document(
        [float(part) for part in arm.gravity], TIME_STEP,
        _cylinders(model_errors.obstacles, arm.length) + ''.join(lines) + '</body>' * joint,
        ''.join(tendons), ''.join(joints.actuator.format(j) for j in range(joint)))


def _stiffnesses(arm: Arm, model_errors: ModelErrors) -> Array:
    """
    Return those of each segment about x, y and z, (segments, 3), N m^2, times its factor.

    Raises TwinError for another number of factors, and for segments that are no linear springs.
    """
    if any(segment.soft_law is not None for segment in arm.segments):
        raise TwinError('the twin supports only linear springs; the description has a measured '
                        'moment-curvature law')
    if any(segment.friction for segment in arm.segments):
        raise TwinError('the twin supports only friction of tendons, as guide_friction of its '
                        'presets; the description has some of segments')
    factors = model_errors.stiffness_factors
    if len(factors) not in (1, len(arm.segments)):
        raise TwinError(f'{len(factors)} stiffness factors are given; the arm has '
                        f'{len(arm.segments)} segments')
    found: Array = np.array([[s.stiffness_x, s.stiffness_y, s.torsional_stiffness]
                             for s in arm.segments]) * np.reshape(factors, (-1, 1))
    found[:, 0] *= model_errors.lateral_stiffness_factor
    return found


# The model as MJCF, the format of MuJoCo, in SI units.

def _body(name: str, below: float, joint: str, length: float, mass: float) -> str:
    """Return a body on the previous one, without closing tag; below: length of that one."""
    inertia = max(mass * length**2 / 12.0, 1e-8)
    return (f'<body name="{name}" pos="0 0 {below!r}">{joint}'
            f'<inertial pos="0 0 {length / 2.0!r}" mass="{max(mass, 1e-6)!r}" '
            f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>')


def _payload(below: float, mass: float) -> str:
    """Return a point mass on top of the body before; empty for zero mass."""
    return (f'<body pos="0 0 {below!r}"><inertial pos="0 0 0" mass="{mass!r}" '
            'diaginertia="1e-8 1e-8 1e-8"/></body>') if mass else ''


def _site(name: str, x: float, y: float, z: float) -> str:
    """Return a guide."""
    return f'<site name="{name}" pos="{x!r} {y!r} {z!r}"/>'


def _tendon(sites: Iterable[str], longest: float = 0.0) -> str:
    """Return a tendon through sites; longest: m, 0: only measure its length."""
    limit = f' limited="true" range="0 {longest!r}" {LIMIT}' if longest else ''
    return f'<spatial{limit}>' + ''.join(f'<site site="{name}"/>' for name in sites) + '</spatial>'


def _cylinders(obstacles: Sequence[CylinderObstacle], half: float) -> str:
    """Return obstacles that reach from -half to half along y."""
    return ''.join(
        f'<geom name="obstacle {number}" type="capsule" size="{one.radius!r}" fromto="'
        f'{one.x!r} {-half!r} {one.z!r} {one.x!r} {half!r} {one.z!r}" '
        f'contype="0" conaffinity="1" {CONTACT}/>'
        for number, one in enumerate(obstacles, start=1))


def _document(gravity: Sequence[float], time_step: float, world: str, tendons: str,
             actuators: str = '') -> str:
    """Return a whole model."""
    return ('<mujoco><compiler angle="radian" autolimits="false"/>'
            f'<option timestep="{time_step!r}" integrator="implicitfast" '
            f'gravity="{" ".join(map(repr, gravity))}"/>'
            f'<worldbody>{world}</worldbody><tendon>{tendons}</tendon>'
            f'<actuator>{actuators}</actuator></mujoco>')
