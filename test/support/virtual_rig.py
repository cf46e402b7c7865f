# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm on simulated hardware in virtual time: what the three other nodes do, without ROS."""

from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from soft_continuum.hardware.jamming_controller import JammingController, JammingSettings
from soft_continuum.hardware.simulated_jamming import (
    JammingPlant,
    SimulatedJamming,
    SimulatedRegulators,
)
from soft_continuum.hardware.simulated_tendons import SimulatedTendons
from soft_continuum.hardware.tendon_controller import (
    MotionRefusedError,
    Reason,
    TendonController,
    TendonLimits,
)
from soft_continuum.mechanics import Statics
from soft_continuum.parameters.shapes import PAPER_SHAPES
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.settings import RunnerSettings
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.ros.description import load_arm
from soft_continuum.sequencing import Code
from soft_continuum.sequencing.runner import Failure, Observation, Runner

DESCRIPTION = Path(__file__).resolve().parents[2] / 'config' / 'manipulator.yaml'
ARM, LIBRARY = load_arm(DESCRIPTION), PAPER_SHAPES
STEP = 0.01  # s
TENDON_STEPS, JAMMING_STEPS, TICK_STEPS = 2, 5, 5  # periods of the nodes in steps
SPEED, ACCELERATION = 0.1, 2.0
JAMMING_SETTINGS = JammingSettings()
RUNNER_SETTINGS = RunnerSettings(jamming_timeout=3.0, settle_timeout=1.0)
PLAN_SETTINGS = PlanSettings(speed=0.06, acceleration=0.6, angle_step=np.radians(6.0))


class Steppers(SimulatedTendons):
    """Simulated steppers that can get stuck."""

    def move(self, pulls, duration):
        if not self.rig.stuck:
            super().move(pulls, duration)


