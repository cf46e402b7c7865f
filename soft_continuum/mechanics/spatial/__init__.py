# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Statics of spatial arms: any number of tendons, routed anyhow, segments that bend in any direction.

``SpatialStatics(arm)`` solves for the equilibrium.  docs/explanation/space.md says how, and what
is not there yet.
"""

from typing import TYPE_CHECKING

from soft_continuum.lazy import names_from

if TYPE_CHECKING:
    from soft_continuum.mechanics.spatial.batch import solve_batch, solve_path, SpatialBatch
    from soft_continuum.mechanics.spatial.chain import SpatialChain, SpatialEquilibrium
    from soft_continuum.mechanics.spatial.directions import bending_directions, bending_vectors
    from soft_continuum.mechanics.spatial.self_contact import self_intersections, wound_up
    from soft_continuum.mechanics.spatial.sensitivity import (
        SpatialLinearisation,
        SpatialSensitivity,
    )
    from soft_continuum.mechanics.spatial.statics import SpatialStatics

__all__ = [
    'SpatialBatch', 'SpatialChain', 'SpatialEquilibrium', 'SpatialLinearisation',
    'SpatialSensitivity', 'SpatialStatics', 'bending_directions', 'bending_vectors',
    'self_intersections', 'solve_batch', 'solve_path', 'wound_up',
]

# Cheap ones first, as in the plane: who solves does not load SciPy.
__getattr__ = names_from(__name__, __all__, (
    'directions', 'chain', 'statics', 'batch', 'self_contact', 'sensitivity'))


def __dir__() -> list[str]:
    return [*globals(), *__all__]
