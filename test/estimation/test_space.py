# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The estimate of an arm in space: the same filter, against the truth and against the plane."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from soft_continuum.estimation import anomalies
from soft_continuum.estimation.estimator import Estimator, OWN_SHARE
from soft_continuum.estimation.measuring import ActuatorState, DiscMeasurement, predicted
from soft_continuum.estimation.shape import ArmShape, UnknownShapeError
from soft_continuum.estimation.unknowns import arm_with, Drift, first_values, indices_of, Prior
from soft_continuum.mechanics.rotations import displacement
from soft_continuum.mechanics.space.statics import SpaceStatics
from soft_continuum.ros.description import load_arm
from soft_continuum.user_files import description_file
from support.spatial_arms import in_space
from support.spatial_truth import ARM, COVARIANCE, DEVIATIONS, PRIOR, SpatialSession, SpatialTruth
from support.true_arm import ARM as PLANAR
from support.true_arm import only, Session, STIFF, TrueArm

TENDON_ARM = load_arm(description_file().with_name('tendon_arm.yaml'))
UNSEEN = 1e6  # m^2 or rad^2
NEAR = {'factors': (1.2, 0.9, 0.8), 'ratio': 20.0, 'offsets': (4e-4, -3e-4, 2e-4), 'payload': 0.02}


def toward(angle, direction):
    """Return pulls (3,) that bend a segment towards a direction; a little slack."""
    return 0.02 * angle * np.cos(2.0 * pi / 3.0 * np.arange(3) - direction) - 4e-4


def set_shape(session, turned=0.0):
    """Set one segment after the other."""
    session.look(3)
    for segment, (angle, direction) in enumerate(((0.4, 0.5), (0.4, 2.0), (0.5, -1.0))):
        session.switch(only(segment))
        session.move(session.pulls + toward(angle, direction + turned), steps=3)
        session.switch(STIFF)


# What is predicted.


def test_derivatives_are_those_of_solves():
    layout = indices_of(ARM)
    values = first_values(ARM, layout, PRIOR)
    values[layout.ratio], values[layout.payload] = np.log(10.0), 0.05
    pulls, now_soft = toward(0.5, 0.7), (True, False, False)
    bent = SpaceStatics(arm_with(ARM, layout, values)).chain.uniform(
        [[0.0, 0.0], [0.1, 0.2], [-0.1, 0.1]])

    def at(change):
        statics = SpaceStatics(arm_with(ARM, layout, values + change))
        start = bent.with_held(statics.chain, change[layout.held].reshape(-1, 2))
        return predicted(statics, layout, statics.solve(
            start, pulls + change[layout.offset], now_soft))

    here, step = at(np.zeros(layout.size)), 1e-5
    assert here.tensions.min() < 0.0 < here.tensions.max()  # taut and slack ones
    for row in (2, 5, layout.stiffness.start, layout.ratio.start + 1, layout.offset.start,
                layout.offset.start + 1, layout.payload):
        more, less = (at(sign * step * np.eye(layout.size)[row]) for sign in (1.0, -1.0))
        poses = [displacement(a, b) / (2.0 * step)
                 for a, b in zip(more.poses, less.poses, strict=True)]
        assert here.rates.poses[:, :, row] == pytest.approx(np.array(poses), rel=1e-4, abs=1e-6)
        tensions = (more.tensions - less.tensions) / (2.0 * step)
        assert here.rates.tensions[:, row] == pytest.approx(tensions, rel=1e-3, abs=1e-2)


# Against the truth.


@pytest.fixture(scope='module')
def learned():
    """A session in which each segment of an arm of other parameters, and finer, was set once."""
    session = SpatialSession(SpatialTruth(**NEAR), own=0.0)
    set_shape(session)
    return session


def test_the_estimate_is_far_nearer_to_the_truth_than_the_prediction(learned):
    estimated, alone = learned.tip_errors()
    assert alone > 5e-3
    assert estimated < 0.1 * alone
    away = np.linalg.norm(learned.estimator.state.points - learned.truth.state.points, axis=1)
    assert away.max() < 6e-4


def test_what_can_be_seen_is_learned(learned):
    estimator = learned.estimator
    layout = estimator.layout
    assert estimator.determined()[:6].all()  # stiffness and K
    away = np.abs(estimator.offsets - NEAR['offsets'])
    assert np.all(away < 3.0 * estimator.stddevs()[layout.offset])


def test_an_arm_turned_about_its_axis_has_the_turned_estimate(learned):
    turn = 0.9
    turned = replace(ARM, tendons=tuple(replace(t, angle=t.angle + turn) for t in ARM.tendons))
    session = SpatialSession(SpatialTruth(turned, **NEAR), turned, own=0.0)
    set_shape(session)
    about_z = Rotation.from_rotvec([0.0, 0.0, turn])
    assert session.estimator.state.points == pytest.approx(
        about_z.apply(learned.estimator.state.points), abs=1e-7)
    where = session.estimator.layout.parameters
    assert session.estimator.values[where] == pytest.approx(
        learned.estimator.values[where], abs=1e-5)
    assert session.estimator.stddevs()[where] == pytest.approx(
        learned.estimator.stddevs()[where], rel=1e-3)


