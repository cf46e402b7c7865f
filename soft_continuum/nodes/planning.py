# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans from the present state of the arm, as reported by kinematics, on a separate thread."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from math import inf
from threading import Event
from typing import Any, TypeVar

from soft_continuum.mechanics.arm import Arm
from soft_continuum.mechanics.chain import Chain, Equilibrium
from soft_continuum.mechanics.directions import bending_vectors
from soft_continuum.nodes.arm_observer import ArmObserver
from soft_continuum.obstacles import CollisionScene
from soft_continuum.sequencing.aiming import Aim, next_step, segments_worth_correcting, Step
from soft_continuum.sequencing.closed_loop import Loop
from soft_continuum.sequencing.kept_plans import KeptPlans
from soft_continuum.sequencing.planner import Planner, PlanSettings
from soft_continuum.sequencing.plans import PlanError, Reach, Shape, ShapePlan
from soft_continuum.sequencing.reach import ReachSettings
from soft_continuum.sequencing.settings import reach_from_parameters
from soft_continuum.sequencing.shape_plans import plan_shapes, plans_of, plans_to
from soft_continuum_interfaces.action import RunShapeSequence

Result = TypeVar('Result')


class PlanningThread:
    """Makes one plan at a time; an abandoned plan ends after a few milliseconds."""

    def __init__(self) -> None:
        """Start the thread."""
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix='planner')
        self._abandoned = Event()

    def start(self, work: Callable[[Any], Result], arm: Arm, offsets: Sequence[float],
              settings: PlanSettings) -> 'Future[Result]':
        """
        Abandon the present plan and begin the next one.

        work: called with a planner of ``arm``, whose tendons have ``offsets`` (tendons,) m.
        """
        self.abandon()
        abandoned = self._abandoned = Event()
        return self._thread.submit(
            lambda: work(Planner(arm, settings, abandoned.is_set, offsets)))

    def abandon(self) -> None:
        """End the present plan, if there is one, with a PlanError."""
        self._abandoned.set()

    def close(self) -> None:
        """Abandon the present plan and end the thread."""
        self.abandon()
        self._thread.shutdown()


