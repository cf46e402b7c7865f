# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path
import sys

sys.path.append(str(Path(__file__).resolve().parents[2]))  # for benchmarks.servo_loop