def test_a_planar_arm_has_the_planar_estimate():
    arm = in_space(PLANAR)
    plane = Session(TrueArm((1.2, 0.9, 0.8), 20.0, (3e-4, -5e-4)), own=0.0)
    space = Estimator(arm, SpaceStatics(arm).chain.straight(), PRIOR, Drift())
    for now_soft, pulls in ((STIFF, (0.0, 0.0)), (only(2), (0.003, -0.006)),
                            (only(2), (0.006, -0.012)), (STIFF, (0.006, -0.012)),
                            (only(1), (0.008, -0.014))):
        plane.time += 1.0
        plane.follow(pulls, now_soft)
        for _ in range(4):
            space.follow(ActuatorState(plane.time, plane.pulls, tuple(not s for s in plane.soft)))
            plane.wait(0.5)
            space.follow(ActuatorState(plane.time, plane.pulls, tuple(not s for s in plane.soft)))
            seen = plane.truth.seen()
            ours, theirs = plane.measure(), space.measure(plane.time, seen)
            assert (ours is None) == (theirs is None)
            assert ours is None or ours.distance == pytest.approx(theirs.distance, rel=0.02)
    assert space.state.tip == pytest.approx(plane.estimator.state.tip, abs=1e-6)
    ours, theirs = (one.layout.parameters for one in (plane.estimator, space))
    assert space.values[theirs] == pytest.approx(plane.estimator.values[ours], abs=2e-4)
    assert space.stddevs()[theirs] == pytest.approx(plane.estimator.stddevs()[ours], rel=1e-3)


@pytest.mark.parametrize('spatial', [False, True])
def test_the_deviations_of_the_tip_are_those_of_its_errors(spatial):
    # Arms drawn from the prior, by a camera whose errors are mostly the same in all pictures.
    prior, errors = Prior(stiffness=0.1, ratio=0.3, offset=3e-4, payload=0.01), []
    hanging = replace(ARM if spatial else PLANAR, gravity=(0.0, 0.0, 9.80665))
    axes = hanging.pose_axes
    for seed in range(6 if spatial else 5):
        rng = np.random.default_rng(seed)
        drawn = (np.exp(prior.stiffness * rng.standard_normal(3)),
                 30.0 * np.exp(prior.ratio * rng.standard_normal()),
                 prior.offset * rng.standard_normal(len(hanging.tendons)),
                 abs(prior.payload * rng.standard_normal()))
        truth = SpatialTruth(hanging, *drawn, 4) if spatial else TrueArm(*drawn, hanging)
        session = Session(
            truth, hanging, prior, seed=seed, own=OWN_SHARE**0.5, bias=(1.0 - OWN_SHARE)**0.5
            * truth.DEVIATIONS * rng.standard_normal((4, axes.sum())))

        def error(session=session, truth=truth):
            away = displacement(session.estimator.state.poses[-2], truth.state.poses[-2])[axes]
            covariance = session.estimator.pose_covariances()[-1][np.ix_(axes, axes)]
            return away @ np.linalg.solve(covariance, away)

        session.look(2 if spatial else 3)
        each = [error()]
        session.switch(only(1), look=2)
        session.move(toward(rng.uniform(0.2, 0.5), rng.uniform(-pi, pi)) if spatial
                     else (0.008, -0.012), steps=2 if spatial else 3)
        each.append(error())
        session.switch(STIFF, look=2)
        errors.append([*each, error()])
    assert np.all(np.mean(errors, axis=0) < chdtri(axes.sum() * len(errors), 0.05) / len(errors))


def test_an_arm_without_jamming_is_estimated_too():
    offsets = 1e-4 * np.array([3, -2, 1, 4, -3, 2, 1, -4, 3])
    session = SpatialSession(SpatialTruth(TENDON_ARM, (1.2, 0.9, 0.8), offsets=offsets, bodies=1),
                             TENDON_ARM, jamming=False)
    pulls = dict.fromkeys(TENDON_ARM.tendon_names, 0.0) | {
        'tip_1': 0.004, 'tip_2': -0.002, 'tip_3': -0.002}
    session.move(list(pulls.values()), steps=3)
    session.look(5)
    estimated, alone = session.tip_errors()
    assert estimated < 0.2 * alone
    assert estimated < 1e-3


# What is measured in part, or wrongly.


def bent():
    """Return a session with a bent arm, just before it is looked at."""
    session = SpatialSession(SpatialTruth(offsets=(6e-4, -6e-4, 0.0)), own=0.0)
    session.switch(only(1), look=0)
    session.move(toward(0.4, 1.0), steps=2, look=0)
    return session


@pytest.mark.parametrize('known', [(0, 1, 2), (3, 4, 5), (3, 4), (0,)])
def test_any_part_of_a_pose_corrects_the_arm(known):
    session = bent()
    covariance = UNSEEN * np.eye(6)
    covariance[np.ix_(known, known)] = COVARIANCE[np.ix_(known, known)]
    session.seen['covariance'] = covariance

    def error():
        away = displacement(*(one.state.poses[-2] for one in (session.estimator, session.truth)))
        return np.linalg.norm((away / DEVIATIONS)[list(known)])

    before = error()
    session.look(10)
    assert error() < 0.4 * before


