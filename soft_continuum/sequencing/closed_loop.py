# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Closed-loop shape setting: soften, move, measure, correct, stiffen, compensate.

Each correction is a Newton step on the pulls, with the estimated arm.  The paper mentions it as
future work (VI).

A shape with vacuums is set with an offset for its relaxation, and measured once they are lowered.
If it is off, every segment is stiffened and the shape is planned and set again with the updated
estimate.  A correction that makes a shape worse is reported and not repeated; for shapes without
vacuums it is undone.
"""

from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from math import inf, isnan, nan

import numpy as np

from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.planning.aiming import Aim, AimStep
from soft_continuum.planning.planner import minimum_jerk
from soft_continuum.planning.plans import Move, Shape, ShapePlan, WHOLE_ARM
from soft_continuum.planning.settings import ABORT, LoopSettings, PAUSE, RunnerSettings
from soft_continuum.sequencing import Code, Outcome, Phase
from soft_continuum.sequencing.runner import ArmPort, EndError, Plan, PlanInvalidError, Runner

BETTER = 0.8  # of the last change: a correction that shrinks less does not help any more
GROWS = 1e-3  # rad: nor is a change this small expected to shrink


@dataclass(frozen=True)
class Loop:
    """
    Planning functions of a ClosedLoopRunner; each plans from the present state of the arm.

    aim: of a shape.  step: the next step with segments (0-based) still to be locked, the first one
    soft.  again: the segments worth setting again, if softening one may move the tip by so many m.
    state: of the arm now; None if unknown.
    """

    aim: 'Callable[[Shape], Future[Aim]]'
    step: 'Callable[[Sequence[int], Aim], Future[AimStep]]'
    again: 'Callable[[Sequence[int], Aim, float], Future[tuple[int, ...]]]'
    state: Callable[[], Equilibrium | None]


class _LostError(Exception):
    """There are no measurements any more."""


class ClosedLoopRunner(Runner):
    """A Runner that corrects shapes while measurements are available."""

    def __init__(self, shapes: Sequence[Shape], plan: Plan, loop: Loop, port: ArmPort,
                 settings: RunnerSettings, loop_settings: LoopSettings, tendons: Sequence[str]
                 ) -> None:
        """Prepare to run ``shapes``; the other arguments are those of a Runner."""
        super().__init__(shapes, plan, port, settings, tendons)
        self._loop = loop
        self.loop_settings = loop_settings
        """May be replaced at any time."""
        self._corrections, self._measured = 0, False
        self._lost_since = ''  # the arm is as predicted, though it was measured; for people
        self.aim: Aim | None = None
        """Aim of the last shape, if it was set by measurements."""

    def _outcome(self, code: Code, message: str) -> Outcome:
        return replace(super()._outcome(code, message), measured=self._measured,
                       corrections=self._corrections, lost=bool(self._lost_since))

    def _set(self, shape: Shape) -> Iterator[None]:
        if self._fresh(self._now):
            self._measured, self.warning, self._lost_since = True, '', ''
            try:
                if shape.vacuums:
                    yield from self._set_to_relax(shape)
                else:
                    yield from self._set_measured(shape)
                return
            except _LostError:
                self._lost()
        elif self._measured:
            self._lost()
        self.warning = self._lost_since
        yield from self._set_as_predicted(shape)

    def _set_as_predicted(self, shape: Shape) -> Iterator[None]:
        self.aim = None
        self.progress = replace(self.progress, error=None, correction=0)
        yield from self._all_stiff()
        yield from super()._set(shape)

    def _set_to_relax(self, shape: Shape) -> Iterator[None]:
        """Set a shape with vacuums to the state from which it relaxes, as planned."""
        self.aim = None
        yield from self._set_segments(shape)
        self.aim = None

    def _relax(self, shape: Shape) -> Iterator[None]:
        yield from self._relax_as_planned(shape)
        if not (shape.vacuums and self._measured):
            return
        try:
            yield from self._correct_held(shape)
        except _LostError:
            self._lost()
            if not self._held:
                yield from self._set_as_predicted(shape)
                yield from self._relax_as_planned(shape)

    def _relax_as_planned(self, shape: Shape) -> Iterator[None]:
        yield from super()._relax(shape)
        if self._lost_since not in self.warning:  # that of the plan took its place
            self.warning = f'{self._lost_since}; {self.warning}'.strip('; ')

    def _correct_held(self, shape: Shape) -> Iterator[None]:
        """Measure a shape as it is held; as long as it is off, set it by what that taught."""
        plan = self.plan
        assert plan is not None
        final = yield from self._planned(self._loop.aim(plan.shape))
        why, before = '', inf
        for left in reversed(range(self.loop_settings.max_passes)):
            yield from self._measure()
            self.aim, error = final, self._error(final)
            why, before = why or _worse(final, before, error), error
            self.warning = '' if error <= self._tolerance(final) else (
                f'{shape.name} is {final.text(error)} off with its vacuums{why}')
            if not (self.warning and left) or why:
                return
            self._corrections += 1
            plan = self.plan or plan
            self._report(Phase.STIFFENING, segment=0)
            yield from self._all_stiff()
            try:
                yield from self._set_to_relax(shape)
            except EndError as end:
                if end.code is not Code.MODEL_FAILURE or self.plan is not None:
                    raise  # the relaxation of a partly set arm is not planned
                why = f'; it cannot be corrected: {end}'
                yield from self._wind_down()
                yield from self._all_stiff()
                self.plan, self.move = plan, len(plan.moves)
            yield from super()._relax(shape)

    def _fresh(self, since: float) -> bool:
        """Whether the arm was measured at most ``sensor_timeout`` before a time."""
        measured = self._observed.measured
        return measured is not None and measured >= since - self.loop_settings.sensor_timeout

    def _set_measured(self, shape: Shape) -> Iterator[None]:
        plan, aim = yield from self._set_segments(shape)
        yield from self._measure()
        worse: str | None = None
        for _ in range(1, self.loop_settings.max_passes):
            worse = yield from self._set_again(aim, inf)
            if worse != '':
                break
        if (error := self._error(aim)) > self._tolerance(aim):
            self.warning = f'{shape.name} is {aim.text(error)} off{worse or ""}'

    def _set_segments(self, shape: Shape) -> Generator[None, None, tuple[ShapePlan, Aim]]:
        """Plan a shape, and set one segment after the other by measurements."""
        yield from self._measure()
        plan = yield from self._plan_of(shape)
        aim = self.aim = yield from self._planned(self._loop.aim(plan.as_set))
        segments: tuple[int, ...] = tuple(move.segment for move in plan.moves)
        for done, segment in enumerate(segments):
            self.move = done
            self._check_plan()
            self._report(Phase.PREPARING, done / (len(segments) + 1))
            left, here = segments[done:], aim
            if len(set(left)) < len(left):  # one is set twice: up to there it is done as planned
                left, here = (segment,), _way_point(plan, done)
            on_path = plan.moves[done] if len(shape.tips) > 1 else None
            yield from self._set_segment(left, segment, here, on_path)
        self.move = len(segments)
        return plan, aim

    def _set_again(self, aim: Aim, release_limit: float) -> Generator[None, None, str | None]:
        """
        Set the segments again that are worth it, and back if that made the shape worse.

        Returns how much worse, for people; empty if it is not worse, None if nothing was set.
        """
        before = self._loop.state()
        if not (yield from self._set_worthwhile(aim, release_limit)):
            return None
        error = self._error(aim)
        if before is None or not (worse := _worse(aim, aim.error(before), error)):
            return ''
        back = yield from self._set_worthwhile(aim.at(before), release_limit)
        return f'{worse} ({aim.text(error)} after it), and was undone' if back else worse

    def _set_worthwhile(self, aim: Aim, release_limit: float) -> Generator[None, None, bool]:
        """Set the segments again that are worth it, and measure; return whether any was."""
        self._report(Phase.PREPARING, segment=0)
        every = tuple(range(len(self._observed.stiff)))
        segments = yield from self._planned(self._loop.again(
            every if self._settings.jamming else (WHOLE_ARM,), aim, release_limit))
        for done, segment in enumerate(segments):
            self._check_plan()
            yield from self._set_segment(segments[done:], segment, aim)
        yield from self._measure()
        return bool(segments)

    def _hold(self, shape: Shape) -> Iterator[None]:
        shape = shape if self.plan is None else self.plan.shape
        until, at_first, within = self._now + shape.hold_time, nan, self._now
        self._report(Phase.HOLDING, 1.0, segment=0)
        while self._now < until and self._measured and self.aim is not None:
            aim, settings = self.aim, self.loop_settings
            self._check_stiff(None)
            if (yield from self._pause(None)):
                within = self._now
            error = self._error(aim)
            at_first = error if isnan(at_first) else at_first
            drifts = error > at_first + self._tolerance(aim)
            if not (drifts and self._fresh(self._now)):
                within = self._now
            if self._now >= within + settings.measuring_time:
                self.warning = (f'{shape.name} drifted while it was held: it is '
                                f'{aim.text(error)} off')
                if self._held:
                    self.warning += '; the drift of a shape with vacuums is not corrected'
                elif settings.correct_drift:
                    yield from self._correct_drift(aim)
                at_first, within = self._error(aim), self._now
            yield
        yield from super()._hold(replace(shape, hold_time=max(0.0, until - self._now)))

    def _correct_drift(self, aim: Aim) -> Iterator[None]:
        """Set segments again; if that fails, warn and hold the present shape."""
        try:
            worse = yield from self._set_again(aim, self.loop_settings.release_limit)
        except _LostError:
            self._lost()
            yield from self._all_stiff()
        except EndError as error:
            if not (error.code is Code.MODEL_FAILURE or isinstance(error, PlanInvalidError)):
                raise
            yield from self._wind_down()
            yield from self._all_stiff()
            self.warning += f'; it cannot be corrected: {error}'
        else:
            if worse is None:
                self.warning += ('; correcting segments would not improve it, or would exceed '
                                 'loop.release_limit')
            elif self._error(aim) <= self._tolerance(aim):
                self.warning = ''
            else:
                self.warning += worse
        self._report(Phase.HOLDING, 1.0, segment=0)

    def _lost(self) -> None:
        """End the run when measurements have stopped, or continue as predicted and warn."""
        self._measured, self.aim = False, None
        measured = self._observed.measured
        since = self._now if measured is None else self._now - measured
        lost = 'the arm, or one of its discs, has not been measured'
        if self.loop_settings.abort_when_lost:
            why = self._observed.anomaly or 'check the camera and the other sensors'
            raise EndError(Code.HARDWARE_FAULT, f'{lost} for {since:.1f} s; {why}. Set '
                                                'loop.abort_when_lost to false to continue as '
                                                'predicted')
        then = datetime.now() - timedelta(seconds=since)
        self._lost_since = self.warning = f'{lost} since {then:%H:%M:%S}: the shape is predicted'

    def _tolerance(self, aim: Aim) -> float:
        settings = self.loop_settings
        return settings.tip_tolerance if aim.on_tip else settings.angle_tolerance

    def _error(self, aim: Aim) -> float:
        """Return the error of the arm from its aim, and report it; nan if unknown."""
        state = self._loop.state()
        error = None if state is None else aim.error(state)
        self.progress = replace(self.progress, error=error)
        return nan if error is None else error

    def _set_segment(self, left: Sequence[int], segment: int, aim: Aim,
                     on_path: Move | None = None) -> Iterator[None]:
        """Set a segment; on_path: how it is moved first, where the way there counts."""
        yield from self._pause(None)
        self._report(Phase.SOFTENING, segment=segment + 1)
        yield from self._switch(segment, False)
        before = inf
        if on_path is not None and on_path.duration:
            self._report(Phase.MOVING)
            yield from self._move(self._from_here(on_path))
        for correction in range(on_path is not None, self.loop_settings.max_corrections + 1):
            yield from self._measure(segment)
            step = yield from self._planned(self._loop.step(left, aim), segment)
            self.progress = replace(self.progress, error=step.error, correction=correction)
            if step.move is None or (correction > 1
                                     and step.change > max(GROWS, BETTER * before)):
                break
            before = step.change
            self._corrections += correction > 0
            self._report(Phase.MOVING)
            yield from self._move(step.move)
        self._report(Phase.STIFFENING)
        yield from self._switch(segment, True)
        self.progress = replace(self.progress, correction=0)

    def _from_here(self, move: Move) -> Move:
        """Return a move that begins at the present pulls and ends as planned."""
        off = np.asarray(self._observed.pulls) - move.pulls[0]
        fades = 1.0 - minimum_jerk(move.times / move.duration)
        return replace(move, pulls=move.pulls + fades[:, None] * off)

    def _measure(self, soft: int | None = None) -> Generator[None, None, None]:
        """Wait until the arm rests and has been measured since."""
        settings = self.loop_settings
        self._report(Phase.MEASURING, segment=0 if soft is None else soft + 1)
        rests = self._now + settings.settling_time
        while not (self._now >= rests + settings.measuring_time
                   and self._observed.measured is not None
                   and self._observed.measured >= rests):
            self._check_stiff(soft)
            if (yield from self._pause(soft)):
                rests = self._now + settings.settling_time
            if self._now > rests and not self._fresh(self._now):
                raise _LostError
            yield

    def _check_motion(self, segment: int) -> None:
        super()._check_motion(segment)
        self._check_anomaly()

    def _check_anomaly(self) -> None:
        if self._observed.anomaly and self.loop_settings.on_anomaly == ABORT:
            raise EndError(Code.HARDWARE_FAULT, self._observed.anomaly)

    def _pause(self, soft: int | None) -> Generator[None, None, bool]:
        """
        Wait during an anomaly of the arm, if the settings request it.

        It does not end automatically: a person may be at the arm.  Returns whether it waited.
        """
        self._check_anomaly()
        if not self._observed.anomaly or self.loop_settings.on_anomaly != PAUSE:
            return False
        before, reason = self.progress.phase, self._observed.anomaly
        self.warning = f'paused: {reason}'
        self.progress = replace(self.progress, phase=Phase.PAUSED)
        while self.loop_settings.on_anomaly == PAUSE:
            self._check_stiff(soft)
            yield
        if self.loop_settings.on_anomaly == ABORT:
            raise EndError(Code.HARDWARE_FAULT, reason)
        self.warning = ''
        self.progress = replace(self.progress, phase=before)
        return True


def _worse(aim: Aim, before: float, error: float) -> str:
    """Return the text for a correction that increased the error."""
    return '' if error <= before else (
        f'; correcting it made it worse, it was {aim.text(before)} off')


def _way_point(plan: ShapePlan, move: int) -> Aim:
    """Return what a move of a plan (0-based) ends in."""
    state = plan.steps[move].states[-1]
    return Aim(state.bending, state.backbone[-1])
