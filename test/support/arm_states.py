# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""States of an arm, for what shows them."""

from dataclasses import replace

from soft_continuum.client.state import ArmState, NodeReport, Progress
from soft_continuum.ros.names import NODES
from soft_continuum.sequencing import Phase

READY = ArmState(
    tendons=('right_tendon', 'left_tendon'), pulls=(0.0, 0.0), speeds=None, tensions=(0.0, 5.0),
    measured_tensions=None, stopped='', emergency_stop=False,
    referenced=True, stiff=(True, True, False),
    pressures=(3e4, 3e4, 1e5), bending_angles=(0.0, 0.1, 0.2), joint_angles=None,
    segment_poses=None, disc_poses=None, tip=None, progress=None, last_result=None,
    nodes=tuple(NodeReport(name, True, 'ok', 'fine', {}, 0.1, False) for name in NODES))
MOVING = replace(READY, progress=Progress(0, 'c_form', 2, Phase.MOVING, 0.5))
STOPPED = replace(READY, stopped='stop was called; call ~/resume before any motion')
