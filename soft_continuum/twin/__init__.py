# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated rig that is not the suite's own model: MuJoCo behind the serial bytes of a rig."""
