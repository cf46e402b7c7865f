# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Commands that need no ROS: from measurements to a model whose error is known."""
