# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The state machine that runs shapes: all stiff, soften one, move, stiffen, wait, next.

A Runner is ticked with an observation of the arm and acts through an ArmPort.  At most one segment
is softened at a time.  A shape with vacuums is held with them: they are lowered one after the
other once it is set, and before the next shape every segment is stiff again.  A run that ends
early, except by a stop, ends with tendons at rest and every segment stiff; a stop leaves
everything as it is.  An arm without jamming is moved as a whole, without switching.  An
invalidated plan is abandoned in the same way, and replaced.
"""

from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol, TypeVar

import numpy as np

from soft_continuum.mechanics.arm import Array
from soft_continuum.planning.plans import failure_text, Move, ObstructedError, Shape, ShapePlan
from soft_continuum.planning.settings import ABORT, RunnerSettings
from soft_continuum.sequencing import Code, Outcome, Phase, Progress

LOST = 2.0
"""A vacuum this many tolerances off its set-point is lost."""
SETTLED = 0.3, 300.0
"""Vacuums of a held shape are steady if they change by at most so many Pa in so many s."""

Result = TypeVar('Result')
Plan = Callable[[Sequence[Shape]], 'Future[list[ShapePlan]]']
"""Starts to plan shapes from the present state of the arm; the future carries exceptions."""


@dataclass(frozen=True)
class Failure:
    """Why a run cannot continue."""

    code: Code
    message: str


@dataclass(frozen=True)
class Observation:
    """
    The state of the arm at one tick.

    pulls: (tendons,) m.  moving: whether a tendon moves or may still move to its set-point.
    stiff: per segment, confirmed by pressure.  vacuum: per segment, Pa below ambient.  regulators:
    whether the vacuum of each segment is held by one, in place of valves.  stopped: why tendon
    motion is stopped.  fault: why the arm cannot be operated, such as a stale node.
    motion_failure: why the last motion was refused or ended early.  stops: total number of stops.
    measured: time of the last measurement, on the clock of the ticks; None for never.  anomaly: of
    the arm, from measurements.  obstructed: obstacle that now blocks the running plan.  departed:
    deviation of the arm from that plan, if too large.  unseen: whether that plan has not yet been
    checked against the present obstacles.  lost_tendons, lost_valves: whether tendon_actuation or
    jamming_valves is stale.  agreed: whether the reported shape has these segments stiff, with the
    vacuums that regulators hold.  pull_tolerances: (tendons,) m, position tolerance of a tendon at
    rest; empty: not reported.
    """

    pulls: tuple[float, ...]
    moving: bool
    stiff: tuple[bool, ...]
    vacuum: tuple[float, ...]
    stopped: str = ''
    fault: str = ''
    motion_failure: Failure | None = None
    stops: int = 0
    measured: float | None = None
    anomaly: str = ''
    obstructed: str = ''
    departed: str = ''
    unseen: bool = False
    regulators: bool = False
    lost_tendons: bool = False
    lost_valves: bool = False
    agreed: bool = True
    pull_tolerances: tuple[float, ...] = ()

    def rests_at(self, pulls: Array, tolerance: float) -> bool:
        """Return whether tendons rest at pulls (m) within ``tolerance`` (m) or their own."""
        off = np.abs(np.subtract(self.pulls, pulls))
        return not self.moving and bool(
            (off <= np.maximum(tolerance, self.pull_tolerances or 0.0)).all())


class ArmPort(Protocol):
    """How a Runner acts on the arm; every call may be repeated without harm."""

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Request that a segment (0-based) is evacuated or vented."""

    def set_vacuum(self, segment: int, vacuum: float) -> None:
        """Request that the regulator of a segment (0-based) holds a vacuum, Pa below ambient."""

    def follow(self, motion: int, start: float, times: Array, pulls: Array) -> None:
        """
        Request the pulls (k, tendons) m at ``start + times`` s, on the clock of the ticks.

        A motion is sent in pieces, each replacing the one before; ``motion`` numbers the motions.
        """

    def hold(self) -> None:
        """Request that the tendons brake and hold."""