@dataclass
class VirtualRig:
    """
    Simulated tendons and jamming with their controllers, the model, and one Runner on top.

    It is the Runner's ArmPort.  latency: s that a command and an observation take to arrive.
    broken: valves that no longer move.  leaking: segments that lose their vacuum.  stuck: steppers
    that do not move.  fault, obstructed: what is reported as such.  plan_ticks: how long a plan
    takes.  commands: every request of the runner, with the time.  progress: of every tick.
    """

    shapes: tuple = ()
    arm: object = ARM
    latency: float = 0.0
    stiff_at_start: bool = True
    regulators: bool = False
    settings: RunnerSettings = RUNNER_SETTINGS
    plan_settings: PlanSettings = PLAN_SETTINGS
    acceleration: float = ACCELERATION
    now: float = 1000.0
    fault: str = ''
    obstructed: str = ''
    lost: bool = False
    agreed: bool = True
    plan_ticks: int = 0
    stuck: bool = False
    broken: set = field(default_factory=set)
    leaking: set = field(default_factory=set)
    commands: list = field(default_factory=list)
    progress: list = field(default_factory=list)

    def __post_init__(self):
        segments = len(self.arm.segments)
        self.steppers = Steppers(
            lambda: self.now, self.arm.tendon_names, SPEED, self.acceleration, 5e-6)
        self.steppers.rig = self
        air = lambda: self.now, segments, JammingPlant(), self.stiff_at_start
        self.air = (SimulatedRegulators(*air, 90e3, 500.0) if self.regulators
                    else SimulatedJamming(*air))
        self.tendons = TendonController(
            self.steppers, TendonLimits(self.arm.tendon_names, (-0.06, 0.06), SPEED))
        self.jamming = JammingController(self.air, segments, JAMMING_SETTINGS)
        self.jamming.update()
        self.statics = Statics(self.arm)
        self.state = self.statics.chain.straight()
        self.planner = Planner(self.arm, self.plan_settings)
        self.motion, self.motion_failure, self.stiff_since, self.count = None, None, None, 0
        self.inbox, self.observed, self.plans = deque(), deque(), deque()
        self.runner = self.run_of(self.shapes) if self.shapes else None

    def run_of(self, shapes, plan=None):
        """A Runner of this rig."""
        return Runner(shapes, plan or self.plan, self, self.settings, self.arm.tendon_names)

    def plan(self, shapes):
        """Plan, and deliver the plan after ``plan_ticks``."""
        future = Future()
        self.plans.append((self.now + self.plan_ticks * TICK_STEPS * STEP, future, shapes))
        self.deliver_plans()
        return future

    def deliver_plans(self):
        while self.plans and self.plans[0][0] <= self.now + 1e-9:
            _, future, shapes = self.plans.popleft()
            try:
                future.set_result([self.planned(shape) for shape in shapes])
            except Exception as error:
                future.set_exception(error)

    def planned(self, shape):
        return plans_to(self.planner, [shape], self.state, self.tendons.reading.pulls)[0]

    # ArmPort.

    def set_stiff(self, segment, stiff):
        self._send(('set_stiff', segment, stiff), lambda: self._switch(segment, stiff))

    def set_vacuum(self, segment, vacuum):
        self._send(('set_vacuum', segment, vacuum),
                   lambda: segment in self.broken or self.jamming.set_vacuum(segment, vacuum))

    def follow(self, motion, start, times, pulls):
        self._send(('follow', start, times, pulls),
                   lambda: self._follow(motion, start + times, pulls))

    def hold(self):
        self._send(('hold',), self.tendons.hold)

    def _send(self, command, action):
        self.commands.append((self.now, *command))
        if self.latency:
            self.inbox.append((self.now + self.latency, action))
        else:
            action()

    # What the nodes do.

    def _switch(self, segment, stiff):
        if segment not in self.broken:
            self.jamming.set_stiff(segment, stiff)

    def _follow(self, motion, times, pulls):
        if motion != self.motion:
            self.motion, self.motion_failure = motion, None
        try:
            self._predict(self.tendons.plan(times, pulls, self.now)[1])
            self.tendons.accept(times, pulls, self.now)
            self.stiff_since = list(self.jamming.stiff)
        except MotionRefusedError as error:
            self._fail(f'the tendon motion was refused: {error}')

    def _fail(self, message):
        self.motion_failure = self.motion_failure or Failure(Code.HARDWARE_FAULT, message)

    def _predict(self, pulls):
        if all(self.jamming.stiff):
            raise MotionRefusedError(Reason.ALL_STIFF, 'every segment is stiff')
        state = self.state
        for pull in pulls:
            state = self.statics.solve(state, pull, self.soft, vacuum=self.parts)
            if state.tensions.max() > self.plan_settings.tension_limit:
                raise MotionRefusedError(Reason.TENSION, 'too much tension')

    @property
    def soft(self):
        told = self.jamming.reading.vacuums
        return [not vacuum for vacuum in told] if told else [not s for s in self.jamming.stiff]

    @property
    def parts(self):
        """Of the full vacuum, as the model has them."""
        full = JAMMING_SETTINGS.full_vacuum
        return [min(1.0, max(0.01, vacuum / full)) for vacuum in self.vacuum] if (
            self.regulators) else None

    @property
    def vacuum(self):
        return tuple(JAMMING_SETTINGS.ambient_pressure - p for p in self.jamming.reading.pressures)

    @property
    def moving(self):
        return self.tendons.reading.moving

    @property
    def angles(self):
        return self.state.bending_angles

    def observe(self):
        self.observed.append((self.now, Observation(
            self.tendons.reading.pulls, self.moving, tuple(self.jamming.stiff), self.vacuum,
            self.tendons.stopped_because, self.fault, self.motion_failure,
            regulators=self.regulators, lost_tendons=self.lost, lost_valves=self.lost,
            agreed=self.agreed, obstructed=self.obstructed)))
        while len(self.observed) > 1 and self.observed[1][0] <= self.now - self.latency + 1e-9:
            self.observed.popleft()
        return self.observed[0][1]

    def step(self):
        """Let 10 ms pass for every node."""
        self.now += STEP
        self.count += 1
        self.deliver_plans()
        while self.inbox and self.inbox[0][0] <= self.now + 1e-9:
            self.inbox.popleft()[1]()
        for segment in self.leaking:
            self.air._vacuum[segment] *= 0.8  # faster than any pump
        if self.count % JAMMING_STEPS == 0:
            self.jamming.update()
        if self.count % TENDON_STEPS == 0:
            if self.tendons.following and list(self.jamming.stiff) != self.stiff_since:
                self.tendons.hold()
                self._fail('a segment changed between soft and stiff during the motion')
            before = self.tendons.reading.pulls
            pulls = self.tendons.update(self.now, TENDON_STEPS * STEP).pulls
            if (any(self.soft) or self.regulators) and (
                    pulls != before or self.count % JAMMING_STEPS == 0):
                self.state = self.statics.solve(
                    self.state, pulls, self.soft, vacuum=self.parts)
        observation = self.observe()
        if self.runner and self.runner.outcome is None and self.count % TICK_STEPS == 0:
            self.runner.tick(self.now, observation)
            self.progress.append(self.runner.progress)

    def go_on(self, seconds, check=lambda rig: None):
        """Let some time pass; ``check`` sees the rig after every step."""
        for _ in range(round(seconds / STEP)):
            self.step()
            check(self)

    def run(self, check=lambda rig: None, until=lambda rig: False, most=120.0):
        """Go on until the run has an outcome (returned) or ``until`` says so."""
        start = self.now
        while self.runner.outcome is None and not until(self):
            assert self.now < start + most, f'no outcome after {most} s: {self.runner.progress}'
            self.step()
            check(self)
        return self.runner.outcome


def one_soft_at_most_and_none_moved_stiff(rig):
    """Claims that hold throughout a run on a rig without faults."""
    soft = [i for i, flag in enumerate(rig.soft) if flag]
    assert len(soft) <= 1
    if rig.moving or rig.tendons.following:
        assert soft and rig.vacuum[soft[0]] <= rig.settings.soft_vacuum


def reaches(phase, segment=None):
    """Whether a run is in a phase, of a segment (1-based) or of any, as a condition."""

    def reached(rig):
        progress = rig.runner.progress
        return progress.phase == phase and segment in (None, progress.segment)

    return reached


def at_rest_and_stiff(rig, without=()):
    """Claim the state of the arm after every ending but a stop, also later on."""
    commands = list(rig.commands)
    for _ in range(3):
        assert not rig.moving and not rig.tendons.following
        assert all(s for i, s in enumerate(rig.jamming.stiff) if i not in without)
        rig.go_on(0.5)
    assert rig.commands == commands


def asked_to_soften(rig):
    """Return the segments (0-based) that the runner asked to soften, one after the other."""
    return [command[2] for command in rig.commands if command[1:2] + command[3:] == (
        'set_stiff', False)]
