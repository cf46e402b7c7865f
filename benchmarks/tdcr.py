# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
The example of tdcr-modeling beside its five models.

tdcr-modeling (Continuum Robotics Laboratory, MIT licence) belongs to Rao et al., "How to model
tendon-driven continuum robots and benchmark modelling performance", Frontiers in Robotics and AI
7, 2021.  Its tips were computed with its C++ code and are kept here as numbers; the loads were
raised from 0 in 20 steps where a model did not converge otherwise.
"""

from collections.abc import Sequence
from math import pi, radians

import numpy as np

from benchmarks.tables import machine, number, Section, table
from soft_continuum.mechanics.arm import Arm, Array, Disc, SECOND_ORDER, Segment, Tendon, Wrench
from soft_continuum.mechanics.chain import Equilibrium
from soft_continuum.mechanics.space.statics import SpaceStatics

LENGTH, SPACERS, OFFSET = 0.2, 9, 0.01  # m; spacers; m
BENDING = 54e9 * pi / 4.0 * 0.7e-3**4  # E I, N m^2
TWIST = BENDING / 1.3  # G J, N m^2: J = 2 I, G = E / 2.6
TENSIONS = (4.0, 0.0, 0.0, 0.0, 2.0, 0.0)  # N
LOADS = ((0.0, 0.0, 0.0), (0.05, -0.1, -0.1))  # N at the tip
MODELS = {
    'Cosserat rod, tendons curved with it': (
        (0.127607639, 0.143467346, 0.33640682), (0.284865506, -0.0424650784, 0.208107888)),
    'Cosserat rod between discs': (
        (0.129370575, 0.145940579, 0.33420119), (0.287393341, -0.0426813317, 0.20265603)),
    'the same, with all of the force at the discs': (
        (0.129383001, 0.146059375, 0.334138274), (0.287552228, -0.0411669127, 0.202585313)),
    'pseudo rigid bodies between discs': (
        (0.12939331, 0.145941944, 0.334214005), (0.287535277, -0.0418212603, 0.202373323)),
    'constant curvature between discs': (
        (0.12754161, 0.143275529, 0.336555596), (0.283025902, -0.0522068119, 0.206406442)),
    'constant curvature, lengths of the second model': (
        (0.129385547, 0.145977002, 0.334201981), (0.286139653, 0.0226732675, 0.209406712))}
"""Tips of tdcr-modeling without and with a load, x, y, z in m."""
ALL_FORCE = 'the same, with all of the force at the discs'
BODIES = (1, 2, 10)  # between two guides


def state(bodies: int, force: tuple[float, float, float], discs: bool = False
          ) -> Equilibrium:
    """
    Return the arm of the example under a force (N) at the tip, so many bodies between guides.

    discs: the guides are discs of the arm, and not spacers between bodies.
    """
    parts = SPACERS + 1 if discs else 1
    tendons = tuple(Tendon(f'{end}_{angle}', radians(angle), OFFSET, end * parts)
                    for end in (1, 2) for angle in (90, -30, 210))
    segments = 2 * parts
    arm = Arm(
        (Segment(LENGTH / parts, BENDING, BENDING, TWIST),) * segments,
        (Disc(),) * (segments + 1), tendons,
        bodies if discs else bodies * (SPACERS + 1), 0 if discs else SPACERS, SECOND_ORDER,
        wrenches=(Wrench(segments, force),), gravity=(0.0, 0.0, 0.0))
    statics = SpaceStatics(arm)
    return statics.solve(statics.chain.straight(), np.zeros(6), [True] * segments,
                         tensions=TENSIONS)


def run(quick: bool) -> Section:
    """Measure; the section is of the page about accuracy."""
    rows = [(f'soft_continuum, {guides}: {bodies}',
             *_row([state(bodies, force, guides == 'discs').tip for force in LOADS]))
            for guides in ('spacers', 'discs') for bodies in (BODIES[:1] if quick else BODIES)]
    rows += [(name, *_row([np.array(tip) for tip in tips]))
             for name, tips in MODELS.items() if name != ALL_FORCE]
    head = ('model', 'distance, mm', 'with load, mm')
    return Section('benchmarks/accuracy.md', 'tdcr', '\n\n'.join([
        f'The arm is the example of tdcr-modeling: two segments of {LENGTH:g} m with {SPACERS} '
        f'discs and three tendons each, tensions of {TENSIONS[0]:g} and {TENSIONS[4]:g} N, loads '
        f'of 0 and {LOADS[1]} N at the tip. Distances of tips are from its Cosserat rod with all '
        'of the force at the discs. soft_continuum: bodies between two spacers or discs. '
        f'{machine()}', table(head, rows)]))


def _row(tips: Sequence[Array]) -> list[str]:
    """Return how far the tips without and with a load are from those of ALL_FORCE, mm."""
    return [number(1e3 * float(np.linalg.norm(tip - reference)))
            for tip, reference in zip(tips, MODELS[ALL_FORCE], strict=True)]
