# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The estimate of an arm that is not the described one, against the truth."""

from dataclasses import replace
from math import log, pi

import numpy as np
import pytest

from soft_continuum.estimation.estimator import FORGOTTEN, HISTORY, OWN_SHARE, PERSISTENT
from soft_continuum.estimation.measuring import MODEL_ERROR
from soft_continuum.estimation.unknowns import Drift, Prior
from soft_continuum.mechanics.arm import mounted
from soft_continuum.mechanics.laws import Jam, MomentCurvature
from soft_continuum.mechanics.statics import StaticsError
from support import spatial_truth
from support.paper_arm import plane_points
from support.planar import IN_PLANE
from support.true_arm import ARM, commands, COVARIANCE, only, PERIOD, Session, STIFF, TrueArm

HANGING = replace(ARM, gravity=mounted(pi))
NO_DRIFT = Drift(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
ANGLE_ONLY = np.diag([1e6, 1e6, 1e-4])


def remembered(estimator):
    """Return all that the estimator says."""
    return (estimator.values.copy(), estimator.covariance.copy(),
            estimator.state.joint_angles.copy(), estimator.state.tensions.copy())


def unchanged(estimator, before):
    return all(np.array_equal(now, was) for now, was in zip(
        remembered(estimator), before, strict=True))


def positive(covariance):
    """Whether a matrix is symmetric and positive semi-definite, but for rounding."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    correlation = covariance / np.outer(scale, scale)
    return bool(np.abs(correlation - correlation.T).max() < 1e-9
                and np.linalg.eigvalsh((correlation + correlation.T) / 2.0)[0] > -1e-9)


# When it was measured.


def off(session):
    """Return how far x and z, m, and angle, rad, of each point of the estimate are off."""
    return np.abs(plane_points(session.estimator.state) - plane_points(session.truth.state))


def test_it_was_measured_when_the_disc_was_that_has_not_been_for_longest():
    session = Session(TrueArm())
    session.look(3)
    last = session.time
    for _ in range(40):
        session.wait(PERIOD)
        session.measure(discs=(1, 3))
    assert session.estimator.measured == last
    assert session.estimator.hidden(last + 1.0) == [2]
    assert session.estimator.hidden(last - 1.0) == []
    session.look(1)
    assert session.estimator.measured == session.time
    session.wait(FORGOTTEN)
    session.measure(discs=(1, 3))
    assert session.estimator.measured == session.time - FORGOTTEN
    session.wait(PERIOD)
    session.measure(discs=(1, 3))  # which is done without disc 2 by now
    assert session.estimator.measured == session.time
    assert session.estimator.hidden(session.time - 1.0) == []


@pytest.mark.parametrize('shift', [(0.01, -0.006, 0.035), (0.0, 0.004, 0.0)])
def test_what_is_not_trusted_changes_nothing(shift):
    session, bumped = Session(TrueArm(), discs=(0, 1, 2, 3)), np.tile(shift, (4, 1))
    session.look(5)
    last = session.time
    for _ in range(20):
        session.wait(PERIOD)
        before = remembered(session.estimator)
        seen = session.truth.seen(session.rng, bumped, discs=(0, 1, 2, 3))
        assert not session.estimator.measure(session.time, seen, trusted=False).used
        assert unchanged(session.estimator, before)
    assert session.estimator.measured == last
    session.look(1)
    assert session.estimator.measured == session.time


# Without measurements.


def test_without_measurements_values_stay_and_deviations_grow_up_to_those_of_the_prior():
    session = Session(TrueArm())
    estimator = session.estimator
    where = estimator.layout.parameters
    first = estimator.stddevs()[where]
    session.look(5)
    after = estimator.values.copy()
    assert np.any(estimator.stddevs()[where] < 0.7 * first)
    for _ in range(30):
        before = estimator.stddevs()[where]
        session.wait(120.0)
        assert np.array_equal(estimator.values, after)
        assert np.all(estimator.stddevs()[where] >= before * (1.0 - 1e-12))
    assert estimator.stddevs()[where] == pytest.approx(first)
    assert not estimator.determined().any()


def test_motion_alone_makes_nothing_of_the_model_surer():
    session = Session(TrueArm())
    where = session.estimator.layout.parameters
    first = session.estimator.stddevs()[where]
    for segment, pulls in ((0, (0.008, -0.012)), (1, (0.012, -0.018))):
        session.follow(soft=only(segment))
        session.move(pulls, steps=3, look=0)
        session.follow(soft=STIFF)
        assert session.estimator.stddevs()[where] == pytest.approx(first)
    assert np.all(session.estimator.values[where.start:where.start + 3] == 0.0)
    assert session.estimator.measured is None


# What can be seen.


NEAR = {'factors': (1.15, 0.9, 0.85), 'ratio': 20.0, 'offsets': (2e-4, -3e-4), 'payload': 0.02}


@pytest.fixture(scope='module')
def learned():
    """A session in which each segment of another arm was set once."""
    session = Session(TrueArm(arm=HANGING, **NEAR), arm=HANGING)
    session.look(5)
    session.set(0, (0.010, -0.014), steps=3)
    session.set(1, (0.019, -0.025), steps=3)
    session.set(2, (0.026, -0.034), steps=3)
    return session


def truth_of(session):
    return np.concatenate([np.log(NEAR['factors']), np.full(3, log(NEAR['ratio'])),
                           NEAR['offsets'], [NEAR['payload']]])


def test_parameters_that_can_be_seen_come_near_those_of_the_arm(learned):
    estimator = learned.estimator
    where, seen = estimator.layout.parameters, estimator.determined()
    away = np.abs(estimator.values[where] - truth_of(learned))
    assert seen[:6].all() and seen[6:].sum() >= 2
    assert np.all((away < 4.0 * estimator.stddevs()[where])[[0, 1, 2, 6, 7, 8]])
    # K is learned as well; its deviations are too small, where the arm is far from the described.
    assert away[3:6].mean() < 0.6 * log(30.0 / NEAR['ratio'])


def test_the_shape_of_a_learned_arm_is_known_to_half_a_millimetre(learned):
    points, truth = (plane_points(one.state) for one in (learned.estimator, learned.truth))
    assert np.linalg.norm((points - truth)[:, :2], axis=1).max() < 5e-4
    assert np.abs(points - truth)[:, 2].max() < 0.01


def test_what_cannot_be_seen_keeps_its_prior_and_says_so():
    # Upright, straight, and with slack tendons nothing bends: no stiffness, payload or offset.
    session = Session(TrueArm((1.4, 0.7, 0.7), 10.0), drift=NO_DRIFT)
    session.follow(pulls=(-0.01, -0.01))
    first = session.estimator.stddevs()
    session.look(20)
    estimator = session.estimator
    rows = np.r_[estimator.layout.stiffness, estimator.layout.offset]
    assert not estimator.determined()[rows - estimator.layout.parameters.start].any()
    assert estimator.stddevs()[rows] == pytest.approx(first[rows], rel=0.1)
    assert np.abs(estimator.values[estimator.layout.stiffness]).max() < 0.1
    assert np.all(estimator.offsets == 0.0)


# Times.


def moving(**truth):
    """Return a session in the middle of a slow motion, and the discs 0.15 s before its end."""
    session = Session(TrueArm(**truth), own=0.0)
    session.switch(only(2))
    for _ in range(30):
        session.time += 0.05
        session.follow(pulls=session.pulls + [1.5e-4, -2e-4])
    late = session.truth.seen()
    for _ in range(3):
        session.time += 0.05
        session.follow(pulls=session.pulls + [1.5e-4, -2e-4])
    return session, late


def test_a_late_measurement_counts_at_its_stamp():
    distances = []
    for late_by in (0.15, 0.0):
        session, late = moving()
        innovation = session.estimator.measure(session.time - late_by, late)
        distances.append(np.abs(innovation.values).max())
    assert distances[0] < 0.1 * distances[1]


def test_a_late_measurement_corrects_the_present_shape():
    session, late = moving(offsets=(5e-4, -5e-4))
    before = off(session)[-1, 2]
    for _ in range(5):
        late = session.truth.seen()
        for _ in range(3):
            session.time += 0.05
            session.follow(pulls=session.pulls + [1.5e-4, -2e-4])
        assert session.estimator.measure(session.time - 0.15, late).used
    assert off(session)[-1, 2] < 0.3 * before


def test_a_segment_is_not_estimated_to_be_stiffer_than_its_law_says_of_it_when_it_is_stiff():
    arm = replace(ARM, segments=tuple(replace(s, jam=Jam(law=MomentCurvature(
        (0.0, 1.0, 10.0), (0.0, 20.0 * s.stiffness_y, 29.9 * s.stiffness_y))))
        for s in ARM.segments))
    session = Session(TrueArm(factors=(1.6,) * 3), arm=arm)
    session.switch(only(2))
    session.move((0.012, -0.016), steps=3)
    session.wait(3.0)
    for _ in range(6):
        session.wait(0.3)
        session.estimator.measure(session.time, session.truth.seen() + session.truth.pulled())
    factors = np.exp(session.estimator.values[session.estimator.layout.stiffness])
    assert 1.05 < factors[2] < 1.1  # beyond, a row of the law would not grow


def test_measurements_of_another_time_are_not_used():
    session, _ = moving()
    estimator, discs = session.estimator, session.truth.seen()
    before = remembered(estimator)
    for time, reason in ((session.time + 1.0, 'future'), (session.time + 1e9, 'future'),
                         (session.time - HISTORY - 1.0, 'old'), (0.0, 'old'), (-1e9, 'old')):
        assert estimator.measure(time, discs) is None
        assert reason in estimator.ready(time)
        assert unchanged(estimator, before)
    assert estimator.measure(session.time, discs).used  # it would have been


def test_what_the_statics_cannot_follow_changes_nothing():
    session = bent()
    before = remembered(session.estimator)
    with pytest.raises(StaticsError):
        session.estimator.follow(commands(session.time + 1.0, np.array([0.3, 0.3]), only(0)))
    assert unchanged(session.estimator, before)
    assert session.measure().used


def test_nothing_is_measured_while_a_segment_changes_its_stiffness():
    session = Session(TrueArm())
    session.look(2)
    session.time += 1.0
    session.follow(soft=only(1))
    for _ in range(8):
        before = remembered(session.estimator)
        assert session.measure() is None
        assert unchanged(session.estimator, before)
        session.wait(0.1)
    session.wait(1.0)
    assert session.measure().used
    assert session.measure(discs=()) is None


# Sensors that are wrong.


def bent(**truth):
    """Return a session with a bent arm that was looked at."""
    session = Session(TrueArm(**truth))
    session.set(2, (0.006, -0.010), steps=3)
    session.look(10)
    return session


def bent_in_space():
    session = Session(spatial_truth.SpatialTruth(offsets=(6e-4, -6e-4, 0.0), bodies=4),
                      spatial_truth.ARM, own=0.0)
    session.switch(only(1), look=0)
    session.move((0.0039, 0.0033, -0.0084), steps=2, look=0)
    session.look(3)
    return session


@pytest.mark.parametrize(('bent', 'wrong'), [
    (bent, (0.03, 0.0, 0.2)), (bent_in_space, (0.0, 0.03, 0.0, 0.0, 0.0, 0.3))])
def test_outliers_that_good_measurements_interrupt_change_nothing(bent, wrong):
    session, bias = bent(), np.zeros((4, len(wrong)))
    bias[2] = wrong
    for _ in range(3):
        for _ in range(max(1, PERSISTENT - 1)):
            before = remembered(session.estimator)
            assert not session.measure(bias=bias).used
            assert unchanged(session.estimator, before)
        assert session.measure().used
    assert np.abs(session.estimator.state.points - session.truth.state.points).max() < 0.01


def test_a_tendon_that_slipped_is_believed_once_it_persists():
    session = bent()
    session.switch(only(2))
    session.look(5)
    session.truth.offsets = session.truth.offsets - [0.004, 0.004]
    session.follow()
    wrong = off(session)[-1, 2]
    used = []
    for _ in range(30):
        session.wait(0.1)
        used.append(session.measure().used)
    assert not used[0] and used[-1]
    assert off(session)[-1, 2] < 0.1 * wrong


def test_repeated_measurements_make_nothing_surer_than_the_sensor_is():
    # What is wrong alike in all of them: all of the prior and that of the sensor allow.
    session = Session(TrueArm(), own=0.0, discs=(3,), drift=NO_DRIFT,
                      prior=Prior(straight=0.1, ratio=0.0, stiffness=0.0, payload=0.0, offset=0.0))
    alone = session.estimator.pose_covariances()[3][IN_PLANE] - MODEL_ERROR[IN_PLANE]
    session.look(40)
    found = session.estimator.pose_covariances()[3][IN_PLANE] - MODEL_ERROR[IN_PLANE]
    systematic = (1.0 - OWN_SHARE) * COVARIANCE
    least = alone @ np.linalg.solve(alone + systematic, systematic)
    bent = np.ix_([0, 2], [0, 2])  # z of a straight arm does not depend on anything
    assert np.linalg.eigvalsh((found - 0.9 * (least + least.T) / 2.0)[bent])[0] > 0.0
    assert found[2, 2] < 0.01 * alone[2, 2]  # although it is used


def test_angles_alone_are_enough_to_learn_the_shape():
    session = Session(TrueArm(offsets=(6e-4, -6e-4)), covariance=ANGLE_ONLY)
    session.switch(only(1), look=0)
    session.move((0.008, -0.010), steps=3, look=0)
    before = off(session)[:, 2].max()
    session.look(10)
    after = off(session)[:, 2].max()
    assert after < 0.3 * before
    layout = session.estimator.layout
    for disc in (1, 2, 3):  # nothing is learned of positions that were not measured
        assert np.all(session.estimator.covariance[layout.bias(disc)][[0, 2]] == 0.0)
        assert np.all(session.estimator.values[layout.bias(disc)][[0, 2]] == 0.0)


def test_an_angle_and_the_same_a_turn_further_say_the_same():
    found = []
    for turns in (0.0, 2.0 * pi, -2.0 * pi):
        session, bias = Session(TrueArm(offsets=(4e-4, -4e-4))), np.zeros((4, 3))
        bias[:, 2] = turns
        session.switch(only(1), look=0)
        session.move((0.006, -0.010), steps=2, look=0)
        for _ in range(3):
            assert session.measure(bias=bias, own=0.0).used
        found.append(session.estimator.state.joint_angles)
    assert found[1] == pytest.approx(found[0], abs=1e-9)
    assert found[2] == pytest.approx(found[0], abs=1e-9)


# Symmetry and consistency.


def image(discs):
    """Return measurements as a camera behind the arm makes them."""
    signs = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, 1.0])
    return [replace(one, pose=one.pose * [*signs, 1.0],
                    covariance=one.covariance * np.outer(signs, signs)) for one in discs]


def test_mirrored_motions_and_measurements_give_the_mirror_image():
    # The one is seen as it is; the other is told mirrored pulls and shown mirrored poses of it.
    truth = {'factors': (1.2, 0.9, 0.8), 'ratio': 20.0, 'offsets': (3e-4, -5e-4)}
    one = Session(TrueArm(**truth), own=0.0)
    estimator = Session(TrueArm(), own=0.0).estimator

    def step(look):
        estimator.follow(commands(one.time, one.pulls[::-1], one.soft))
        if look:
            ours = one.measure()
            theirs = estimator.measure(one.time, image(one.truth.seen()))
            assert (ours is None) == (theirs is None)
            assert ours is None or ours.distance == pytest.approx(
                theirs.distance, rel=1e-4, abs=1e-6)

    for soft, pulls in ((STIFF, (0.0, 0.0)), (only(2), (0.003, -0.006)),
                        (only(2), (0.006, -0.012)), (STIFF, (0.006, -0.012)),
                        (only(1), (0.008, -0.014))):
        one.time += 1.0
        one.follow(pulls, soft)
        step(False)
        for _ in range(4):
            one.wait(0.4)
            step(True)
    layout = estimator.layout
    assert estimator.state.joint_angles == pytest.approx(-one.estimator.state.joint_angles,
                                                         abs=1e-6)
    assert estimator.offsets == pytest.approx(one.estimator.offsets[::-1], abs=1e-8)
    same = slice(layout.stiffness.start, layout.ratio.stop)
    assert estimator.values[same] == pytest.approx(one.estimator.values[same], abs=1e-4)
    assert estimator.stddevs()[same] == pytest.approx(one.estimator.stddevs()[same], rel=1e-3)
    assert estimator.stddevs()[layout.offset] == pytest.approx(
        one.estimator.stddevs()[layout.offset][::-1], rel=1e-3)


@pytest.mark.parametrize('seed', range(2))
def test_the_covariance_stays_one_through_a_random_sequence(seed):
    rng = np.random.default_rng(seed)
    session = Session(TrueArm((1.2, 0.9, 0.8), 15.0, (5e-4, -5e-4), 0.02), seed=seed)
    for _ in range(60):
        match rng.integers(5):
            case 0:
                session.time += 0.3
                session.follow(soft=[STIFF, *map(only, range(3))][rng.integers(4)])
            case 1 if any(session.soft):
                session.time += 0.2
                session.follow(pulls=np.clip(session.pulls + rng.uniform(-0.002, 0.001, 2),
                                             -0.02, 0.008))
            case 2:
                session.wait(rng.uniform(0.0, 30.0))
            case _:
                session.wait(0.1)
                session.measure(discs=tuple(np.flatnonzero(rng.random(4) < 0.7)[1:]),
                                own=rng.choice([0.3, 30.0]),
                                covariance=[COVARIANCE, ANGLE_ONLY][rng.integers(2)])
        covariance = session.estimator.covariance
        assert np.isfinite(covariance).all()
        assert positive(covariance)
    assert all(np.linalg.eigvalsh(c[IN_PLANE])[0] > 0.0
               for c in session.estimator.pose_covariances())
