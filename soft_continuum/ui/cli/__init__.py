# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: ``soft_continuum COMMAND``; see docs/reference/command_line.md."""
