# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arrays that the compiled solver of spatial arms works on."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soft_continuum.mechanics._compile import compiled
from soft_continuum.mechanics.arm import Array

Integers = NDArray[np.int64]
BAND = 3  # links: spans that couple no further ones go into the band


class System(NamedTuple):
    """
    The links of a chain, which are bodies or several that are locked together, and their loads.

    joints: (links, 4, 3), as of _laws.  turns: (links, 3, 3), orientation, in the link before or
    the base, of what the joint is on.  loads: (links, 3, 3), sum of (vector of a body) x (force
    that it carries), so that the energy is -trace(load R).  moments: (links, 3), dead moments,
    N m, in base_link.  entries: (k,), link of each vector (k, 3) of a span, in its frame.
    spans: (spans, 3), tendon, first and last entry (exclusive).  constants: (spans, 3), the part
    of a span in base_link.  tables: as of _laws.  ratios: (spans,), tension of a span over that
    at the base.
    """

    joints: Array
    turns: Array
    loads: Array
    moments: Array
    entries: Integers
    vectors: Array
    spans: Integers
    constants: Array
    tables: Array
    ratios: Array


class Work(NamedTuple):
    """
    The linear system of one Newton step and its parts.

    gradient: (3 links,), unbalanced moments, N m, in the frames of the links.  band: (3 links,
    half + 1), entry (c + i, c) of its derivative at [c, i].  columns: (3 links, width), the rest
    of the system: by the tensions of the chosen tendons; where tendons rub, also their slopes;
    two across each span that the band does not hold, and for each dead moment; last the
    right-hand side.  products, matrix, judged: (width, width), small systems, and right (width,).
    chosen: (tendons,), those whose tensions are found; of_column: (width,), the tendon or span of
    each unknown.  units: (spans, 3), directions of the spans, and lengths (spans,); paths:
    (tendons,), of the tendons, m.
    levers: (2, BAND + 1, 3), room.
    """

    gradient: Array
    band: Array
    columns: Array
    products: Array
    matrix: Array
    judged: Array
    right: Array
    chosen: NDArray[np.bool_]
    of_column: Integers
    units: Array
    lengths: Array
    paths: Array
    levers: Array


@compiled
def work_arrays(system, tendons):  # type: ignore[no-untyped-def]
    """Return a Work for a System with so many tendons."""
    links, spans, reach, width = len(system.joints), len(system.spans), 1, 2 * tendons + 1
    for k in range(links):
        width += 2 if system.moments[k].any() else 0
    for s in range(spans):
        far = system.entries[system.spans[s, 2] - 1] - system.entries[system.spans[s, 1]]
        if far <= BAND:
            reach = max(reach, far)
        else:
            width += 2
    return Work(
        np.empty(3 * links), np.empty((3 * links, 3 * reach + 3)), np.empty((3 * links, width)),
        np.empty((width, width)), np.empty((width, width)), np.empty((width, width)),
        np.empty(width), np.zeros(tendons, np.bool_), np.empty(width, np.int64),
        np.empty((spans, 3)), np.empty(spans), np.empty(tendons), np.empty((2, BAND + 1, 3)))
