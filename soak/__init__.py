# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Reliability, measured: ``./run soak`` writes docs/benchmarks/reliability.md.

The observer of the nodes, the starter of processes and the fuzzing are those of the tests.
"""

import os
from pathlib import Path
import sys

_TEST = Path(__file__).parents[1] / 'test'
sys.path += [str(_TEST), str(_TEST / 'hardware')]  # support, and the tests that fuzz
# Read when the first participant of a process is made.
for _name in ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'):
    os.environ[_name] = str(_TEST / 'support' / 'fastdds.xml')
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'  # LOCALHOST would replace it
