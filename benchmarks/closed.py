# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The suite's own closed loop as a contender: its estimator and its runner, without ROS."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partial
from typing import TypeVar

import numpy as np

from benchmarks.contenders import Goal, Outcome
from benchmarks.lab import Lab, LabError
from soft_continuum.estimation.measuring import ActuatorState
from soft_continuum.estimation.shape import ArmShape
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.planning.aiming import Aim, next_step, segments_worth_correcting
from soft_continuum.planning.planner import Planner
from soft_continuum.planning.plans import Shape, ShapePlan
from soft_continuum.planning.settings import (
    DEAD_BAND,
    LOCK_IN_STDDEV,
    LoopSettings,
    RunnerSettings,
)
from soft_continuum.planning.shape_plans import plans_to
from soft_continuum.sequencing import Phase
from soft_continuum.sequencing.closed_loop import ClosedLoopRunner, Loop
from soft_continuum.sequencing.runner import Observation
from soft_continuum.sim.twin.plant import TIME_STEP

TICK = 0.02  # s
PICTURE_PERIOD = 0.2  # s; pictures are drawn only while the arm is to be measured
TIMEOUT = 600.0  # s
MOVED = 1e-9  # m
Result = TypeVar('Result')


class _Rig:
    """An ArmPort on a lab, with the estimate of the nodes beside it."""

    def __init__(self, lab: Lab, arm: Arm) -> None:
        self._lab = lab
        self.shape = ArmShape(arm, 5e-4)
        self._times, self._pulls = np.zeros(1), lab.pulls[None].copy()
        self._sliding = np.zeros(len(lab.pulls), dtype=int)
        self._pictured = -np.inf
        self.motions: list[tuple[int, int]] = []
        """Number of each motion, and the segment that was soft."""

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Request that a segment (0-based) is evacuated or vented."""
        self._lab.request(segment, stiff)

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """Refuse it: the lab has valves."""
        raise ValueError(f'segment {segment + 1} has a valve; no {vacuum:g} Pa')

    def follow(self, motion: int, start: float, times: Array, pulls: Array) -> None:
        """Request the pulls (k, tendons) m at ``start + times`` s."""
        if not self.motions or self.motions[-1][0] != motion:
            soft = [s for s, stiff in enumerate(self._lab.stiff) if not stiff]
            self.motions.append((motion, soft[0]))
        now = self._lab.time
        later = start + times > now
        self._times = np.concatenate([[now], start + times[later]])
        self._pulls = np.concatenate([self._lab.pulls[None], pulls[later]])

    def hold(self) -> None:
        """Request that the tendons hold."""
        self._times, self._pulls = np.zeros(1), self._lab.pulls[None].copy()

    def pass_time(self) -> None:
        """Let a tick pass, and let the estimate follow."""
        lab, before = self._lab, self._lab.pulls
        steps = round(TICK / TIME_STEP)
        times = lab.time + TIME_STEP * np.arange(1, steps + 1)
        lab.advance(np.stack([np.interp(times, self._times, tendon)
                              for tendon in self._pulls.T], axis=1))
        change = lab.pulls - before
        self._sliding = np.where(np.abs(change) > MOVED, np.sign(change), self._sliding)
        self.shape.follow(ActuatorState(
            lab.time, lab.pulls, lab.stiff, None, tuple(int(one) for one in self._sliding)))

    def look(self) -> None:
        """Measure, if the last picture is old enough."""
        lab = self._lab
        if lab.time - self._pictured < PICTURE_PERIOD:
            return
        self._pictured = lab.time
        self.shape.measure(lab.time, list(lab.look().values()))

    def observation(self) -> Observation:
        """Return what a Runner needs."""
        lab = self._lab
        return Observation(
            tuple(lab.pulls.tolist()), bool(self._times[-1] > lab.time), lab.stiff,
            tuple(lab.vacuum_pascals.tolist()), measured=None if self.shape.estimator is None
            else self.shape.estimator.measured,
            anomaly=' '.join(one.message for one in self.shape.anomalies))


def closed_loop(lab: Lab, goal: Goal, arm: Arm, on_tip: bool = True) -> Outcome:
    """Set the shape by measurements; on_tip: its tip is to be right, otherwise its angles."""
    rig = _Rig(lab, arm)
    settings, described = lab.description.settings, Planner(arm, lab.description.settings)

    def planned(work: Callable[[Planner], Result]) -> 'Future[Result]':
        future: Future[Result] = Future()
        estimator = rig.shape.estimator
        try:
            if estimator is None:
                future.set_result(work(described))
            else:
                slack = settings.with_slack_for(
                    estimator.stddevs()[estimator.layout.offset])
                future.set_result(work(Planner(
                    estimator.arm, slack, offsets=estimator.offsets.tolist())))
        except Exception as error:
            future.set_exception(error)
        return future

    def plan(shapes: Sequence[Shape]) -> 'Future[list[ShapePlan]]':
        return planned(lambda planner: plans_to(planner, shapes, state(), lab.pulls))

    def state() -> Equilibrium:
        found: Equilibrium | None = rig.shape.state
        assert found is not None
        return found

    aim = Aim(bending_vectors(arm, goal.angles, goal.directions), np.array(goal.tip), on_tip)
    loop = Loop(
        lambda _: planned(lambda planner: aim),
        lambda segments, aim: planned(lambda planner: next_step(
            planner, state(), lab.pulls.tolist(), segments, aim, DEAD_BAND)),
        lambda segments, aim, limit: planned(lambda planner: segments_worth_correcting(
            planner, state(), lab.pulls.tolist(), segments, aim, LOCK_IN_STDDEV,
            limit)),
        state)
    runner = ClosedLoopRunner(
        [Shape('goal', goal.angles, 0.0, goal.directions)], plan, loop, rig, RunnerSettings(
            jamming_timeout=lab.description.timeout, soft_vacuum=lab.description.soft_vacuum),
        LoopSettings(), arm.tendon_names)
    deadline = lab.time + TIMEOUT
    for _ in range(round(0.5 / TICK)):
        rig.pass_time()
    rig.look()
    while runner.outcome is None and lab.time < deadline:
        rig.pass_time()
        if runner.progress.phase is Phase.MEASURING:
            rig.look()
        runner.tick(lab.time, rig.observation())
    if runner.outcome is None:
        raise LabError(f'no end within {TIMEOUT:g} s')
    counts = np.bincount([segment for _, segment in rig.motions], minlength=len(goal.angles))
    return Outcome(tuple(max(0, int(count) - 1) for count in counts), runner.outcome.message)


on_angles = partial(closed_loop, on_tip=False)
