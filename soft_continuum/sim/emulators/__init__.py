# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Emulated devices on pseudo-terminals: the hardware path without hardware."""
