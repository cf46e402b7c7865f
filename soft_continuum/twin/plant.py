# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The arm as a dynamic plant in MuJoCo.

Of soft_continuum.mechanics it uses the description of the arm only: a loop that is closed on its
own statics would prove nothing.  The chain is the described one, hinges with springs between rigid
bodies.  A jam adds a spring to each hinge, about the angle that it had when the vacuum came, in
series with a dry friction: beyond the yield moment that angle creeps.  A tendon is a longest
length.  Friction at its guides (Capstan) is a force along each span that follows the tension, in
the direction in which its motor moved last: MuJoCo's own dry friction lets go at rest.
The arm touches obstacles, without friction, but not itself.
"""

from collections.abc import Sequence
from math import cos, sin

import mujoco
import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics.arm import Arm, PAPER
from soft_continuum.twin.differences import Differences, Obstacle, TwinError

Array = NDArray[np.float64]

TIME_STEP = 0.002  # s
ARMATURE = 1e-3  # kg m^2 of each hinge: with less, taut tendons chatter at this time step
# MuJoCo lets a taut tendon be some tenths of a mm too long: it is tightened until it is not.
LIMIT = 'solreflimit="0.01 1" solimplimit="0.9 0.95 0.001 0.5 1"'
TIGHTENING = 0.02  # of the excess of a taut tendon, in each time step
LOOSENING = 0.01  # of what a slack tendon was tightened by, in each time step
MAX_TIGHTENING = 1e-3  # m
STRETCHING = 0.05  # of what a tendon has yet to stretch, in each time step: at once, it chatters
SLIP = 5e-3 * TIME_STEP  # m by which a tendon slips in each time step
PRESLIDING = 5e-5  # m of a motor until the friction has turned round
CONTACT = 'condim="1" solref="0.01 1" solimp="0.99 0.999 0.001 0.5 1"'


class Plant:
    """
    The arm, at rest and straight in the beginning, all segments soft.

    Arrays have one entry for each tendon (m, N), joint (rad), or segment.
    """

    def __init__(self, arm: Arm, differences: Differences) -> None:
        """Build the arm with its differences; raises TwinError for what MuJoCo cannot be given."""
        self.arm, self.differences = arm, differences
        self._per_segment = arm.bodies_per_segment + 1
        factors = differences.stiffness_factors
        if len(factors) not in (1, len(arm.segments)):
            raise TwinError(f'{len(factors)} stiffness factors are given; the arm has '
                            f'{len(arm.segments)} segments')
        if any(s.soft_law is not None for s in arm.segments):
            raise TwinError('the twin knows linear springs only; the description has a measured '
                            'moment-curvature law')
        stiffness = [segment.bending_stiffness * factor for segment, factor in zip(
            arm.segments, np.broadcast_to(factors, len(arm.segments)), strict=True)]
        self._springs = np.concatenate([
            k / _spring_lengths(s.length, arm.bodies_per_segment, arm.discretisation)
            for s, k in zip(arm.segments, stiffness, strict=True)])
        self._model = mujoco.MjModel.from_xml_string(
            _model(arm, differences.mass_factor, differences.obstacles))
        self._data = mujoco.MjData(self._model)
        for force in arm.forces:
            if force.disc > 0:  # the base does not move
                body = self._model.body(f'b{force.disc * self._per_segment - 1}').id
                self._data.xfrc_applied[body, :3] = force.x, 0.0, force.z
        mujoco.mj_forward(self._model, self._data)
        if self._data.ncon:
            touched = self._model.geom(self._data.contact.geom[0].min()).name
            raise TwinError(f'{touched} is where the straight arm is, with which the twin begins; '
                            'move it')
        self._straight = self._data.ten_length[:2].copy()
        self._sliding = np.zeros(2)  # 1: pulled in, -1: paid out
        self._random = np.random.default_rng(differences.seed)
        joints = len(self._springs)
        self._jam, self._held = np.zeros(joints), np.zeros(joints)
        self._stiff = np.zeros(len(arm.segments), dtype=bool)
        self._pulled = np.zeros(2)  # by the motors, less the backlash
        self._tightening = np.zeros(2)
        self._stretched = np.zeros(2)  # m, of each tendon
        self._slipped = np.zeros(2)  # m, of each tendon in its clamp
        self._acceleration = np.zeros(joints)  # rad/s^2
        self._set_springs()

    # What a sensor could see.

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return float(self._data.time)

    @property
    def joint_angles(self) -> Array:
        """Angles of all joints, base first, (joints,), rad."""
        angles: Array = self._data.qpos.copy()
        return angles

    @property
    def speed(self) -> float:
        """Speed of the fastest joint, rad/s."""
        return float(np.abs(self._data.qvel).max())

    @property
    def tensions(self) -> Array:
        """Tension of each tendon at the base, (2,), N."""
        limits = self._data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON
        found = np.zeros(2)
        found[self._data.efc_id[limits]] = self._data.efc_force[limits]
        return found

    @property
    def points(self) -> Array:
        """Bottom and top of every disc: (x, z, angle), (2 * discs, 3), m and rad, base first."""
        theta = np.cumsum(self._data.qpos)
        rows = [(0.0, 0.0, 0.0), (0.0, self.arm.discs[0].height, 0.0)]
        for k, disc in enumerate(self.arm.discs[1:], start=1):
            joint = k * self._per_segment - 1
            x, _, z = self._data.body(f'b{joint}').xpos
            angle = float(theta[joint])
            rows += [(x, z, angle), (x + disc.height * sin(angle), z + disc.height * cos(angle),
                                     angle)]
        return np.array(rows)

    @property
    def motions(self) -> Array:
        """
        Angular velocity and specific force of every disc, (discs, 6), rad/s and m/s^2.

        In the frame of the disc, and at its origin, the bottom centre: z along the disc, y the
        axis of bending.  Specific force is acceleration less gravity: what accelerometers measure.
        """
        model, data, frame = self._model, self._data, mujoco.mjtObj.mjOBJ_XBODY
        data.qacc[:] = self._acceleration  # nothing uses it any more
        mujoco.mj_rnePostConstraint(model, data)
        velocity, acceleration = np.zeros((2, len(self.arm.discs), 6))
        acceleration[0, 3:] = -model.opt.gravity
        for k in range(1, len(self.arm.discs)):
            body = model.body(f'b{k * self._per_segment - 1}').id
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

        pulls: (2,) m, by how much each motor has pulled its tendon in.  vacuum: (segments,), parts
        of full vacuum.
        """
        self._set_jams(np.asarray(vacuum, dtype=float))
        given, tensions = self.differences, self.tensions
        before = self._pulled
        self._pulled = np.clip(before, pulls - given.backlash, pulls)
        self._sliding = np.clip(
            self._sliding + (self._pulled - before) / PRESLIDING, -1.0, 1.0)
        self._slipped += SLIP * (tensions > given.slip_tension)
        self._stretched += STRETCHING * (given.tendon_compliance * tensions - self._stretched)
        longest = (self._straight - self._pulled - given.zero_offset + self._slipped
                   + self._stretched)
        excess = self._data.ten_length[:2] - longest
        self._tightening += np.where(tensions > 0.0, TIGHTENING * excess,
                                     -LOOSENING * self._tightening)
        np.clip(self._tightening, 0.0, MAX_TIGHTENING, out=self._tightening)
        self._model.tendon_range[:2, 1] = longest - self._tightening
        if given.guide_friction > 0.0:
            self._data.qfrc_applied[:] = self._friction(tensions)
        speeds = self._data.qvel.copy()
        mujoco.mj_step(self._model, self._data)
        # Over the step: at an instant, what is as stiff as a jam has none that says anything.
        self._acceleration = (self._data.qvel - speeds) / TIME_STEP

    def _friction(self, tensions: Array) -> Array:
        """Return what the spans pull less, or more, than the base: moments, (joints,), N m."""
        turned = np.cumsum(np.abs(self._data.qpos.reshape(-1, self._per_segment).sum(axis=1)))
        gain = np.expm1(-self.differences.guide_friction * np.outer(self._sliding, turned))
        moments: Array = -(tensions[:, None] * gain).ravel() @ self._span_slopes()
        return moments

    def _span_slopes(self) -> Array:
        """Return how the length of each span grows with each joint, (2 * segments, joints), m."""
        model = self._model
        slopes = np.zeros((model.ntendon, model.nv))
        mujoco.mju_sparse2dense(slopes, self._data.ten_J, model.ten_J_rownnz, model.ten_J_rowadr,
                                model.ten_J_colind)
        return slopes[2:]

    def _set_jams(self, vacuum: Array) -> None:
        """Let the jams follow the vacuum, and creep where they bear too much."""
        q, given = self._data.qpos, self.differences
        held = np.clip((vacuum - given.soft_below) / (1.0 - given.soft_below), 0.0, 1.0)
        part = np.repeat(held, self._per_segment)
        jam = (given.stiff_ratio - 1.0) * part * self._springs
        # What grows holds the present angle: the moment of the jam does not change by it.
        grows = jam > self._jam
        self._held[grows] = (q - self._jam / np.where(jam > 0.0, jam, 1.0) * (
            q - self._held))[grows]
        self._jam = jam
        stiff = held > 0.5
        for segment in np.flatnonzero(stiff & ~self._stiff):
            shift = self._random.uniform(-1.0, 1.0) * given.lock_in_shift / self._per_segment
            self._held[segment * self._per_segment:(segment + 1) * self._per_segment] += shift
        self._stiff = stiff
        moment = jam * (q - self._held)
        beyond = np.abs(moment) > given.yield_moment * part
        self._held[beyond] = (q - np.sign(moment) * given.yield_moment * part
                              / np.where(jam > 0.0, jam, 1.0))[beyond]
        self._set_springs()

    def _set_springs(self) -> None:
        total = self._springs + self._jam
        self._model.jnt_stiffness[:] = total
        self._model.qpos_spring[:] = self._jam * self._held / total
        self._model.dof_damping[:] = self.differences.damping_time * total


