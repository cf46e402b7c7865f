# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Models that check the statics and the accuracy of the chain; no other room uses them."""

from references.elastica import Elastica, Rod
from references.rod import solve_rods, SpatialRod

__all__ = ['Elastica', 'Rod', 'SpatialRod', 'solve_rods']
