# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What its sender was told has failed moves nothing later."""

from unittest.mock import Mock

import numpy as np
import pytest

from soft_continuum.hardware.protocols import Accuracy
from soft_continuum.hardware.tendon_controller import MotionRefusedError
from soft_continuum.nodes.tendon_control import Request, TendonControl
from soft_continuum_interfaces.msg import MotionRequest


@pytest.mark.parametrize('begun', [False, True])
def test_a_trajectory_that_was_given_up_is_not_followed(begun):
    arm, controller = Mock(), Mock(reading=Mock(tensions=None, accuracy=Accuracy()))
    arm.motion_interlock.return_value = None
    control = TendonControl(('a', 'b'), arm, 0.02, lambda: 0.0, lambda: 10.0, Mock(), Mock())
    control.attach(controller)
    control.activate()
    request = Request('goal', np.array([1.0]), np.zeros((1, 2)), None, control.revocations)
    controller.plan.return_value = request.times, request.pulls
    control.prepare(request)
    if begun:
        control.follow(request, arm.stiffness)
    control.give_up('goal')
    assert controller.hold.called == begun
    assert control.snapshot().state.accepted.status == (
        MotionRequest.ENDED if begun else MotionRequest().status)
    with pytest.raises(MotionRefusedError, match='withdrew it'):
        control.prepare(request)
