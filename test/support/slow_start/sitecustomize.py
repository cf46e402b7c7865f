# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Run by every Python that the tests start with ``--slow-start``: each is late by another time."""

import os
from random import Random
from time import sleep

sleep(Random(os.getpid()).uniform(0.0, float(os.environ['SOFT_CONTINUUM_SLOW_START'])))
