# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Drawing of an arm with Matplotlib."""

from collections.abc import Collection
from typing import Any

import numpy as np
import scipy

from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.rotations import matrices

RING = 41  # points of the rim of a disc
SOFT = 'tab:orange'
DASHES = ('-', '--')  # of two tendons
IN_SPACE = '3d'


def projection_of(arm: Arm) -> str | None:
    """Return Matplotlib's projection for an arm: 3d, or a view along y."""
    return IN_SPACE if 'y' in arm.axes else None


def draw_arm(axes: Any, state: Any, soft: Collection[int] | None = None) -> None:
    """
    Draw discs, segments, tendons and calculation points of a state, an Equilibrium, in mm.

    axes: of projection IN_SPACE; others show the view along y.  soft: segments (0-based) in
    colour; by default the soft ones if others are stiff.
    """
    if soft is None:
        soft = [s for s, stiff in enumerate(state.stiff) if not stiff and any(state.stiff)]
    flat = axes.name != IN_SPACE
    seen = [0, 2] if flat else [0, 1, 2]
    chain, backbone = state.chain, 1e3 * state.backbone[:, seen]
    for s in range(chain.segments):
        first = s * chain.joints_per_segment
        axes.plot(*backbone[first:first + chain.joints_per_segment].T,
                  color=SOFT if s in soft else '0.55', linewidth=7 if flat else 4,
                  solid_capstyle='butt', label='' if s else 'segment')
    radii = [segment.outer_diameter / 2 for segment in chain.arm.segments]
    radii = [radii[0], *np.repeat(radii, 2), radii[-1]]  # a disc leads from segment to segment
    edges = [1e3 * rim(*each)[:, seen] for each in zip(state.poses, radii, strict=True)]
    if flat:
        for around in map(np.concatenate, zip(edges[::2], edges[1::2], strict=True)):
            outline = around[scipy.spatial.ConvexHull(around, qhull_options='QJ').vertices]
            axes.fill(*outline.T, color='0.8', edgecolor='0.3', linewidth=0.8)
    else:
        for edge in edges:
            axes.plot(*edge.T, color='0.3', linewidth=0.8)
    names = chain.arm.tendon_names
    named = len(names) == len(DASHES)
    for number, (name, guides) in enumerate(zip(names, state.tendon_points, strict=True)):
        axes.plot(*(1e3 * guides[:, seen]).T, DASHES[number] if named else '-', color='0.1',
                  linewidth=1.0, label=name.replace('_', ' ') if named else
                  '' if number else 'tendons')
    axes.plot(*(1e3 * state.poses[:, seen]).T, 'o', color='black', markersize=3.5,
              label='rigid chain, calculation points')
    if flat:
        axes.set(aspect='equal', xlabel='x in mm')
        axes.grid(alpha=0.3)
        return
    # A cube: otherwise the axes of a nearly flat shape would be as thin as the shape.
    low, high = (of(np.vstack([backbone, np.zeros((1, 3))]), axis=0) for of in (np.min, np.max))
    middle, half = (low + high) / 2, (high - low).max() / 2
    for name, centre in zip('xyz', middle, strict=True):
        axes.set(**{f'{name}lim': (centre - half, centre + half), f'{name}label': f'{name} in mm'})
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=0.88)  # with room for the labels


def rim(pose: Array, radius: float) -> Array:
    """Return the edge of a disc, (RING, 3), m; pose (7,), radius in m."""
    edge: Array = pose[:3] + radius * circle(RING) @ matrices(pose[3:]).T
    return edge


def circle(corners: int, endpoint: bool = True) -> Array:
    """Return corners of the unit circle, (corners, 3), in the plane of x and y."""
    around = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=endpoint)
    return np.column_stack([np.cos(around), np.sin(around), np.zeros(corners)])
