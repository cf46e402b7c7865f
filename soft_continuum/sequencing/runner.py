# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The state machine that runs shapes: all stiff, soften one, move, stiffen, wait, next.

A Runner is ticked with what is observed of the arm and acts through an ArmPort.  At most one
segment is softened at a time.  Whatever ends a run early, other than a stop, ends with tendons at
rest and every segment stiff; a stop leaves everything as it is.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Protocol

import numpy as np

from soft_continuum.mechanics.chain import Array
from soft_continuum.sequencing.planner import Move, PlanError, Shape, ShapePlan


class Code(IntEnum):
    """How a run ended; the values of error_code in RunShapeSequence's result."""

    SUCCESSFUL = 0
    PREEMPTED = -1
    CANCELED = -2
    STOPPED = -3
    TIMEOUT = -4
    HARDWARE_FAULT = -5
    MODEL_FAILURE = -6


PREPARING, SOFTENING, MOVING, STIFFENING, HOLDING = (
    'preparing', 'softening', 'moving', 'stiffening', 'holding')


@dataclass(frozen=True)
class Observation:
    """
    What is known of the arm at one tick.

    pulls: (2,) m.  moving: whether a tendon moves.  stiff: per segment, confirmed by pressure.
    vacuum: per segment, Pa below ambient.  stopped: why tendon motion is stopped.  fault: why
    the arm cannot be operated, such as a silent node.  refused: why the last motion was refused.
    """

    pulls: tuple[float, float]
    moving: bool
    stiff: tuple[bool, ...]
    vacuum: tuple[float, ...]
    stopped: str = ''
    fault: str = ''
    refused: str = ''


class ArmPort(Protocol):
    """How a Runner acts on the arm; every call may be repeated without harm."""

    def set_stiff(self, segment: int, stiff: bool) -> None:
        """Ask for a segment (0-based) to be evacuated or vented."""

    def follow(self, start: float, times: Array, pulls: Array) -> None:
        """Ask for the pulls (k, 2) m at ``start + times`` s, on the clock of the ticks."""

    def hold(self) -> None:
        """Ask the tendons to brake and hold."""


@dataclass(frozen=True)
class RunnerSettings:
    """
    Deadlines and tolerances.

    jamming_timeout, settle_timeout: s.  settle_tolerance: m.  soft_vacuum: Pa below ambient up to
    which a segment is soft.  horizon: s of motion sent ahead, so that the tendons stop by
    themselves soon after the sequencer is gone.  retry: s between repeated requests.
    """

    jamming_timeout: float = 10.0
    settle_timeout: float = 5.0
    settle_tolerance: float = 2e-5
    soft_vacuum: float = 10e3
    horizon: float = 0.5
    retry: float = 2.0


@dataclass(frozen=True)
class Progress:
    """Where a run is: shape (0-based), segment (1-based, 0: whole arm), phase, part done 0-1."""

    shape_index: int = 0
    shape: str = ''
    segment: int = 0
    phase: str = PREPARING
    fraction: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """How a run ended, and how many shapes were completed."""

    code: Code
    message: str
    shapes_completed: int


