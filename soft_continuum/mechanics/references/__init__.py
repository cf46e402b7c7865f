# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Models that check the statics and the accuracy of the chain; no other room uses them."""

from soft_continuum.mechanics.references.elastica import Elastica, Rod

__all__ = ['Elastica', 'Rod']
