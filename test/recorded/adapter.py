# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The only module of the recorded numbers that knows what the suite's functions are called.

Whoever renames, moves or merges them changes this module, and neither the questions (``arms/``)
nor the answers (``numbers/``).  All that goes in and comes out has the form of a spatial arm: SI
units, bending about x and y of the disc below (segments, 2), poses as position and quaternion.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from soft_continuum.mechanics import (
    bending_for_tip,
    constant_curvature,
    pulls_for_bending,
    set_shape,
)
from soft_continuum.mechanics.arm import Wrench
from soft_continuum.mechanics.chain import SLACK
from soft_continuum.mechanics.sensitivity import Linearisation
from soft_continuum.mechanics.statics import PRETENSIONS, Statics
from soft_continuum.parameters.arm import arm_from_parameters
from soft_continuum.planning.obstacles import Box, CollisionScene, Obstacle, Sphere
from soft_continuum.planning.planner import Planner, PlanSettings
from soft_continuum.planning.plans import Shape, TipGoal
from soft_continuum.planning.reach import ReachSettings
from soft_continuum.planning.shape_plans import plan_shapes, plans_to

Numbers = dict[str, Any]
SHAPES = {'box': lambda o: Box(tuple(o['size'])), 'sphere': lambda o: Sphere(o['radius'])}


