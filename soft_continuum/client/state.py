# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a client learns about the arm, as frozen values in SI units."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Pose:
    """A pose in the bending plane of ``base_link``: x and z in m, angle about +y in rad."""

    x: float
    z: float
    angle: float


@dataclass(frozen=True)
class NodeReport:
    """
    What one node says of itself.

    level: 'ok', 'warn' or 'error'; None if it has not been heard.  message and values: its
    ``~/status``, see msg_docs/README.md.  age: s since it was last heard on any topic.
    """

    name: str
    running: bool
    level: str | None
    message: str
    values: Mapping[str, str]
    age: float | None


@dataclass(frozen=True)
class ArmState:
    """
    One look at the arm; None where it is not known, or not been heard of lately.

    pulls (m), speeds (m/s) and tensions (N): right and left tendon; tensions by the model, nan
    where nothing determines them; measured_tensions only of a driver that measures.
    stiff: of each segment, base first, as confirmed by its pressure.  pressures: Pa, absolute.
    bending_angles: rad, one per segment.  segment_poses: distal end of each segment.  tip: top of
    the last disc.  joint_angles: rad, all joints of the rigid chain.  nodes: the four nodes.
    """

    pulls: tuple[float, float] | None
    speeds: tuple[float, float] | None
    tensions: tuple[float, float] | None
    measured_tensions: tuple[float, float] | None
    stiff: tuple[bool | None, ...]
    pressures: tuple[float | None, ...]
    bending_angles: tuple[float, ...] | None
    segment_poses: tuple[Pose, ...] | None
    tip: Pose | None
    joint_angles: tuple[float, ...] | None
    nodes: tuple[NodeReport, ...]

    def node(self, name: str) -> NodeReport:
        """Return the report of one of the four nodes; raises KeyError for another name."""
        for report in self.nodes:
            if report.name == name:
                return report
        raise KeyError(f'{name}; the nodes are {", ".join(n.name for n in self.nodes)}')


@dataclass(frozen=True)
class SequenceResult:
    """
    How a sequence ended.

    outcome: name of the error_code, SUCCESSFUL or another one of msg_docs/shape_sequencer.md.
    message: what went wrong, empty on success.
    """

    outcome: str
    message: str
    shapes_completed: int
