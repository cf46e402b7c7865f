# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm in space that is not the described one, and what a camera sees of it."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from soft_continuum.estimation.commands import Commands
from soft_continuum.estimation.estimator import Estimator
from soft_continuum.estimation.measuring import DiscMeasurement
from soft_continuum.estimation.settings import Drift, Prior
from soft_continuum.mechanics import Jam
from soft_continuum.mechanics.spatial import SpatialStatics
from soft_continuum.nodes.up import description_file
from soft_continuum.parameters.files import load_any_arm

ARM = replace(load_any_arm(description_file().with_name('spatial_jamming.yaml')),
              bodies_per_segment=4)
DEVIATIONS = np.array([4e-4, 4e-4, 4e-4, 4e-3, 4e-3, 4e-3])  # m, rad: of the camera
COVARIANCE = np.diag(DEVIATIONS**2)
PERIOD = 0.1  # s between two pictures
PRIOR, DRIFT = Prior(), Drift()


class SpatialTruth:
    """The arm as it is: other stiffness, jams and tendons that give, of another length, a load."""

    def __init__(self, arm=ARM, factors=1.0, ratio=30.0, offsets=0.0, payload=0.0, bodies=8):
        """Begin straight and stiff, with as many bodies in each segment."""
        factors = np.broadcast_to(factors, len(arm.segments))
        self.statics = SpatialStatics(replace(
            arm, payload=payload, bodies_per_segment=bodies * (arm.spacers + 1),
            segments=tuple(replace(
                s, stiffness_x=s.stiffness_x * f, stiffness_y=s.stiffness_y * f,
                torsional_stiffness=s.torsional_stiffness * f, jam=Jam(ratio))
                for s, f in zip(arm.segments, factors, strict=True)),
            tendons=tuple(replace(t, compliance=t.compliance or 2e-5) for t in arm.tendons)))
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


class SpatialSession:
    """A true arm in space and its estimator, moved together; and the prediction beside it."""

    def __init__(self, truth, arm=ARM, prior=PRIOR, drift=DRIFT, seed=0, jamming=True, **seen):
        """Begin with a straight arm; seen: arguments of SpatialTruth.seen."""
        self.truth, self.seen, self._jamming = truth, seen, jamming
        self.statics = SpatialStatics(arm)
        self.predicted = self.statics.chain.straight()
        self.estimator = Estimator(arm, self.predicted, prior, drift)
        self.rng, self.time = np.random.default_rng(seed), 100.0
        self.pulls = np.zeros(len(arm.tendons))
        self.soft = (not jamming,) * len(arm.segments)
        self.follow()

    def follow(self, pulls=None, soft=None):
        """Let the motors go there at once."""
        self.pulls = self.pulls if pulls is None else np.array(pulls, dtype=float)
        self.soft = self.soft if soft is None else tuple(soft)
        self.truth.follow(self.pulls, self.soft)
        if any(self.soft):
            self.predicted = self.statics.solve(self.predicted, self.pulls, self.soft)
        self._tell()

    def _tell(self):
        self.estimator.follow(Commands(
            self.time, self.pulls, tuple(not soft for soft in self.soft)))

    def wait(self, seconds):
        """Let time pass, with the motors at rest."""
        self.time += seconds
        self._tell()

    def look(self, count=5):
        """Measure a resting arm some times; return the last innovation."""
        found = None
        for _ in range(count):
            self.wait(PERIOD)
            found = self.estimator.measure(self.time, self.truth.seen(self.rng, **self.seen))
        return found

    def switch(self, soft, look=3):
        """Soften or stiffen, wait until the shape counts again, and look."""
        self.follow(soft=soft)
        self.wait(2.0)
        self.look(look)

    def move(self, pulls, steps=4, look=1):
        """Go to pulls slowly, and look on the way."""
        begin = self.pulls
        for part in np.arange(1, steps + 1) / steps:
            self.time += 1.0
            self.follow(begin + part * (np.asarray(pulls) - begin))
            self.wait(0.9)
            self.look(look)

    def tip_errors(self):
        """Return by how much the tips of the estimate and of the prediction are off, m."""
        return [float(np.linalg.norm(state.tip - self.truth.state.tip))
                for state in (self.estimator.state, self.predicted)]
