# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The reasons of the library are those of the message."""

from soft_continuum.hardware.tendon_controller import Reason
from soft_continuum_interfaces.msg import MotionRequest


def test_every_reason_of_the_message_is_one_of_the_library():
    constants = vars(type(MotionRequest))['_Metaclass_MotionRequest__constants']
    states = {'NONE', 'FOLLOWING', 'DONE', 'REFUSED', 'ENDED'}
    assert {reason.name for reason in Reason} == constants.keys() - states
