# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Modbus RTU boards: valves or regulators, and pressure sensors.

Their parameters are here, as every node reads them.
"""

from soft_continuum.parameters.parameter import Parameter

PARAMETERS = (
    Parameter('modbus.port', '', 'serial port, preferably its stable name in /dev/serial/by-id'),
    Parameter('modbus.baud_rate', 9600, 'baud rate of both boards, 8N1', 1200, 1000000,
              unit='bit/s'),
    Parameter('modbus.timeout', 0.1,
              "maximum wait for a reply; well above the boards' response time", 0.01, 1.0,
              unit='s'),
    Parameter('modbus.relay_unit', 1, 'unit number of the relay board', 1, 247),
    Parameter('modbus.pump_coil', 0, 'coil of the pump, counted from 0', 0, 65535),
    Parameter('modbus.valve_coils', (1.0, 2.0, 3.0),
              'coil of the valve of each segment, base first', 0, 65535),
    Parameter('modbus.energised_valve_evacuates', True,
              'an energised coil connects its segment to the pump, so segments vent when power '
              'fails; false: to the atmosphere'),
    Parameter('modbus.analog_unit', 2, 'unit number of the analog board', 1, 247),
    Parameter('modbus.pressure_registers', (0.0, 1.0, 2.0),
              'input register with the current, in uA, of the transmitter of each segment',
              0, 65535),
    Parameter('modbus.vacuum_at_4_ma', 0.0,
              'vacuum below ambient at which a transmitter gives 4 mA', -1e6, 1e6, unit='Pa'),
    Parameter('modbus.vacuum_at_20_ma', 100e3,
              'vacuum below ambient at which a transmitter gives 20 mA', -1e6, 1e6, unit='Pa'),
    Parameter('modbus.regulators', False,
              'every segment has a vacuum regulator on an analog output board, in place of a '
              'pump and valves on the relay board'),
    Parameter('modbus.output_unit', 3, 'unit number of the analog output board', 1, 247),
    Parameter('modbus.output_registers', (0.0, 1.0, 2.0),
              'holding register with the set-point of the regulator of each segment', 0, 65535),
    Parameter('modbus.output_range', (4000.0, 20000.0),
              'register values at the ends of the output range, such as 4 and 20 mA in uA, or 0 '
              'and 10 V in mV', 0, 65535, is_range=True),
    Parameter('modbus.output_vacuums', (0.0, 100e3),
              'vacuum below ambient that a regulator holds at these ends; at the lower end its '
              'segment counts as vented', 0.0, 101e3, is_range=True, unit='Pa'),
)
