# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of nodes that drive emulated boards."""

from pathlib import Path

from soft_continuum.emulators.grbl import STEPS_PER_MM

MODBUS_TIMEOUT = 0.4  # s: boards that share a processor with a plant answer later than real ones


def driving_parameters(grbl: str | Path, modbus: str | Path) -> dict[str, object]:
    """Return what the nodes have to be given for boards at these two ports."""
    return {'tendon_driver': 'grbl', 'grbl.port': str(grbl),
            'grbl.steps_per_mm': [float(STEPS_PER_MM)] * 2,
            'jamming_driver': 'modbus', 'modbus.port': str(modbus),
            'modbus.timeout': MODBUS_TIMEOUT}
