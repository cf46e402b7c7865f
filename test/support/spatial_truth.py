# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm in space that is not the described one, and what a camera sees of it."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from soft_continuum.estimation.measuring import DiscMeasurement
from soft_continuum.estimation.settings import Drift, Prior
from soft_continuum.mechanics import Jam
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.parameters.files import load_arm
from soft_continuum.user_files import description_file
from support.true_arm import Session

ARM = replace(load_arm(description_file().with_name('spatial_jamming.yaml')),
              bodies_per_segment=4)
DEVIATIONS = np.array([4e-4, 4e-4, 4e-4, 4e-3, 4e-3, 4e-3])  # m, rad: of the camera
COVARIANCE = np.diag(DEVIATIONS**2)
PRIOR, DRIFT = Prior(), Drift()


class SpatialTruth:
    """The arm as it is: other stiffness, jams and tendons that give, of another length, a load."""

    def __init__(self, arm=ARM, factors=1.0, ratio=30.0, offsets=0.0, payload=0.0, bodies=8):
        """Begin straight and stiff, with as many bodies in each segment."""
        factors = np.broadcast_to(factors, len(arm.segments))
        self.statics = SpaceStatics(replace(
            arm.with_compliant_tendons(2e-5), payload=payload,
            bodies_per_segment=bodies * (arm.spacers + 1),
            segments=tuple(replace(
                s, stiffness_x=s.stiffness_x * f, stiffness_y=s.stiffness_y * f,
                torsional_stiffness=s.torsional_stiffness * f, jam=Jam(ratio))
                for s, f in zip(arm.segments, factors, strict=True))))
        self.offsets = np.broadcast_to(offsets, len(arm.tendons))
        self.state = self.statics.chain.straight()

    def follow(self, pulls, soft):
        """Let the motors go to ``pulls``."""
        self.state = self.statics.solve(self.state, np.asarray(pulls) + self.offsets, soft)

    def seen(self, rng=None, bias=None, own=0.3, discs=(1, 2, 3), covariance=COVARIANCE):
        """Return what is measured: off by a bias (discs, 6) in all, and by noise of its own."""
        found = []
        for n in discs:
            pose, error = self.state.poses[2 * n].copy(), np.zeros(6)
            if bias is not None:
                error += bias[n]
            if rng is not None:
                error += own * DEVIATIONS * rng.standard_normal(6)
            pose[:3] += error[:3]
            pose[3:] = (Rotation.from_rotvec(error[3:]) * Rotation.from_quat(pose[3:])).as_quat()
            found.append(DiscMeasurement(n, pose, covariance))
        return found


class SpatialSession(Session):
    """A true arm in space and its estimator, moved together; and the prediction beside it."""

    def __init__(self, truth, arm=ARM, prior=PRIOR, drift=DRIFT, seed=0, jamming=True, **seen):
        """Begin with a straight arm; seen: arguments of SpatialTruth.seen."""
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
