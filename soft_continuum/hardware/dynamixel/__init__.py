# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Dynamixel X servos that pull the tendons; their parameters, which every node reads."""

from soft_continuum.parameters.parameter import Parameter

RADIUS_RANGE = 0.001, 0.1  # m

PARAMETERS = (
    Parameter('dynamixel.port', '', 'serial port of the adapter to the servo bus, preferably its '
              'stable name in /dev/serial/by-id'),
    Parameter('dynamixel.baud', 1000000, 'baud rate of dynamixel.port, bit/s', 9600, 4500000),
    Parameter('dynamixel.ids', (1, 2), 'ID of the servo of each tendon', 0, 252),
    Parameter('dynamixel.spool_radii', (0.01, 0.01), 'radius of each spool, to the centre of the '
              'wound tendon; 0.01 is 10 mm', *RADIUS_RANGE, unit='m'),
    Parameter('dynamixel.signs', (1.0, 1.0), 'for each tendon, 1 if increasing servo positions '
              'pull it in, -1 if they pay it out', -1.0, 1.0),
    Parameter('dynamixel.tension_limits', (20.0, 20.0), 'tension of each tendon at which its '
              'servo yields, set by a current limit', 0.01, 1e4, unit='N'),
    Parameter('dynamixel.torque_constants', (0.0, 0.0), 'torque constant of each servo; 0: that '
              'of its data sheet', 0.0, 100.0, unit='N m/A'),
    Parameter('dynamixel.take_up_tension', 0.0, 'tension to which ~/reference pulls each tendon '
              'before its position becomes the zero; 0: the present position becomes the zero',
              0.0, 1e3, unit='N'),
)
