# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated rig, independent of the suite's model: MuJoCo behind emulated serial devices."""
