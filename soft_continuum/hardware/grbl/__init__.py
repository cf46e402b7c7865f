# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""GRBL boards: steppers that pull the tendons; their parameters, which every node reads."""

from soft_continuum.parameters.parameter import Parameter

PARAMETERS = (
    Parameter('grbl.port', '', 'serial port of the stepper controller, preferably its stable name '
              'in /dev/serial/by-id; several ports separated by spaces share the tendons evenly, '
              'in this order'),
    Parameter('grbl.baud_rate', 115200, 'baud rate of grbl.port, bit/s', 1200, 4000000),
    Parameter('grbl.steps_per_mm', (200.0, 200.0),
              'motor steps per mm of pull of each tendon, on the axes X, Y, ...', 0.1, 1e5),
    Parameter('grbl.signs', (1.0, 1.0),
              'for each tendon, 1 if positive motion pulls it in, -1 if it pays it out',
              -1.0, 1.0),
    Parameter('grbl.homed_pulls', (0.0,),
              'pull of each tendon, m, after homing, which pays all out to their limit switches; '
              '0 alone: no switches, the zero is set by hand', -10.0, 0.0),
)
