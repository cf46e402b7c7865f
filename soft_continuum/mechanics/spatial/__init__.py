# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Statics of spatial arms: any number of tendons, routed anyhow, segments that bend in any direction.

``SpatialStatics(arm)`` solves for the equilibrium; ``pulls_for_bending`` and its neighbours go the
other way.  docs/explanation/space.md says how, and what is not there yet.
"""

from typing import TYPE_CHECKING

from soft_continuum.lazy import names_from

if TYPE_CHECKING:
    from soft_continuum.mechanics.spatial import constant_curvature
    from soft_continuum.mechanics.spatial.batch import solve_batch, solve_path, SpatialBatch
    from soft_continuum.mechanics.spatial.chain import SpatialChain, SpatialEquilibrium
    from soft_continuum.mechanics.spatial.directions import bending_directions, bending_vectors
    from soft_continuum.mechanics.spatial.grid import set_on_grid, workspace
    from soft_continuum.mechanics.spatial.inverse import (
        BendingFit,
        pulls_for_bending,
        set_shape,
    )
    from soft_continuum.mechanics.spatial.self_contact import self_intersections, wound_up
    from soft_continuum.mechanics.spatial.sensitivity import (
        SpatialLinearisation,
        SpatialSensitivity,
    )
    from soft_continuum.mechanics.spatial.statics import SpatialStatics
    from soft_continuum.mechanics.spatial.tip import bending_for_tip, SpatialTipFit

__all__ = [
    'BendingFit', 'SpatialBatch', 'SpatialChain', 'SpatialEquilibrium', 'SpatialLinearisation',
    'SpatialSensitivity', 'SpatialStatics', 'SpatialTipFit', 'bending_directions',
    'bending_for_tip', 'bending_vectors', 'constant_curvature', 'pulls_for_bending',
    'self_intersections', 'set_on_grid', 'set_shape', 'solve_batch', 'solve_path', 'workspace',
    'wound_up',
]

# Cheap ones first, as in the plane: who solves does not load SciPy.
__getattr__ = names_from(__name__, __all__, (
    'directions', 'chain', 'statics', 'batch', 'self_contact', 'sensitivity',
    'constant_curvature', 'inverse', 'grid', 'tip'))


def __dir__() -> list[str]:
    return [*globals(), *__all__]
