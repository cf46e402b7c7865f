# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Model, actuate and sequence a planar variable-stiffness continuum arm."""
