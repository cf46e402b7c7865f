# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Solve the C-form of the paper's arm under gravity, print what it takes, draw it."""

from math import radians
from pathlib import Path

from matplotlib import pyplot

from soft_continuum.mechanics import set_shape, Statics
from soft_continuum.ros.description import load_arm

statics = Statics(load_arm(Path(__file__).parents[1] / 'config' / 'manipulator.yaml'))
c_form = set_shape(statics, [radians(36)] * 3)
print('pulls (right, left):', c_form.pulls * 1e3, 'mm; tensions:', c_form.tensions, 'N')
c_form.plot()
pyplot.savefig('c_form.png')
