# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of GRBL controllers, and the end of a provisional zero; nothing moves."""

from collections.abc import Iterator, Mapping
from typing import Any

from soft_continuum.hardware.commissioning import Check, check_reference, Drive, FAIL, OK, WARN
from soft_continuum.hardware.grbl.link import GrblLink, SOFT_RESET
from soft_continuum.hardware.grbl.motion import Motors
from soft_continuum.hardware.grbl.setup import find_controller, invalid_settings, UNLOCK
from soft_continuum.hardware.protocols import HardwareError

PORT = 'grbl.port'
DRIVE = Drive('grbl.signs', 'grbl.steps_per_mm', inverse=False, scale_moves_zero=True)


def checks(values: Mapping[str, Any]) -> Iterator[Check]:
    """Yield the state of all controllers."""
    for port, motors in Motors.of_boards(values):
        yield from _check(port, values['grbl.baud_rate'], motors)


def _check(port: str, baud_rate: int, motors: Motors) -> Iterator[Check]:
    step = 'tendon port'
    try:
        link = GrblLink(port, baud_rate)
    except HardwareError as error:
        yield Check(step, FAIL, str(error))
        return
    yield Check(step, OK, f'{port} opened, no other program uses it')
    try:
        found = find_controller(link)
    except HardwareError as error:
        yield Check('tendon firmware', FAIL, str(error))
        return
    finally:
        link.close()
    if found.locked and not motors.homes:
        yield Check('tendon firmware', FAIL, f'{found.firmware}, locked (Alarm); {UNLOCK}')
    else:
        yield Check('tendon firmware', OK, f'{found.firmware}, at rest')
    if unfit := invalid_settings(found.settings, motors):
        yield Check('tendon settings', FAIL, f'{"; ".join(unfit)}; type these lines in a terminal '
                    '(docs/how_to/set_up_a_rig.md), or change the parameter file')
    else:
        yield Check('tendon settings', OK, 'fit the parameters')
    if motors.homes and (found.locked or found.zero is None):
        yield Check('tendon reference', WARN, 'the tendons have to be homed before any motion: '
                    'straighten and stiffen the arm, and call /tendon_actuation/reference')
    else:
        yield check_reference(found.zero is not None)


def clear_zero(values: Mapping[str, Any]) -> None:
    """Reset all controllers, which loses their zeros; raises HardwareError if one is missing."""
    for port in values['grbl.port'].split():
        link = GrblLink(port, values['grbl.baud_rate'])
        try:
            find_controller(link)
            link.write(SOFT_RESET)
            find_controller(link)
        finally:
            link.close()
