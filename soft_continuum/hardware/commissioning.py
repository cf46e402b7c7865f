# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
What ``doctor`` and ``calibrate`` need from a driver: its module COMMISSIONING.

The attribute COMMISSIONING of a driver class names a module with any of these:
``PORT``, the name of the parameter with its serial ports; ``DRIVE``, a Drive of tendons;
``checks(values)``, which yields a Check for each step, moves and switches nothing, and for tendons
takes the place of opening and reading the driver; ``checks_opened(driver)``, further checks of an
open driver; ``clear_zero(values)``, which makes the devices lose their zeros, without a motion.
All raise HardwareError and ParameterError.  A subclass of a driver inherits the module; None: it
has none.
"""

from dataclasses import dataclass

OK, WARN, FAIL = 'OK', 'WARN', 'FAIL'


@dataclass(frozen=True)
class Check:
    """Result of one step; status: OK, WARN or FAIL.  If not OK, the message names the remedy."""

    step: str
    status: str
    message: str


@dataclass(frozen=True)
class Drive:
    """
    Parameters of a tendon driver that ``calibrate`` corrects.

    signs, scale: their names.  inverse: a larger scale turns less.  zeros: name of the positions
    at zero pull, if only a parameter sets them; the driver then has them as ``zeros``.  shared:
    one value may count for all tendons.  scale_moves_zero: a new scale loses the zero.
    """

    signs: str
    scale: str
    inverse: bool
    zeros: str = ''
    shared: bool = False
    scale_moves_zero: bool = False


def check_reference(referenced: bool, why: str = '') -> Check:
    """Check that the zero of the tendons is known; why: the reason if not."""
    if referenced:
        return Check('tendon reference', OK, 'the zero of the tendons is known')
    return Check('tendon reference', WARN,
                 f'the zero of the tendons is not known{why and f" ({why})"}, so no motion is '
                 'allowed: use calibrate zero, or straighten the arm with both tendons just taut '
                 'and call /tendon_actuation/reference')
