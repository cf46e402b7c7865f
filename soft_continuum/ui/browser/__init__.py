# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The arm in a browser: a live 3-D view with controls; see docs/how_to/use_the_browser.md."""
