# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Shared by nodes and clients: names, QoS, conversions, parameters, description of the arm."""
