# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm in space that is not the described one, and what a camera sees of it."""

from dataclasses import replace

import numpy as np

from soft_continuum.estimation.unknowns import Drift, Prior
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from support.true_arm import Session, TrueArm

ARM = replace(load_arm(description_file().with_name('spatial_jamming.yaml')),
              bodies_per_segment=4)
DEVIATIONS = np.array([4e-4, 4e-4, 4e-4, 4e-3, 4e-3, 4e-3])  # m, rad: of the camera
COVARIANCE = np.diag(DEVIATIONS**2)
PRIOR, DRIFT = Prior(), Drift()


class SpatialTruth(TrueArm):
    """An arm in space as it is, of so many bodies in each segment."""

    DEVIATIONS, COVARIANCE = DEVIATIONS, COVARIANCE

    def __init__(self, arm=ARM, factors=1.0, ratio=30.0, offsets=0.0, payload=0.0, bodies=8):
        self.bodies = bodies
        super().__init__(factors, ratio, offsets, payload, arm)

    def as_built(self, arm):
        return replace(arm.with_compliant_tendons(2e-5),
                       bodies_per_segment=self.bodies * (arm.spacers + 1))


class SpatialSession(Session):
    """A true arm in space and its estimator, moved together; and the prediction beside it."""

    def __init__(self, truth, arm=ARM, prior=PRIOR, drift=DRIFT, seed=0, jamming=True, **seen):
        """Begin with a straight arm; seen: arguments of TrueArm.seen."""
        self.statics = SpaceStatics(arm)
        self.predicted = self.statics.chain.straight()
        super().__init__(truth, arm, prior, drift, seed, (not jamming,) * len(arm.segments),
                         **seen)

    def follow(self, pulls=None, soft=None):
        """Let the motors go there at once."""
        super().follow(pulls, soft)
        if any(self.soft):
            self.predicted = self.statics.solve(self.predicted, self.pulls, self.soft)

    def tip_errors(self):
        """Return by how much the tips of the estimate and of the prediction are off, m."""
        return [float(np.linalg.norm(state.tip - self.truth.state.tip))
                for state in (self.estimator.state, self.predicted)]