class _EndError(Exception):
    """Ends the run with a code and a reason."""

    def __init__(self, code: Code, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class Runner:
    """Runs shapes one after the other; ``outcome`` is set when it has ended."""

    def __init__(self, shapes: Sequence[Shape], plan: Callable[[Shape], ShapePlan],
                 port: ArmPort, settings: RunnerSettings) -> None:
        """Plan every shape with ``plan`` (raises PlanError) when its turn comes."""
        self.progress = Progress(shape=shapes[0].name)
        self.outcome: Outcome | None = None
        self._shapes = shapes
        self._plan = plan
        self._port = port
        self._settings = settings
        self._completed = 0
        self._now = 0.0
        self._seen = Observation((0.0, 0.0), False, (), ())
        self._script = self._run()
        self._end: _EndError | None = None
        self._winding_down = False

    def cancel(self, code: Code, reason: str) -> None:
        """End the run at the next tick: stop the motion, stiffen every segment."""
        if self._end is None:
            self._end = _EndError(code, reason)

    def tick(self, now: float, observation: Observation) -> None:
        """Go on, at time ``now`` (s, on the clock of the motion), with what is observed."""
        if self.outcome is not None:
            return
        self._now, self._seen = now, observation
        try:
            if observation.stopped:
                raise _EndError(Code.STOPPED, f'stopped: {observation.stopped}')
            if not self._winding_down:
                if self._end is not None:
                    raise self._end
                if observation.fault:
                    raise _EndError(Code.HARDWARE_FAULT, observation.fault)
            next(self._script)
        except StopIteration:
            self._finish()
        except _EndError as end:
            if end.code is Code.STOPPED or self._winding_down:
                self._end = end if end.code is Code.STOPPED else self._worse(end)
                self._finish()
            else:
                self._end = end
                self._winding_down = True
                self._script = self._wind_down()
                self.tick(now, observation)

    def _worse(self, end: _EndError) -> _EndError:
        first = self._end or end
        return _EndError(first.code, f'{first}; then {end}')

    def _finish(self) -> None:
        if self._end is None:
            self.progress = replace(self.progress, fraction=1.0)
            self.outcome = Outcome(Code.SUCCESSFUL, '', self._completed)
        else:
            self.outcome = Outcome(self._end.code, str(self._end), self._completed)

    def _run(self) -> Iterator[None]:
        yield from self._all_stiff()
        for index, shape in enumerate(self._shapes):
            self._at(index, 0.0, phase=PREPARING, segment=0)
            try:
                moves = self._plan(shape).moves
            except PlanError as error:
                raise _EndError(Code.MODEL_FAILURE, str(error)) from None
            except Exception as error:
                raise _EndError(
                    Code.MODEL_FAILURE, f'{type(error).__name__}: {error}') from error
            for number, move in enumerate(moves):
                done = number / len(moves)
                part = 1.0 / len(moves)
                self._at(index, done, phase=SOFTENING, segment=move.segment + 1)
                yield from self._soften(move.segment)
                self._at(index, done + 0.3 * part, phase=MOVING)
                yield from self._move(move, index, done + 0.3 * part, 0.4 * part)
                self._at(index, done + 0.7 * part, phase=STIFFENING)
                yield from self._stiffen(move.segment)
            self._at(index, 1.0, phase=HOLDING, segment=0)
            until = self._now + shape.hold_time
            while self._now < until:
                self._check_stiff(None)
                yield
            self._completed += 1

    def _at(self, index: int, part: float, phase: str | None = None,
            segment: int | None = None) -> None:
        self.progress = Progress(
            index, self._shapes[index].name,
            self.progress.segment if segment is None else segment,
            phase or self.progress.phase, (index + part) / len(self._shapes))

    def _all_stiff(self) -> Iterator[None]:
        """Stiffen what is not stiff; the shape may only be planned from a locked arm."""
        yield from self._stiffen_all(
            [i for i, stiff in enumerate(self._seen.stiff) if not stiff])
        deadline = self._now + self._settings.settle_timeout
        while self._seen.moving:
            if self._now > deadline:
                raise _EndError(Code.TIMEOUT, 'the tendons do not come to rest')
            yield

    def _soften(self, segment: int) -> Iterator[None]:
        def softened() -> bool:
            return (not self._seen.stiff[segment]
                    and self._seen.vacuum[segment] <= self._settings.soft_vacuum)

        yield from self._switch(segment, False, softened)

    def _stiffen(self, segment: int) -> Iterator[None]:
        yield from self._switch(segment, True, lambda: self._seen.stiff[segment])

    def _stiffen_all(self, segments: Sequence[int]) -> Iterator[None]:
        """Stiffen several segments at once; every one is asked for before any is waited for."""
        deadline = self._now + self._settings.jamming_timeout
        asked = -np.inf
        while segments:
            if self._now >= asked + self._settings.retry:
                for segment in segments:
                    self._port.set_stiff(segment, True)
                asked = self._now
                yield
                continue
            soft = [i for i in segments if not self._seen.stiff[i]]
            if not soft:
                return
            if self._now > deadline:
                raise _EndError(
                    Code.TIMEOUT, f'{", ".join(f"segment {i + 1}" for i in soft)} did not become '
                    f'stiff within {self._settings.jamming_timeout:g} s')
            yield

    def _switch(self, segment: int, stiff: bool, reached: Callable[[], bool]) -> Iterator[None]:
        deadline = self._now + self._settings.jamming_timeout
        asked = -np.inf
        while True:
            if self._now >= asked + self._settings.retry:
                self._port.set_stiff(segment, stiff)
                asked = self._now
                yield
                continue
            if reached():
                return
            if self._now > deadline:
                raise _EndError(
                    Code.TIMEOUT,
                    f'segment {segment + 1} did not become {"stiff" if stiff else "soft"} within '
                    f'{self._settings.jamming_timeout:g} s; its vacuum is '
                    f'{self._seen.vacuum[segment] / 1e3:.1f} kPa')
            self._check_stiff(segment)
            yield

    def _move(self, move: Move, index: int, done: float, part: float) -> Iterator[None]:
        """Send the motion piece by piece, so that it ends soon when this program does."""
        start, end, sent, settings = self._now, 0.0, 0.0, self._settings
        while True:
            # After a pause longer than what was sent ahead, go on from where that ended.
            elapsed = min(self._now - start, end)
            start = self._now - elapsed
            if elapsed >= move.duration:
                break
            self._check_motion(move.segment)
            end = min(elapsed + settings.horizon, move.duration)
            inside = (move.times > elapsed) & (move.times < end)
            if sent < move.duration:  # the end is sent once: what comes late is not too late
                times = np.append(move.times[inside], end)
                pulls = np.stack(
                    [np.interp(times, move.times, move.pulls[:, i]) for i in (0, 1)], axis=1)
                self._port.follow(start, times, pulls)
            sent = end
            self._at(index, done + part * elapsed / move.duration)
            yield
        deadline = self._now + settings.settle_timeout
        while self._seen.moving or np.abs(
                np.subtract(self._seen.pulls, move.pulls[-1])).max() > settings.settle_tolerance:
            self._check_motion(move.segment)
            if self._now > deadline:
                raise _EndError(
                    Code.TIMEOUT,
                    f'the tendons are at {self._seen.pulls[0] * 1e3:.3f}, '
                    f'{self._seen.pulls[1] * 1e3:.3f} mm instead of {move.pulls[-1][0] * 1e3:.3f}'
                    f', {move.pulls[-1][1] * 1e3:.3f} mm after {settings.settle_timeout:g} s')
            yield

    def _check_motion(self, segment: int) -> None:
        self._check_stiff(segment)
        if self._seen.refused:
            raise _EndError(Code.HARDWARE_FAULT,
                            f'the tendon motion was refused: {self._seen.refused}')
        if self._seen.stiff[segment]:
            raise _EndError(Code.HARDWARE_FAULT,
                            f'segment {segment + 1} was stiffened during its motion')

    def _check_stiff(self, soft: int | None) -> None:
        """Every segment but the one being set must stay stiff."""
        for segment, stiff in enumerate(self._seen.stiff):
            if segment != soft and not stiff:
                raise _EndError(Code.HARDWARE_FAULT,
                                f'segment {segment + 1} lost its stiffness')

    def _wind_down(self) -> Iterator[None]:
        """Brake, then stiffen every segment that is not stiff."""
        deadline = self._now + self._settings.settle_timeout
        self._port.hold()
        yield
        while self._seen.moving and self._now < deadline:
            yield
        # Also the segment that was last asked to soften, whatever has been heard of it.
        wanted = [i for i, stiff in enumerate(self._seen.stiff)
                  if not stiff or i + 1 == self.progress.segment]
        self.progress = replace(self.progress, phase=STIFFENING)
        yield from self._stiffen_all(wanted)