def test_a_heading_that_is_not_measured_is_not_used():
    # As of an IMU: its disc is turned about z anyhow.
    covariance = COVARIANCE.copy()
    covariance[5, 5] = UNSEEN
    values = []
    for heading in (0.0, 2.0, -3.0):
        session = bent()
        about_z = Rotation.from_rotvec([0.0, 0.0, heading])
        seen = []
        for one in session.truth.seen(covariance=covariance):
            pose = one.pose.copy()
            pose[3:] = (about_z * Rotation.from_quat(pose[3:])).as_quat()
            seen.append(replace(one, pose=pose))
        values.append(session.estimator.measure(session.time, seen).values)
        assert len(values[-1]) == 15
    assert values[1] == pytest.approx(values[0], abs=1e-12)
    assert values[2] == pytest.approx(values[0], abs=1e-12)


# Found by its discs.


def discs_of(state, which=(1, 2, 3)):
    return [DiscMeasurement(n, state.poses[2 * n].copy(), COVARIANCE) for n in which]


def test_a_bent_arm_is_found_by_its_discs():
    shape, bending = ArmShape(ARM, 1e-3), np.array([[0.3, 0.2], [-0.2, 0.25], [0.1, -0.4]])
    state = SpaceStatics(ARM).chain.uniform(bending)
    with pytest.raises(UnknownShapeError):
        shape.follow(ActuatorState(100.0, np.full(3, -0.03), (True,) * 3))
    assert shape.measure(100.0, discs_of(state, (1, 2))) is None
    assert 'every disc' in shape.refusal(100.0)
    for _ in range(5):
        assert shape.measure(100.0, discs_of(state)) is not None
    assert shape.state.bending == pytest.approx(bending, abs=0.01)
    assert shape.state.points == pytest.approx(state.points, abs=5e-4)


@pytest.mark.parametrize('about_y', [0.0, 0.8])
def test_where_up_is_corrects_an_arm_that_leans_but_not_its_heading(about_y):
    """The vertical of a tilted base is along no axis; a turn about it changes nothing."""
    base = Rotation.from_euler('y', about_y)
    up = base.apply([0.0, 0.0, 1.0])
    poses = SpaceStatics(ARM).chain.uniform([[0.3, 0.2], [-0.2, 0.25], [0.1, -0.4]]).poses[::2]
    covariance = UNSEEN * np.eye(6)
    covariance[3:, 3:] = 1e-4 * np.eye(3) + UNSEEN * np.outer(up, up)
    one = DiscMeasurement(3, poses[3], covariance)
    assert len(one.parts) == 2
    headed = replace(one, pose=off(poses[3], 0.0, 0.9 * up))
    assert one.differs(headed) == pytest.approx([0.0, 0.0], abs=1e-6)
    across = base.apply([0.6, 0.8, 0.0])
    leaning = replace(one, pose=off(poses[3], 0.0, 0.02 * across))
    assert np.linalg.norm(one.differs(leaning)) == pytest.approx(2.0, abs=1e-3)


def off(pose, shift, turn):
    """Return a pose that is shifted (m) and turned (rad)."""
    turned = Rotation.from_rotvec(turn) * Rotation.from_quat(pose[3:])
    return np.concatenate([pose[:3] + shift, turned.as_quat()])


def test_what_could_be_wrong_is_followed_a_little_with_each_message(monkeypatch):
    """All at once, at a switch of a bent arm, they kept kinematics silent for 0.8 s."""
    shape, truth, work, time = ArmShape(ARM, 1e-3), SpatialTruth(bodies=4), [], 100.0
    rng, solve = np.random.default_rng(1), Estimator.follow

    def follow(estimator, commands):
        solve(estimator, commands)
        work[-1].append(estimator.state.iterations)

    monkeypatch.setattr(Estimator, 'follow', follow)

    def go(pulls, stiff, seconds):
        nonlocal time
        for _ in range(round(seconds / 0.1)):
            time += 0.1
            work.append([])
            truth.follow(pulls, [not one for one in stiff])
            shape.follow(ActuatorState(time, pulls, stiff))
            shape.measure(time, truth.seen(rng, discs=range(4)))

    stiff, pulls = (True,) * 3, np.zeros(3)
    go(pulls, stiff, 1.6)
    for segment, (angle, direction) in enumerate(((0.6, 1.0), (-0.6, 1.0), (0.7, -1.0))):
        switched = tuple(s != segment for s in range(3))
        go(pulls, switched, 1.0)
        for part in np.linspace(0.1, 1.0, 10):
            go(pulls + part * toward(angle, direction), switched, 0.1)
        pulls = pulls + toward(angle, direction)
        go(pulls, stiff, 2.0)
    hardest = max(max(each, default=0) for each in work)
    assert hardest > 2 * anomalies.WORK
    assert max(map(sum, work)) < 2 * hardest  # no two of these with one message
    assert sum(map(len, work)) > 300  # all were followed
