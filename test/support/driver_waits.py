# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What tests wait for, on the clock of an emulated device or of the computer."""

import pytest

from soft_continuum.hardware.protocols import HardwareError

TIMEOUT = 60.0  # s for anything to happen


def until(device, condition, what='', step=0.002):
    """Return something once it is true, looking every ``step`` s of a device, driver or clock."""
    clock = getattr(device, 'clock', device)
    deadline = clock() + TIMEOUT
    while not (value := condition()):
        assert clock() < deadline, f'never: {what or condition}'
        clock.sleep(step)
    return value


def at_rest(tendons):
    """Wait for the end of all motion; return the reading there."""
    until(tendons, lambda: not tendons.read().moving, 'at rest', 0.01)
    return tendons.read()


def failed(tendons):
    """Wait for the driver to fail; return its error."""
    def gives_up():
        try:
            tendons.read()
        except HardwareError:
            return True
        return False
    until(tendons, gives_up, 'a HardwareError', 0.01)
    with pytest.raises(HardwareError) as error:
        tendons.read()
    with pytest.raises(HardwareError):
        tendons.move((0.0, 0.0), 1.0)
    return str(error.value)
