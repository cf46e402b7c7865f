# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Hardware that other nodes own: its topics."""