class EndError(Exception):
    """Ends the run with a code and a reason."""

    def __init__(self, code: Code, message: str) -> None:
        super().__init__(message)
        self.code = code


class PlanInvalidError(EndError):
    """The plan is no longer valid; ends the run unless it can be replanned."""


class Runner:
    """Runs shapes one after the other; ``outcome`` is set when it has ended."""

    def __init__(self, shapes: Sequence[Shape], plan: Plan,
                 port: ArmPort, settings: RunnerSettings, tendons: Sequence[str]) -> None:
        """
        Prepare to run ``shapes``.

        plan: starts to plan a shape when its turn comes.  tendons: their names.
        """
        self.progress = Progress(shape=shapes[0].name)
        self.outcome: Outcome | None = None
        self.warning = ''
        """Problem of the shape that was set last; empty for none."""
        self.plan: ShapePlan | None = None
        """Plan of the running shape, once planned."""
        self.move = 0
        """Present or next path of that plan (0-based): a move, or lowering the vacuums."""
        self._shapes = shapes
        self._plan = plan
        self._port = port
        self._settings = settings
        self._tendons = tendons
        self._index = 0  # of the running shape
        self._completed = 0
        self._motions, self._replans = 0, 0
        self._held: dict[int, float] = {}  # vacuum of segments that are not stiff any more, Pa
        self._now = 0.0
        self._observed = Observation((0.0,) * len(tendons), False, (), ())
        self._script = self._run()
        self._end: EndError | None = None
        self._winding_down = False
        self._stops: int | None = None  # how many there had been when the run began

    def cancel(self, code: Code, message: str) -> None:
        """End the run at the next tick: stop the motion, stiffen every segment."""
        if self._end is None:
            self._end = EndError(code, message)

    def tick(self, now: float, observation: Observation) -> None:
        """Go on at time ``now`` (s, on the clock of the motion)."""
        if self.outcome is not None:
            return
        self._now, self._observed = now, observation
        try:
            if observation.stopped:
                raise EndError(Code.STOPPED, f'stopped: {observation.stopped}')
            if self._stops is None:
                self._stops = observation.stops
            elif observation.stops != self._stops:
                self._stops = observation.stops
                failure = observation.motion_failure or Failure(
                    Code.STOPPED, 'tendon_actuation was stopped and resumed, or restarted, '
                    'meanwhile')
                raise EndError(failure.code, failure.message)
            if not self._winding_down:
                if self._end is not None:
                    raise self._end
                if observation.fault:
                    raise EndError(Code.HARDWARE_FAULT, observation.fault)
            next(self._script)
        except StopIteration:
            self._finish()
        except EndError as end:
            if end.code is Code.STOPPED or self._winding_down:
                self._end = end if end.code is Code.STOPPED else self._combined(end)
                self._finish()
            else:
                self._end = end
                self._winding_down = True
                self._script = self._wind_down()
                self.tick(now, observation)

    def _combined(self, end: EndError) -> EndError:
        """Keep the first code, and both reasons."""
        first = self._end or end
        return EndError(first.code, f'{first}; then {end}')

    def _finish(self) -> None:
        if self._end is None:
            self.progress = replace(self.progress, fraction=1.0)
            self.outcome = self._outcome(Code.SUCCESSFUL, self.warning)
        else:
            self.outcome = self._outcome(self._end.code, str(self._end))

    def _outcome(self, code: Code, message: str) -> Outcome:
        return Outcome(code, message, self._completed, replans=self._replans)

    def _run(self) -> Iterator[None]:
        yield from self._all_stiff()
        for index, shape in enumerate(self._shapes):
            self._index = index
            self._report(Phase.PREPARING, segment=0)
            if self._held:
                yield from self._all_stiff()
            yield from self._set_or_plan_again(shape)
            yield from self._hold(shape)
            self._completed += 1

    def _set_or_plan_again(self, shape: Shape) -> Iterator[None]:
        """Set a shape; whenever its plan must not be followed any further, by a new one."""
        for left in reversed(range(self._settings.max_replans + 1)):
            try:
                yield from self._set(shape)
                yield from self._relax(shape)
            except PlanInvalidError as reason:
                self.plan = None
                if not left:
                    raise EndError(reason.code, f'{reason}; replanned '
                                                f'{self._settings.max_replans} times') from None
                self._replans += 1
                yield from self._wind_down()
                yield from self._all_stiff()
                self._report(Phase.PREPARING, segment=0)
            else:
                return

    def _plan_of(self, shape: Shape) -> Generator[None, None, ShapePlan]:
        """Plan a shape, from an arm of which every segment is stiff."""
        self.plan, self.move = None, 0
        plan = self.plan = (yield from self._planned(self._plan([shape])))[0]
        if plan.paths:
            yield  # what is observed from now on is of this plan
        while self._observed.unseen:  # an obstacle may have come while it was made
            self._check_stiff(None)
            yield
        return plan

    def _set(self, shape: Shape) -> Iterator[None]:
        """Set a shape, from an arm of which every segment is stiff."""
        moves = (yield from self._plan_of(shape)).moves
        for self.move, move in enumerate(moves):
            self._check_plan()
            done, part = self.move / len(moves), 1.0 / len(moves)
            self._report(Phase.SOFTENING, done, segment=move.segment + 1)
            yield from self._switch(move.segment, False)
            self._report(Phase.MOVING, done + 0.3 * part)
            yield from self._move(move, done + 0.3 * part, 0.4 * part)
            self._report(Phase.STIFFENING, done + 0.7 * part)
            yield from self._switch(move.segment, True)
        self.move = len(moves)

    def _relax(self, shape: Shape) -> Iterator[None]:
        """Lower the vacuums of a shape that is set, one after the other."""
        def lowered() -> bool:
            self._check_plan()
            return self._off(segment) <= self._settings.vacuum_tolerance

        lower = [(segment, vacuum) for segment, vacuum in enumerate(shape.vacuums)
                 if abs(vacuum - self._settings.full_vacuum) > 1.0]
        for segment, vacuum in lower:
            self._report(Phase.RELAXING, 1.0, segment=segment + 1)
            self._check_plan()
            self._held[segment] = vacuum
            yield from self._request(
                segment, partial(self._port.set_vacuum, segment, vacuum), lowered,
                f'follow its regulator, which was set to {vacuum / 1e3:.1f} kPa,')
        if self._held:
            yield from self._settle()
        if shape.vacuums and self.plan is not None:
            self.move += 1
            self.warning = self.plan.warning

    def _settle(self) -> Iterator[None]:
        """Wait until no vacuum changes any more, since the arm relaxes meanwhile."""
        begin, since, before = self._now, self._now, self._observed.vacuum
        while self._now < min(since + SETTLED[0], begin + self._settings.settle_timeout):
            if any(abs(a - b) > SETTLED[1]
                   for a, b in zip(self._observed.vacuum, before, strict=True)):
                before, since = self._observed.vacuum, self._now
            self._check_stiff(None)
            self._check_plan()
            yield

    def _off(self, segment: int) -> float:  # Pa, from the vacuum that it is held with
        return abs(self._observed.vacuum[segment] - self._held[segment])

    def _hold(self, shape: Shape) -> Iterator[None]:
        """Hold a shape, with every segment stiff but those that have less vacuum."""
        self._report(Phase.HOLDING, 1.0, segment=0)
        until = self._now + shape.hold_time
        while self._now < until:
            self._check_stiff(None)
            yield

    def _report(self, phase: Phase, part: float = 0.0, segment: int | None = None) -> None:
        """Report a phase of the running shape, and the part of it that is done, if more."""
        self.progress = replace(
            self.progress, shape_index=self._index, shape=self._shapes[self._index].name,
            segment=self.progress.segment if segment is None else segment, phase=phase,
            fraction=max(self.progress.fraction, (self._index + part) / len(self._shapes)))

    def _planned(self, plan: 'Future[Result]', soft: int | None = None
                 ) -> Generator[None, None, Result]:
        """Wait for a plan, with every segment stiff but ``soft``."""
        while not plan.done():
            self._check_stiff(soft)
            yield
        error = plan.exception()
        if error is None:
            return plan.result()
        obstructed = isinstance(error, ObstructedError)
        raise EndError(Code.OBSTRUCTED if obstructed else Code.MODEL_FAILURE, failure_text(error))

    def _all_stiff(self) -> Iterator[None]:
        """Stiffen what is not stiff; plans start from a stiff arm at rest, as the model has it."""
        yield from self._stiffen_all(
            [i for i in range(len(self._observed.stiff)) if not self._is_stiff(i)])
        self._held.clear()
        deadline = self._now + self._settings.settle_timeout
        while self._observed.moving or not self._observed.agreed:
            if self._now > deadline:
                what = ('the tendons did not come to rest' if self._observed.moving else
                        'kinematics did not report the arm stiff, with the vacuums that it has,')
                raise EndError(
                    Code.TIMEOUT, f'{what} within {self._settings.settle_timeout:g} s')
            yield

    def _is_stiff(self, segment: int) -> bool:
        """Whether a segment is stiff; with a regulator, also whether it has its full vacuum."""
        observed, settings = self._observed, self._settings
        full = settings.full_vacuum - settings.vacuum_tolerance
        return observed.stiff[segment] and (
            not observed.regulators or observed.vacuum[segment] >= full)

    def _stiffen_all(self, segments: Sequence[int]) -> Iterator[None]:
        """Stiffen several segments at once; every one is requested before any is waited for."""
        if not self._settings.jamming:
            return
        deadline = self._now + self._settings.jamming_timeout
        requested = -np.inf
        while segments:
            if self._observed.lost_valves:
                raise EndError(Code.HARDWARE_FAULT, 'the segments are left as they are: '
                                                    'jamming_valves is stale')
            if self._now >= requested + self._settings.retry:
                for segment in segments:
                    self._port.set_stiff(segment, True)
                requested = self._now
                yield
                continue
            soft = [i for i in segments if not self._is_stiff(i)]
            if not soft:
                return
            if self._now > deadline:
                raise EndError(
                    Code.TIMEOUT, f'{", ".join(f"segment {i + 1}" for i in soft)} did not become '
                    f'stiff within {self._settings.jamming_timeout:g} s')
            yield

    def _switch(self, segment: int, stiff: bool) -> Iterator[None]:
        """Soften or stiffen a segment, and wait until its vacuum says so."""
        def reached() -> bool:
            return self._is_stiff(segment) if stiff else (
                not self._observed.stiff[segment]
                and self._observed.vacuum[segment] <= self._settings.soft_vacuum)

        if self._settings.jamming:
            yield from self._request(segment, lambda: self._port.set_stiff(segment, stiff),
                                     reached, f'become {"stiff" if stiff else "soft"}')

    def _request(self, segment: int, request: Callable[[], None], reached: Callable[[], bool],
                 what: str) -> Iterator[None]:
        """Request something of a segment until it is reached; what: in words."""
        deadline = self._now + self._settings.jamming_timeout
        requested = -np.inf
        while True:
            if self._now >= requested + self._settings.retry:
                request()
                requested = self._now
                yield
                continue
            if reached() and self._observed.agreed:
                return
            if self._now > deadline:
                raise EndError(
                    Code.TIMEOUT,
                    f'segment {segment + 1} did not {what} within '
                    f'{self._settings.jamming_timeout:g} s; its vacuum is '
                    f'{self._observed.vacuum[segment] / 1e3:.1f} kPa')
            self._check_stiff(segment)
            yield

    def _move(self, move: Move, done: float = 0.0, part: float = 0.0) -> Iterator[None]:
        """Send the motion piece by piece, so that it ends soon when this process does."""
        self._motions += 1
        start, end, sent, settings = self._now, 0.0, 0.0, self._settings
        due = self._now
        while True:
            # After a pause longer than the horizon, go on from where the last piece ended.
            elapsed = min(self._now - start, end)
            if self._now - start > end:
                start = self._now - end
            if elapsed >= move.duration:
                break
            self._check_motion(move.segment)
            if sent < move.duration and self._now >= due:  # the last piece is sent once
                end = min(elapsed + settings.horizon, move.duration)
                # The first has where it begins too: it is followed from there, however late.
                inside = ((move.times > elapsed) | (sent == 0.0)) & (move.times < end)
                times = np.append(move.times[inside], end)
                pulls = np.stack(
                    [np.interp(times, move.times, tendon) for tendon in move.pulls.T], axis=1)
                self._port.follow(self._motions, start, times, pulls)
                sent, due = end, self._now + settings.piece_period
            self._report(Phase.MOVING, done + part * elapsed / move.duration)
            yield
        deadline = self._now + settings.settle_timeout
        target = move.pulls[-1]
        while not self._observed.rests_at(target, settings.settle_tolerance):
            self._check_motion(move.segment)
            if self._now > deadline:
                where = ', '.join(
                    f'{name} is at {pull * 1e3:.3f} mm instead of {planned * 1e3:.3f} mm'
                    for name, pull, planned in zip(
                        self._tendons, self._observed.pulls, target, strict=True))
                raise EndError(Code.TIMEOUT, f'{where} after {settings.settle_timeout:g} s')
            yield

    def _check_motion(self, segment: int) -> None:
        self._check_stiff(segment)
        if failure := self._observed.motion_failure:
            raise EndError(failure.code, failure.message)
        if self._settings.jamming and self._observed.stiff[segment]:
            raise EndError(Code.HARDWARE_FAULT,
                            f'segment {segment + 1} was stiffened during its motion')
        self._check_plan()

    def _check_plan(self) -> None:
        """Leave the plan when an obstacle is in its way or the arm is too far from it."""
        if obstructed := self._observed.obstructed:
            error = EndError if self._settings.on_obstacle == ABORT else PlanInvalidError
            raise error(Code.OBSTRUCTED, obstructed)
        if departed := self._observed.departed:
            raise PlanInvalidError(Code.HARDWARE_FAULT, departed)

    def _check_stiff(self, soft: int | None) -> None:
        """Every segment but the one being set must stay stiff, or with the vacuum it was told."""
        if not self._settings.jamming:
            return
        for segment, stiff in enumerate(self._observed.stiff):
            if segment == soft:
                continue
            if segment in self._held:
                if self._off(segment) > LOST * self._settings.vacuum_tolerance:
                    raise EndError(
                        Code.HARDWARE_FAULT, f'segment {segment + 1} lost its vacuum: it has '
                        f'{self._observed.vacuum[segment] / 1e3:.1f} kPa and was set to '
                        f'{self._held[segment] / 1e3:.1f} kPa')
            elif not stiff:
                raise EndError(Code.HARDWARE_FAULT,
                                f'segment {segment + 1} lost its stiffness')

    def _wind_down(self) -> Iterator[None]:
        """Brake, then stiffen every segment that is not stiff."""
        deadline = self._now + self._settings.settle_timeout
        self._port.hold()
        yield
        while (self._observed.moving and not self._observed.lost_tendons
               and self._now < deadline):
            yield
        # Also the segment that was last requested to soften, whatever its state was since.
        wanted = [i for i in range(len(self._observed.stiff))
                  if not self._is_stiff(i) or i + 1 == self.progress.segment]
        self._held.clear()
        if self._settings.jamming:
            self.progress = replace(self.progress, phase=Phase.STIFFENING)
        yield from self._stiffen_all(wanted)
