# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of GrblTendons, apart from the driver, which only its node loads."""

from soft_continuum.parameters.parameter import Parameter

PARAMETERS = (
    Parameter('grbl.port', '', 'serial port of the stepper controller, best the name below '
              '/dev/serial/by-id that stays with the device; several with spaces between: '
              'controllers that share the tendons evenly, in their order'),
    Parameter('grbl.baud_rate', 115200, 'bits/s of that port', 1200, 4000000),
    Parameter('grbl.steps_per_mm', (200.0, 200.0),
              'motor steps per mm of pull of each tendon, on the axes X, Y, ...', 0.1, 1e5),
    Parameter('grbl.signs', (1.0, 1.0),
              'for each tendon 1 where a positive motion pulls it in, -1 where it pays it out',
              -1.0, 1.0),
    Parameter('grbl.homed_pulls', (0.0,),
              'pull of each tendon after homing, which pays all out to limit switches, m; '
              '0 alone: no switches, the zero is set by hand', -10.0, 0.0),
)
