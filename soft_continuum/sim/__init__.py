# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What stands in for a rig: emulated boards, and a simulation of the arm behind them."""
