# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What people use: the command line, the browser and the joystick."""
