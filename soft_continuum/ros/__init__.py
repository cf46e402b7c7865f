# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What nodes and clients share to talk over ROS: names, QoS, conversions, ages."""
