# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's arm, for every test of its mechanics."""

import pytest

from soft_continuum.mechanics import Statics
from support import paper_arm as paper


@pytest.fixture(scope='session')
def paper_arm():
    """Return the paper's arm, upright, with estimated masses."""
    return paper.build()


@pytest.fixture(scope='session')
def statics(paper_arm):
    """Return the statics of the paper's arm under gravity."""
    return Statics(paper_arm)


@pytest.fixture(scope='session')
def weightless(paper_arm):
    """Return the statics of the paper's arm without gravity."""
    return Statics(paper_arm.without_gravity())
