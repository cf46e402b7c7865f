# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Error and cost of the models of section III of the paper, against the elastica."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import time

import numpy as np

from benchmarks import paper
from benchmarks.tables import machine, number, Section, table
from benchmarks.timing import interleave, progress, Sampler, sampler
from references.elastica import Elastica
from soft_continuum.mechanics import Arm, constant_curvature, RIGHT, Statics
from soft_continuum.mechanics.arm import Array, PAPER, SECOND_ORDER

FINE = 200  # bodies per segment of the chain in which the elastica's stiff segments are held
CHAINS = ((PAPER, 12), (SECOND_ORDER, 4), (SECOND_ORDER, 6), (SECOND_ORDER, 12))
NAMES = {PAPER: 'chain of the paper', SECOND_ORDER: 'second-order chain'}


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape: what is pulled, and where the elastica's calculation points are, (points, 3)."""

    name: str
    arm: Arm
    steps: list[paper.Step]
    true: Array
    uncertainty: float

    def error(self, points: Array) -> float:
        """Return the largest distance of points from the elastica's, % of the arm's length."""
        return _percent(self.arm, points, self.true)


def run(quick: bool) -> Section:
    """Compare the models and return the tables."""
    shapes, samplers = [], {}
    for gravity in (False, True):
        for form, signs in paper.FORMS.items():
            name = f'{form}{", gravity" if gravity else ""}'
            progress(name)
            arm = paper.arm(gravity)
            steps = paper.steps_of(Statics(arm), signs)
            true, coarse = _elastica(arm, steps, FINE), _elastica(arm, steps, FINE // 2)
            shapes.append(Shape(name, arm, steps, true, _percent(arm, coarse, true)))
    models = _models()
    errors = {name: [shape.error(model(shape.arm)(shape.steps)) for shape in shapes]
              for name, model in models.items()}
    for name, model in models.items():
        call = model(shapes[0].arm)
        samplers[name] = sampler(lambda c=call: c(shapes[0].steps))  # type: ignore[misc]
    samplers['elastica'] = _elastica_sampler(shapes[0])
    times = interleave(samplers, 7 if quick else 31, 0.5 if quick else 4.0)
    rows = [[name, *(number(e, 2) for e in each), number(times[name].median * 1e6)]
            for name, each in errors.items()]
    rows.append(['elastica', *(f'({number(s.uncertainty, 1)})' for s in shapes),
                 number(times['elastica'].median * 1e6)])
    head = ['error, % of the arm', *(s.name for s in shapes), 'µs for the C']
    return Section('benchmarks/accuracy.md', 'accuracy', f'{machine()}\n\n{table(head, rows)}')


Solver = Callable[[list[paper.Step]], Array]


def _models() -> dict[str, Callable[[Arm], Solver]]:
    """Return the models by name: from an arm to a function from steps to calculation points."""
    models: dict[str, Callable[[Arm], Solver]] = {'constant curvature': _constant_curvature}
    for discretisation, bodies in CHAINS:
        models[f'{NAMES[discretisation]}, n = {bodies}'] = _chain(discretisation, bodies)
    return models


def _constant_curvature(arm: Arm) -> Solver:
    def solve(steps: list[paper.Step]) -> Array:
        bending = np.zeros((len(arm.segments), 2))
        for step in steps:
            side = 1.0 if step.tendon == RIGHT else -1.0
            bending[step.segment, 1] = side * constant_curvature.bending_angle(
                arm, step.segment, step.change)
        return constant_curvature.poses(arm, bending)[0][:, [0, 2]]

    return solve


def _chain(discretisation: str, bodies: int) -> Callable[[Arm], Solver]:
    def prepare(arm: Arm) -> Solver:
        statics = Statics(replace(arm, discretisation=discretisation, bodies_per_segment=bodies))
        straight = statics.chain.straight()

        def solve(steps: list[paper.Step]) -> Array:
            return paper.walk(statics, steps, straight)[-1].points[:, ::2]

        return solve

    return prepare


def _elastica(arm: Arm, steps: list[paper.Step], bodies: int) -> Array:
    """Return the calculation points of the last step; the stiff segments are a fine polyline."""
    fine = replace(arm, discretisation=SECOND_ORDER, bodies_per_segment=bodies)
    rods, statics = Elastica(fine), Statics(fine)
    before = [statics.chain.straight(), *paper.walk(statics, steps)[:-1]]
    last = steps[-1]
    rod = rods.solve(before[-1], paper.pulls_of(last, before[-1]), paper.only(last.segment))
    points: Array = rod.points[:, :2]
    return points


def _elastica_sampler(shape: Shape) -> Sampler:
    """Return a sampler of the three boundary value problems, without the chain in between."""
    fine = replace(shape.arm, discretisation=SECOND_ORDER, bodies_per_segment=FINE)
    rods, statics = Elastica(fine), Statics(fine)
    before = [statics.chain.straight(), *paper.walk(statics, shape.steps)[:-1]]

    def run() -> float:
        begin = time.thread_time()
        for step, state in zip(shape.steps, before, strict=True):
            rods.solve(state, paper.pulls_of(step, state), paper.only(step.segment))
        return time.thread_time() - begin

    return run


def _percent(arm: Arm, points: Array, true: Array) -> float:
    return 100.0 * float(np.linalg.norm(points[:, :2] - true[:, :2], axis=1).max()) / arm.length
