# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm that is not the described one, and what a camera sees of it."""

from dataclasses import replace

import numpy as np

from soft_continuum.estimation.estimator import Estimator
from soft_continuum.estimation.measuring import ActuatorState, DiscMeasurement, TensionMeasurement
from soft_continuum.estimation.unknowns import Drift, Prior
from soft_continuum.mechanics.chain import Chain
from soft_continuum.mechanics.laws import Jam
from soft_continuum.mechanics.rotations import displaced, UNKNOWN
from soft_continuum.mechanics.statics import Statics
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from support.paper_arm import only, plane_points

ARM = replace(load_arm(description_file()), bodies_per_segment=4)
DEVIATIONS = np.array([3e-4, 3e-4, 2e-3])  # m, m, rad: of the camera
COVARIANCE = np.diag(DEVIATIONS**2)
PERIOD = 0.1  # s between two measurements
STIFF = (False,) * 3
PRIOR, DRIFT = Prior(), Drift()


def commands(time, pulls, soft):
    """Return what the estimator is told of motors and valves."""
    return ActuatorState(time, pulls, tuple(not s for s in soft))


class TrueArm:
    """The arm as it is: other stiffness, jams that give, tendons of another length, a payload."""

    DEVIATIONS, COVARIANCE = DEVIATIONS, COVARIANCE

    def __init__(self, factors=1.0, ratio=30.0, offsets=0.0, payload=0.0, arm=ARM):
        """Begin straight and stiff; ratio: K; the others are those of an Estimator."""
        self.statics = Statics(replace(
            self.as_built(arm), payload=payload, segments=tuple(replace(
                s, stiffness_x=s.stiffness_x * f, stiffness_y=s.stiffness_y * f,
                torsional_stiffness=s.torsional_stiffness * f, jam=Jam(ratio))
                for s, f in zip(arm.segments, np.broadcast_to(factors, len(arm.segments)),
                                strict=True))))
        self.axes, self.offsets = arm.pose_axes, np.broadcast_to(offsets, len(arm.tendons))
        self.state = self.statics.chain.straight()

    def as_built(self, arm):
        """Return an arm with the tendons that it has."""
        return arm.with_tendons(axial_stiffness=2e4)

    def follow(self, pulls, soft, vacuum=None):
        """Let the motors go to ``pulls``."""
        self.state = self.statics.solve(
            self.state, np.asarray(pulls) + self.offsets, soft, vacuum=vacuum)

    @property
    def discs(self):
        """Poses of the bottoms of all discs."""
        return plane_points(self.state)[::2]

    def seen(self, rng=None, bias=None, own=0.3, discs=(1, 2, 3), covariance=None):
        """
        Return what is measured: off by a bias in all, and by noise of its own.

        bias (discs, axes) and covariance (axes, axes): of the axes along and about which discs
        of the arm move.
        """
        measured = UNKNOWN * np.eye(6)
        measured[np.ix_(self.axes, self.axes)] = (
            self.COVARIANCE if covariance is None else covariance)
        found = []
        for n in discs:
            pose, error = self.state.poses[2 * n], np.zeros(6)
            if bias is not None:
                error[self.axes] += bias[n]
            if rng is not None:
                error[self.axes] += own * self.DEVIATIONS * rng.standard_normal(self.axes.sum())
            found.append(DiscMeasurement(n, displaced(pose, error), measured))
        return found

    def pulled(self, stddev=0.1, error=0.0):
        """Return what load cells show of the tensions, off by an error (N)."""
        return [TensionMeasurement(t, float(tension) + error, stddev)
                for t, tension in enumerate(np.nan_to_num(self.state.tensions))]


class Session:
    """A true arm, planar or spatial, and its estimator, moved together."""

    def __init__(self, truth, arm=ARM, prior=PRIOR, drift=DRIFT, seed=0, soft=STIFF, **seen):
        """Begin with a straight arm; seen: arguments of TrueArm.seen."""
        self.truth, self.seen = truth, seen
        self.estimator = Estimator(arm, Chain(arm).straight(), prior, drift)
        self.rng = np.random.default_rng(seed)
        self.time, self.pulls, self.soft = 100.0, np.zeros(len(arm.tendon_names)), soft
        self.follow()

    def follow(self, pulls=None, soft=None):
        """Let the motors go there at once."""
        self.pulls = self.pulls if pulls is None else np.array(pulls, dtype=float)
        self.soft = self.soft if soft is None else tuple(soft)
        self.truth.follow(self.pulls, self.soft)
        self.estimator.follow(commands(self.time, self.pulls, self.soft))

    def wait(self, seconds):
        """Let time pass, with the motors at rest."""
        self.time += seconds
        self.estimator.follow(commands(self.time, self.pulls, self.soft))

    def measure(self, **seen):
        """Measure now."""
        return self.estimator.measure(
            self.time, self.truth.seen(self.rng, **{**self.seen, **seen}))

    def look(self, count=5):
        """Measure a resting arm some times; return the last innovation."""
        found = None
        for _ in range(count):
            self.wait(PERIOD)
            found = self.measure()
        return found

    def switch(self, soft, look=3):
        """Soften or stiffen, wait until the shape counts again, and look."""
        self.follow(soft=soft)
        self.wait(2.0)
        self.look(look)

    def move(self, pulls, steps=6, look=1):
        """Go to pulls slowly, and look on the way."""
        begin = self.pulls
        for part in np.arange(1, steps + 1) / steps:
            self.time += 1.0
            self.follow(begin + part * (np.asarray(pulls) - begin))
            self.wait(0.9)
            self.look(look)

    def set(self, segment, pulls, **steps):
        """Soften a segment, move, stiffen it."""
        self.switch(only(segment))
        self.move(pulls, **steps)
        self.switch(STIFF)
