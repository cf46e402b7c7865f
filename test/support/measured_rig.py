# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A rig whose arm is not the one of the model, and whose shape is measured."""

from concurrent.futures import Future
from dataclasses import dataclass, field, replace

import numpy as np

from soft_continuum.estimation.estimator import Estimator
from soft_continuum.estimation.measuring import ActuatorState, DiscMeasurement
from soft_continuum.estimation.unknowns import Drift, Prior
from soft_continuum.mechanics.plane.statics import PlaneStatics
from soft_continuum.mechanics.rotations import in_plane
from soft_continuum.planning.aiming import Aim, next_step, segments_worth_correcting
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import Shape
from soft_continuum.planning.settings import LoopSettings
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.sequencing.closed_loop import ClosedLoopRunner, Loop
from support.flat_arm import of_segments
from support.paper_arm import plane_points
from support.virtual_rig import ARM, STEP, VirtualRig

ARM = replace(of_segments(ARM, range(2)), bodies_per_segment=4)
SHAPE = Shape('bow', tuple(np.radians([25.0, 20.0])), 0.2)
OFFSETS = (6e-4, -1.2e-3)  # m by which the tendons are pulled in beyond what motors say
LOOP = LoopSettings(settling_time=0.2, measuring_time=0.4, sensor_timeout=2.0)
REACHED = np.radians(0.6)  # the plant's jams are rigid, those of the estimate give a little
PERIOD = 0.1  # s between two measurements
COVARIANCE = np.diag([3e-4, 3e-4, 2e-3])**2


class OffsetStatics(PlaneStatics):
    """Statics of an arm whose tendons are not as long as the model's."""

    def solve(self, start, pulls, *arguments, **more):
        return super().solve(start, np.asarray(pulls) + OFFSETS, *arguments, **more)


@dataclass
class MeasuredRig(VirtualRig):
    """
    A rig with another arm than the model's, whose true shape is measured, and estimated.

    lost_after: s of the run, after which nothing is measured any more, or not the discs that are
    ``hidden`` then.  anomaly: what is reported.
    shift: rad by which a segment bends when it becomes stiff, once each.
    """

    arm: object = ARM
    loop: LoopSettings = LOOP
    lost_after: float = np.inf
    hidden: tuple = (1, 2, 3)
    anomaly: str = ''
    shift: dict = field(default_factory=dict)
    open_loop: bool = False

    def __post_init__(self):
        super().__post_init__()
        self.begin = self.now
        self.estimator = Estimator(self.arm, self.state, Prior(), Drift())
        self.statics = OffsetStatics(replace(self.arm, segments=tuple(
            replace(s, stiffness_y=1.3 * s.stiffness_y) for s in self.arm.segments)))
        self.before = list(self.soft)
        self.look()

    def estimated(self):
        """Return a planner with the estimated arm, and the state that is estimated."""
        known = self.estimator
        return Planner(known.arm, self.plan_settings, offsets=known.offsets), known.state

    def planned(self, shape):
        planner, state = self.estimated()
        plan, = plans_to(planner, [shape], state, self.tendons.reading.pulls)
        return replace(plan, steps=())  # nothing watches its way

    def run_of(self, shapes, plan=None):
        if self.open_loop:
            return super().run_of(shapes, plan)
        return ClosedLoopRunner(shapes, plan or self.plan, Loop(
            lambda shape: self.asked(lambda *_: self.aim(shape)),
            lambda segments, aim: self.asked(lambda planner, state: next_step(
                planner, state, self.tendons.reading.pulls, segments, aim, 5e-5)),
            lambda segments, aim, limit: self.asked(
                lambda planner, state: segments_worth_correcting(
                    planner, state, self.tendons.reading.pulls, segments, aim, 0.006, limit)),
            lambda: self.estimator.state),
            self, self.settings, self.loop, self.arm.tendon_names)

    def aim(self, shape):
        state = self.planner.statics.chain.uniform(shape.bending_angles)  # of the description
        return Aim(state.bending, state.backbone[-1])

    def asked(self, work):
        future = Future()
        try:
            future.set_result(work(*self.estimated()))
        except Exception as error:
            future.set_exception(error)
        return future

    def look(self):
        """Let the estimate follow what motors and valves report, and what is measured."""
        jammed = tuple(not soft for soft in self.soft)
        self.estimator.follow(ActuatorState(
            self.now, np.array(self.tendons.reading.pulls), jammed, self.parts, (0, 0),
            jammed != tuple(self.jamming.stiff)))
        lost = self.hidden if self.now - self.begin >= self.lost_after else ()
        if seen := [n for n in range(1, len(self.arm.discs)) if n not in lost]:
            self.estimator.measure(self.now, [
                DiscMeasurement(n, *in_plane(plane_points(self.state)[2 * n], COVARIANCE))
                for n in seen])

    def observe(self):
        if self.count % round(PERIOD / STEP) == 0:
            self.look()
        return replace(
            super().observe(), anomaly=self.anomaly, measured=self.estimator.measured)

    def step(self):
        super().step()
        for segment, (was, now) in enumerate(zip(self.before, self.soft, strict=True)):
            if was and not now and segment in self.shift:
                self.bend_by_itself(segment, self.shift.pop(segment))
        self.before = list(self.soft)

    def bend_by_itself(self, segment, change):
        per_segment = self.statics.chain.joints_per_segment
        angles = self.state.joint_angles.copy()
        angles[segment * per_segment:(segment + 1) * per_segment] += change / per_segment
        self.state = replace(self.statics.chain.state(angles))

    @property
    def error(self):
        """By how much the worst segment is off, rad."""
        wanted = np.array(self.runner._shapes[-1].bending_angles)
        return float(np.abs(self.angles - wanted).max())
