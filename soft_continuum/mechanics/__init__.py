# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Mechanics of a tendon-driven continuum arm with segments that are locked by jamming.

``Statics(arm)`` solves for the equilibrium shape.  ``set_shape`` and similar functions solve the
inverse problem: pulls for a shape or a tip.  docs/explanation/mechanics.md derives the method.
"""

from typing import Any, TYPE_CHECKING

from soft_continuum.extras import names_from
from soft_continuum.mechanics import kinds

if TYPE_CHECKING:
    from soft_continuum.mechanics import constant_curvature, stiffness
    from soft_continuum.mechanics.arm import (
        Arm,
        ArmError,
        Disc,
        mounted,
        PAPER,
        SECOND_ORDER,
        Segment,
        Tendon,
        tendon_pair,
        Wrench,
    )
    from soft_continuum.mechanics.batch import solve_batch, solve_path
    from soft_continuum.mechanics.chain import Batch, Chain, Equilibrium, LEFT, RIGHT, SLACK
    from soft_continuum.mechanics.directions import bending_directions, bending_vectors
    from soft_continuum.mechanics.grid import set_on_grid, workspace
    from soft_continuum.mechanics.inverse import BendingFit, pulls_for_bending, set_shape
    from soft_continuum.mechanics.laws import Jam, LawError, MomentCurvature
    from soft_continuum.mechanics.self_contact import exceeds_pi, self_intersections
    from soft_continuum.mechanics.sensitivity import Linearisation, Sensitivity
    from soft_continuum.mechanics.statics import OverconstrainedError, Statics, StaticsError
    from soft_continuum.mechanics.tip import bending_for_tip, TipFit

__all__ = [
    'LEFT', 'PAPER', 'RIGHT', 'SECOND_ORDER', 'SLACK', 'Arm', 'ArmError', 'Batch', 'BendingFit',
    'Chain', 'Disc', 'Equilibrium', 'Jam', 'LawError', 'Linearisation', 'MomentCurvature',
    'OverconstrainedError', 'Segment', 'Sensitivity', 'Statics', 'StaticsError', 'Tendon',
    'TipFit', 'Wrench', 'bending_directions', 'bending_for_tip', 'bending_vectors',
    'constant_curvature', 'exceeds_pi', 'mounted', 'pulls_for_bending', 'self_intersections',
    'set_on_grid', 'set_shape', 'solve_batch', 'solve_path', 'stiffness', 'tendon_pair',
    'workspace',
]

# Cheap imports first: an Arm does not load the solver, and solving does not load SciPy.
__getattr__ = names_from(__name__, __all__, (
    'arm', 'laws', 'chain', 'stiffness', 'statics', 'sensitivity', 'batch',
    'constant_curvature', 'directions', 'inverse', 'grid', 'tip', 'self_contact'))


def __dir__() -> list[str]:
    return [*globals(), *__all__]


def _subclass(base: str, planar: bool) -> type[Any]:
    """Return the subclass of Chain, Statics or Linearisation, and load no other one."""
    found: type[Any]
    match base, planar:
        case 'Chain', True:
            from soft_continuum.mechanics.plane.chain import PlaneChain as found
        case 'Chain', False:
            from soft_continuum.mechanics.space.chain import SpaceChain as found
        case 'Statics', True:
            from soft_continuum.mechanics.plane.statics import PlaneStatics as found
        case 'Statics', False:
            from soft_continuum.mechanics.space.statics import SpaceStatics as found
        case 'Linearisation', True:
            from soft_continuum.mechanics.plane.sensitivity import PlaneLinearisation as found
        case 'Linearisation', False:
            from soft_continuum.mechanics.space.sensitivity import SpaceLinearisation as found
    return found


kinds.subclass = _subclass
