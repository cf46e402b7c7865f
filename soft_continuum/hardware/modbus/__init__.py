# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Modbus RTU boards: valves or regulators, and pressure sensors."""