class Planning:
    """Begins to plan; only the newest plan is made."""

    def __init__(self, arm: Arm, parameters: Mapping[str, Any], observed: ArmObserver,
                 scene: Callable[[], CollisionScene], warn: Callable[[str], None]) -> None:
        """
        Plan for ``arm`` as ``observed``, within the limits of the parameters.

        warn: called when a search ended early, on the planning thread.
        """
        self._arm, self._parameters, self._observed = arm, parameters, observed
        self._scene, self._warn, self._kept = scene, warn, KeptPlans()
        self._thread = PlanningThread()
        self.abandon, self.close = self._thread.abandon, self._thread.close

    def plan(self, shapes: Sequence[Shape], first: bool = False) -> 'Future[list[ShapePlan]]':
        """
        Begin to plan shapes one after the other; the future raises PlanError if one has none.

        Plans of ``explain`` are reused while nothing has changed.  first: take the first plan
        found.
        """
        around = self._scene()
        if kept := self._shown(shapes, take=not first):
            self.abandon()
            shown: Future[list[ShapePlan]] = Future()
            shown.set_result(kept)
            return shown
        settings = reach_from_parameters(self._parameters)
        return self._start(lambda planner, state, pulls: plans_of(shapes, self._searched(
            planner, state, pulls, shapes, around, settings, first)))

    def explain(self, shapes: Sequence[Shape], time_limit: float, states: int
                ) -> 'Future[list[Reach]]':
        """Begin to plan shapes, up to the first that fails; time_limit, states: 0: as ``plan``."""
        situation, around = self._situation, self._scene()
        settings = reach_from_parameters(self._parameters)
        settings = replace(settings, time_limit=time_limit or settings.time_limit,
                           states=states or settings.states)

        def explained(planner: Any, state: Any, pulls: tuple[float, ...]) -> list[Reach]:
            found = list(self._searched(planner, state, pulls, shapes, around, settings))
            self._kept.keep(situation, state, pulls, shapes, found)
            return found

        return self._start(explained)

    @property
    def _situation(self) -> object:
        """What must be equal for a plan to hold, besides where the arm is."""
        return (self._observed.tendons.stops, self._scene(),
                PlanSettings.of(self._parameters), reach_from_parameters(self._parameters))

    def _shown(self, shapes: Sequence[Shape], take: bool) -> list[ShapePlan]:
        """Return what ``explain`` answered for shapes; none if it did not, or all has changed."""
        state, observed = self._observed.shape, self._observed.observation(None, '')
        return [] if state is None else self._kept.find(
            self._situation, state.bending,
            lambda pulls: observed.rests_at(pulls, self._parameters['settle_tolerance']),
            shapes, self._parameters['angle_tolerance'], take)

    def _searched(self, planner: Any, state: Any, pulls: Sequence[float], shapes: Sequence[Shape],
                  around: CollisionScene, settings: ReachSettings, first: bool = False
                  ) -> Iterator[Reach]:
        """As plan_shapes; warns of searches that the time limit ended."""
        for shape, found in zip(shapes, plan_shapes(
                planner, state, pulls, shapes, around, settings, first), strict=False):
            if found.cut_short:
                self._warn(f'{shape.name}: reach.time_limit ended the search for a plan; more '
                           'time may give a better one')
            yield found

    def loop(self, aim: int) -> Loop:
        """Return the planning functions of a run by measurements; aim: of RunShapeSequence."""
        return Loop(partial(self._aim, aim), self._step, self._again,
                    lambda: self._observed.shape)

    def _aim(self, kind: int, shape: Shape) -> 'Future[Aim]':
        settings, arm = PlanSettings.of(self._parameters), self._arm
        return self._start(lambda *_: aim_of(shape, kind, arm, settings))

    def _step(self, segments: Sequence[int], aim: Aim) -> 'Future[Step]':
        dead_band = self._parameters['loop.dead_band']
        return self._start(lambda planner, state, pulls: next_step(
            planner, state, pulls, segments, aim, dead_band))

    def _again(self, segments: Sequence[int], aim: Aim, release_limit: float
               ) -> 'Future[tuple[int, ...]]':
        jamming = self._parameters['arm.jamming']
        lock_in = self._parameters['loop.lock_in_stddev'] if jamming else 0.0
        # What is set again was not planned among obstacles: it must hardly move the arm.
        near = self._parameters['obstacles.margin'] if self._scene().obstacles else inf
        return self._start(lambda planner, state, pulls: segments_worth_correcting(
            planner, state, pulls, segments, aim, lock_in, min(release_limit, near)))

    def _start(self, work: Callable[[Any, Any, tuple[float, ...]], Result]) -> 'Future[Result]':
        known, pulls = self._observed.shape_and_model, self._observed.pulls
        if known is None:
            failed: Future[Result] = Future()
            failed.set_exception(PlanError('the shape of the arm is no longer known'))
            return failed
        state, model = known
        return self._thread.start(
            lambda planner: work(planner, state, pulls), model.chain.arm, model.offsets.tolist(),
            PlanSettings.of(self._parameters).with_slack_for(model.offset_stddevs))


def aim_of(shape: Shape, kind: int, arm: Arm, settings: PlanSettings) -> Aim:
    """
    Return the aim of a planned shape; kind: of RunShapeSequence.

    The tip is that of its last tip goal; for angles, that of the described ``arm``, set from
    straight.
    """
    if shape.tips:
        return tip_aim(shape, arm)
    bending = bending_vectors(arm, shape.bending_angles, shape.bending_directions)
    chain = Chain(arm)
    state: Equilibrium
    try:
        state = plans_to(Planner(arm, settings), [shape])[0].state
    except PlanError:  # it can be reached from the present shape only
        state = chain.uniform(bending)
    return Aim(bending, state.backbone[-1], kind == RunShapeSequence.Goal.TIP)


def tip_aim(shape: Shape, arm: Arm) -> Aim:
    """Return the aim of a shape planned to tip goals: the last of them."""
    return Aim(bending_vectors(arm, shape.bending_angles, shape.bending_directions),
               shape.tips[-1].position, on_tip=True)
