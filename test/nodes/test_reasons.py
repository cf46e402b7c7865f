# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The reasons of the library are those of the message."""

from soft_continuum.hardware.tendon_controller import Reason
from soft_continuum_interfaces.msg import MotionRequest


def test_every_reason_has_the_name_and_the_value_of_the_message():
    constants = vars(type(MotionRequest))['_Metaclass_MotionRequest__constants']
    reasons = {name: value for name, value in constants.items()
               if name not in ('NONE', 'FOLLOWING', 'DONE', 'REFUSED', 'ENDED')}
    assert {reason.name: reason.value for reason in Reason} == reasons