class Model:
    """An arm of a question, as today's suite computes with it."""

    def __init__(self, question: Mapping[str, Any]) -> None:
        """Build the arm of its parameters, and of what no parameter describes."""
        arm = arm_from_parameters(question['parameters'])
        rubbing = question.get('segment_friction', [{}] * len(arm.segments))
        arm = replace(
            arm, gravity=tuple(question.get('gravity', arm.gravity)),
            wrenches=tuple(Wrench(load['disc'], tuple(load['force']), tuple(load['moment']))
                           for load in question.get('loads', ())),
            segments=tuple(replace(segment, **friction) for segment, friction in zip(
                arm.segments, rubbing, strict=True)))
        self.planar = arm.planar
        self.arm, self.statics = arm, Statics(arm)
        self.jamming = question['parameters'].get('arm.jamming', True)

    # Solves.

    def straight(self) -> Any:
        """Return the straight arm."""
        return self.statics.chain.straight()

    def solve(self, state: Any, soft: Sequence[bool], *, pulls: Sequence[float],
              vacuum: Sequence[float] | None = None, sliding: Sequence[int] = ()) -> Any:
        """Return the equilibrium for pulls, m, of which -inf is one that never carries."""
        more = {'sliding': sliding} if len(sliding) else {}
        return self.statics.solve(
            state, [SLACK if pull == -np.inf else pull for pull in pulls], soft, vacuum=vacuum,
            **more)

    def solve_tensions(self, state: Any, soft: Sequence[bool], tensions: Sequence[float]) -> Any:
        """Return the equilibrium for tensions, N."""
        if self.planar:
            return self.statics.solve_tensions(state, tensions, soft)
        return self.statics.solve(state, state.pulls, soft, tensions=tensions)

    def bend(self, state: Any, soft: Sequence[bool], bending: np.ndarray) -> Any:
        """Return the state in which soft segments have a bending, as a plan holds them."""
        return self.statics.hold(state, bending, soft, pretensions=PRETENSIONS[::-1]).state

    # Numbers of a state.

    def state(self, state: Any, sliding: Sequence[int] = ()) -> Numbers:
        """Return all numbers of a state."""
        discs = np.array(state.poses[1::2])
        discs[discs[:, 6] < 0.0, 3:] *= -1.0  # of the two quaternions of a rotation, one
        more = {'sliding': sliding} if len(sliding) else {}
        # With SLACK, what is recorded of spatial arms is 0; since then it is inf as in the plane.
        endless = np.isinf(state.slack) & (not self.planar)
        found = {
            'discs': discs, 'joints': self._joints(state.coordinates),
            'bending': state.bending, 'paths': state.pulls,
            'motors': self.statics.commanded_pulls(state, **more),
            'tensions': state.tensions, 'slack': np.where(endless, 0.0, state.slack),
            'jumped': bool(state.jumped)}
        if any(state.stiff) and any(not segment.jam.rigid for segment in self.arm.segments):
            found['held'] = self._joints(state.held_coordinates)
        if self.planar:
            found['energy_if_all_were_soft'] = state.chain.energy(state.joint_angles)
        return found

    def derivatives(self, state: Any, sliding: Sequence[int] = ()) -> Numbers:
        """
        Return how tip (6,), tensions and paths change with what the arm is and with its pulls.

        By a factor of the stiffness of each segment, its K, the shape that it holds (in the plane
        about y only), the pulls, a payload and forces on the discs (in the plane x and z only).
        """
        line: Any = Linearisation(self.statics, state, sliding)
        found = {name: self._of(derivative) for name, derivative in (
            ('pulls', line.pulls()), ('ratio', line.stiffness_ratio()),
            ('held', line.held_shape()), ('payload', line.payload()), ('forces', line.forces()))}
        if self.planar:
            in_plane = np.arange(3 * len(self.arm.segments)) % 3 != 1
            found['forces'] = {
                name: value[..., in_plane] for name, value in found['forces'].items()}
            found['held'] = {name: value[..., 1::2] for name, value in found['held'].items()}
        if not self.planar:
            found['stiffness'] = self._of(line.stiffness_factors())
        elif all(segment.soft_law is None for segment in self.arm.segments):
            each = [segment.stiffness_y for segment in self.arm.segments]
            found['stiffness'] = {name: value * each for name, value in self._of(
                line.bending_stiffness()).items()}
        return found

    def _of(self, derivative: Any) -> Numbers:
        return {'tip': derivative.tip, 'tensions': derivative.tensions, 'paths': derivative.paths}

    # The other way.

    def set_shape(self, bending: np.ndarray, order: Sequence[int] | None) -> Any:
        """Return the arm with its segments set one after the other."""
        return set_shape(self.statics, bending, None, order)

    def pulls_for(self, state: Any, bending: np.ndarray, soft: Sequence[bool], pretension: float
                  ) -> tuple[Any, np.ndarray]:
        """Return the state, and the pulls, of several soft segments of a spatial arm."""
        fit = pulls_for_bending(
            self.statics, state, np.where(np.array(soft)[:, None], bending, np.nan), soft,
            pretension=pretension)
        return fit.state, fit.pulls

    def for_tip(self, position: Sequence[float]) -> tuple[tuple[int, ...], Any]:
        """Return which segments are softened, and the state whose tip is there."""
        fit = bending_for_tip(self.statics, position)
        return fit.softened, fit.state

    def arcs(self, bending: np.ndarray) -> Numbers:
        """Return pulls and place of the tip, by constant curvature."""
        places, _ = constant_curvature.poses(self.arm, bending)
        return {'pulls': constant_curvature.pulls(self.arm, bending), 'tip': places[-1]}

    # Plans.

    def plans(self, shapes: Sequence[Mapping[str, Any]], limits: Mapping[str, Any]
              ) -> list[Numbers]:
        """Return the plans to shapes, one after the other, from the straight arm."""
        planner = self._planner(limits)
        found = plans_to(planner, [self._shape(shape) for shape in shapes])
        return [self._plan(plan) for plan in found]

    def tip_plan(self, goal: Mapping[str, Any], limits: Mapping[str, Any],
                 search: Mapping[str, Any], time_limit: float) -> Numbers:
        """Return the first plan that is found to a goal of the tip, from the straight arm."""
        obstacles = [Obstacle(o['name'], SHAPES[o['shape']](o), tuple(o['position']))
                     for o in goal.get('obstacles', ())]
        tip = TipGoal(goal['position'], position_tolerance=search['position_tolerance'],
                      angle_tolerance=search['angle_tolerance'])
        settings = ReachSettings(time_limit=time_limit, **{name: search[name] for name in (
            'margin', 'lock_in', 'softening_time', 'max_softenings', 'seed')})
        found, = plan_shapes(
            self._planner(limits), self.straight(), [0.0] * len(self.arm.tendon_names),
            [Shape('tip', (), tips=(tip,))], CollisionScene(self.arm, obstacles),
            settings, first=True)
        assert found.plan is not None and not found.why, found.why
        clearance, nearest = found.clearance
        return {'plan': self._plan(found.plan), 'tip_error': found.tip_error,
                'turn_error': found.turn_error, 'softenings': found.softenings,
                'clearance': clearance, 'nearest': nearest}

    def _planner(self, limits: Mapping[str, Any]) -> Any:
        return Planner(self.arm, PlanSettings(
            tuple(limits['pulls']), limits['tension'], limits['slack'], limits['speed'],
            limits['acceleration'], limits['step'], limits['tolerance'], self.jamming,
            limits['full_vacuum']))

    def _shape(self, shape: Mapping[str, Any]) -> Shape:
        bending = np.array(shape['bending'])
        vacuums = tuple(shape.get('vacuums', ()))
        if self.planar:
            return Shape('wanted', tuple(bending[:, 1].tolist()), vacuums=vacuums)
        return Shape('wanted', tuple(np.linalg.norm(bending, axis=1).tolist()), 0.0,
                     tuple(np.arctan2(-bending[:, 0], bending[:, 1]).tolist()), vacuums=vacuums)

    def _plan(self, plan: Any) -> Numbers:
        return {'moves': [{
            'segment': move.segment, 'rows': len(move.pulls), 'duration': move.duration,
            'tension': move.largest_tension, 'sliding': list(move.sliding),
            'pulls': move.pulls[np.unique(np.linspace(0, len(move.pulls) - 1, 5).round().astype(
                int))]} for move in plan.moves], 'end': self.state(plan.state)}

    # Forms.

    def _joints(self, coordinates: np.ndarray) -> np.ndarray:
        """Return the rotation vector of every joint, (joints, 3)."""
        return np.insert(np.zeros((len(coordinates), 2)), 1, coordinates, axis=1) if (
            self.planar) else coordinates.reshape(-1, 3)
