# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Set three shapes on the arm that runs, simulated or not (start one with: ./run up)."""

from soft_continuum.client import Arm

with Arm() as arm:
    for name, angles in arm.shapes.items():
        arm.run(name, hold=0.5, progress=lambda now: print(f'{now.fraction:4.0%} {now.phase}'))
        print(name, angles, 'reached; tip at', arm.state.tip)
    arm.run((0.0, 0.0, 0.0))  # straight again
    arm.plot().figure.savefig('straight.png')