def _spring_lengths(length: float, bodies: int, discretisation: str) -> Array:
    """Return the length of segment, m, that each of its hinges stands for."""
    if discretisation == PAPER:
        return np.full(bodies + 1, length / (bodies + 1))
    lengths = np.full(bodies + 1, length / bodies)
    lengths[[0, -1]] /= 2.0
    return lengths


def _model(arm: Arm, mass_factor: float, obstacles: Sequence[Obstacle]) -> str:
    """Return the arm as MJCF, in base_link: z along the straight arm, bending about y."""
    half_width = max(segment.outer_diameter for segment in arm.segments)
    lines = [_sites('base', arm.segments[0].guide_offsets[0], arm.discs[0].height)]
    guides = ['base']
    below, joint = arm.discs[0].height, 0
    for k, segment in enumerate(arm.segments):
        n, disc = arm.bodies_per_segment, arm.discs[k + 1]
        for length, mass in [(segment.length / n, segment.mass / n)] * n + [
                (disc.height, disc.mass)]:
            inertia = max(mass_factor * mass * length**2 / 12.0, 1e-8)
            lines.append(
                f'<body name="b{joint}" pos="0 0 {below!r}">'
                f'<joint type="hinge" axis="0 1 0" stiffness="1" armature="{ARMATURE!r}"/>'
                f'<inertial pos="0 0 {length / 2.0!r}" mass="{max(mass_factor * mass, 1e-6)!r}" '
                f'diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>')
            if obstacles:
                half = segment.outer_diameter / 2.0
                lines.append(f'<geom type="box" size="{half!r} {half!r} {length / 2.0!r}" '
                             f'pos="0 0 {length / 2.0!r}" contype="1" conaffinity="0" {CONTACT}/>')
            below, joint = length, joint + 1
        lines.append(_sites(f'top{k}', segment.guide_offsets[1], 0.0))
        guides.append(f'top{k}')
        if k + 1 < len(arm.segments):
            lines.append(_sites(f'end{k}', arm.segments[k + 1].guide_offsets[0], disc.height))
            guides.append(f'end{k}')
    if arm.payload:
        lines.append(f'<body pos="0 0 {below!r}"><inertial pos="0 0 0" mass="{arm.payload!r}" '
                     'diaginertia="1e-8 1e-8 1e-8"/></body>')
    tendons = ''.join(
        f'<spatial name="{name}" limited="true" range="0 {10.0 * arm.length!r}" {LIMIT}>'
        + ''.join(f'<site site="{guide}_{name}"/>' for guide in guides) + '</spatial>'
        for name in arm.tendon_names)
    tendons += ''.join(
        f'<spatial><site site="{lower}_{name}"/><site site="{upper}_{name}"/></spatial>'
        for name in arm.tendon_names
        for lower, upper in zip(guides[::2], guides[1::2], strict=True))
    fixed = ''.join(
        f'<geom name="obstacle {number}" type="capsule" size="{one.radius!r}" fromto="'
        f'{one.x!r} {-half_width!r} {one.z!r} {one.x!r} {half_width!r} {one.z!r}" '
        f'contype="0" conaffinity="1" {CONTACT}/>'
        for number, one in enumerate(obstacles, start=1))
    gravity = (arm.gravity * sin(arm.mounting_angle), -arm.gravity * cos(arm.mounting_angle))
    return (
        '<mujoco><compiler angle="radian" autolimits="false"/>'
        f'<option timestep="{TIME_STEP!r}" integrator="implicitfast" '
        f'gravity="{gravity[0]!r} 0 {gravity[1]!r}"/>'
        f'<worldbody>{fixed}' + ''.join(lines) + '</body>' * joint + '</worldbody>'
        f'<tendon>{tendons}</tendon></mujoco>')


def _sites(name: str, offset: float, height: float) -> str:
    """Return the guides of both tendons at one height."""
    return ''.join(f'<site name="{name}_{tendon}" pos="{side * offset!r} 0 {height!r}"/>'
                   for tendon, side in (('right_tendon', 1.0), ('left_tendon', -1.0)))
