# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Measured tensions tell how stiff a soft segment is, and are not taken for more than that."""

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest

from soft_continuum.estimation.measuring import ActuatorState, DiscMeasurement, predicted
from soft_continuum.estimation.shape import ArmShape, ShapeError
from soft_continuum.estimation.unknowns import arm_with, Drift, first_values, indices_of, Prior
from soft_continuum.mechanics import Statics
from soft_continuum.mechanics.arm import mounted
from soft_continuum.nodes.kinematics import MeasuredTensions, TENSION_INTERVAL, UNCHECKED_TIME
from soft_continuum_interfaces.msg import TendonActuationState
from support.true_arm import ARM, commands, only, Session, STIFF, TrueArm

HANGING = replace(ARM, gravity=mounted(pi))
KNOWN = Prior(ratio=0.05, offset=1e-5, payload=1e-3, straight=1e-3)  # all but the stiffness
NO_DRIFT = Drift(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
FACTORS = (0.8, 1.0, 1.0)
BENDING = (0.010, -0.020)  # m: the left tendon is slack
NAMES = ('right_tendon', 'left_tendon')
PARAMETERS = {'estimation.tension_stddev': 0.3, 'estimation.tension_relative_stddev': 0.1,
              'tension_tolerance': 5.0}


def bent(prior=KNOWN, **truth):
    """Return a session that saw nothing; the lowest segment is soft, bent and at rest."""
    session = Session(TrueArm(arm=HANGING, **truth), HANGING, prior, NO_DRIFT)
    session.switch(only(0), look=0)
    session.move(BENDING, look=0)
    session.wait(1.0)
    return session


def pull(session, **pulled):
    return session.estimator.measure(session.time, session.truth.pulled(**pulled))


def remembered(estimator):
    return np.concatenate([estimator.values, estimator.covariance.ravel(),
                           estimator.state.joint_angles])


@pytest.mark.parametrize('pulls', [BENDING, (-0.020, 0.010), (0.004, -0.0035)])
def test_derivatives_are_those_of_the_tensions_and_of_the_slack(pulls):
    layout = indices_of(ARM)
    statics = Statics(arm_with(ARM, layout, first_values(ARM, layout, Prior())))
    state = statics.solve(statics.chain.straight(), pulls, only(0))
    found, step = predicted(statics, layout, state), 1e-6

    def at(changed):
        there = statics.solve(state, changed, only(0))
        return np.where(there.taut, there.tensions, -there.slack / statics.compliance)

    assert found.tensions == pytest.approx(at(pulls), abs=1e-6)
    for tendon, change in enumerate(step * np.eye(2)):
        expected = (at(pulls + change) - at(pulls - change)) / (2.0 * step)
        assert found.rates.tensions[:, layout.offset][:, tendon] == pytest.approx(
            expected, rel=1e-3, abs=1e-2)


def test_a_taut_tendon_tells_the_stiffness_of_the_segment_that_it_bends():
    session = bent(factors=FACTORS)
    estimator = session.estimator
    layout, before = estimator.layout, estimator.values.copy()
    assert session.truth.state.tensions[0] > 1.0
    for _ in range(10):
        session.wait(0.1)
        assert pull(session).used
    factors = np.exp(estimator.values[layout.stiffness])
    assert factors == pytest.approx(FACTORS, abs=0.07)
    assert estimator.state.tensions == pytest.approx(session.truth.state.tensions, abs=0.2)
    assert estimator.determined()[0]
    # Nothing else is bent to it, and nobody takes the shape to be measured.
    for where in (layout.held, layout.ratio, layout.offset, slice(layout.payload, layout.model)):
        assert np.array_equal(estimator.values[where], before[where])
    assert estimator.measured is None
    assert estimator.updated == pytest.approx(session.time)


def test_slack_tendons_tell_nothing_of_the_stiffness():
    session = Session(TrueArm(factors=FACTORS))
    session.switch(only(0), look=0)
    session.move((-0.010, -0.010), look=0)
    session.wait(1.0)
    for _ in range(10):
        session.wait(0.1)
        assert pull(session).used
    stiffness = session.estimator.layout.stiffness
    assert np.all(session.estimator.values[stiffness] == 0.0)


def test_tensions_are_not_used_in_motion_nor_of_a_stiff_arm():
    session = bent(factors=FACTORS)
    session.follow(soft=STIFF)
    for _ in range(30):
        session.wait(0.2)
        assert pull(session) is None
    session.follow(soft=only(0))
    session.wait(1.9)  # its vacuum still fades
    assert pull(session) is None
    session.wait(0.2)
    assert pull(session) is not None
    session.time += 0.02
    session.follow(pulls=np.array(BENDING) + [1e-4, 0.0])
    before = remembered(session.estimator)
    assert pull(session) is None
    assert np.array_equal(remembered(session.estimator), before)


def test_a_load_cell_that_is_far_off_changes_nothing_however_long():
    session = bent()
    session.look(5)
    assert pull(session).used
    before = remembered(session.estimator)
    for _ in range(5):
        assert not pull(session, error=30.0).used
    assert np.array_equal(remembered(session.estimator), before)
    assert session.measure().used


def test_poses_and_tensions_can_be_given_together():
    session = bent(Prior(), factors=FACTORS, offsets=(3e-4, -3e-4), payload=0.02)
    for _ in range(10):
        session.wait(0.1)
        together = [*session.truth.seen(session.rng), *session.truth.pulled(0.3)]
        innovation = session.estimator.measure(session.time, together)
        assert innovation.used and len(innovation.values) == 11
    assert session.estimator.measured == pytest.approx(session.time)
    points, truth = session.estimator.state.points, session.truth.state.points
    assert np.linalg.norm(points - truth, axis=1).max() < 1e-3
    assert session.estimator.state.tensions == pytest.approx(session.truth.state.tensions, abs=0.3)


def test_tensions_alone_begin_an_estimate_beside_the_prediction():
    truth, shape = TrueArm(factors=FACTORS, arm=HANGING), ArmShape(HANGING, 1e-3)
    time = 100.0
    for pulls, soft in (((0.0, 0.0), STIFF), ((0.0, 0.0), only(0)), (BENDING, only(0))):
        truth.follow(pulls, soft)
        for _ in range(25):
            time += 0.1
            shape.follow(ActuatorState(
                time, np.array(pulls), tuple(not s for s in soft), None, (0, 0)))
            shape.measure(time, truth.pulled())
    assert shape.estimate is not None and shape.estimate.measured is None
    off = [abs(one.tensions[0] - truth.state.tensions[0])
           for one in (shape.state, shape.predicted)]
    assert off[0] < 0.8 * off[1]


def test_tensions_alone_do_not_bend_what_is_described_as_rigid():
    truth, shape, time = TrueArm(ratio=inf), ArmShape(ARM, 1e-3), 100.0
    shape.follow(commands(time, np.zeros(2), STIFF))
    for segment in range(3):
        bent = truth.statics.bend(truth.state, segment, 0.6)
        pulls = np.where(bent.tensions > 0.0, truth.statics.commanded_pulls(bent), -0.05)
        for soft in (only(segment), STIFF):
            truth.follow(pulls, soft)
            for _ in range(15):
                time += 0.2
                shape.follow(commands(time, pulls, soft))
                shape.measure(time, truth.pulled())
    assert shape.estimate is not None and shape.estimate.measured is None
    assert shape.state.bending[:, 1] == pytest.approx([0.6] * 3, abs=5e-3)
    shape.measure(time, truth.seen())  # now they may give
    assert np.exp(shape.estimate.values[shape.estimate.layout.ratio]).max() < 1000.0


def test_a_disc_counts_where_tensions_alone_know_the_shape():
    truth, shape, time = TrueArm(ratio=inf), ArmShape(ARM, 1e-3), 100.0
    bent = truth.statics.bend(truth.state, 0, 0.6)
    pulls = np.where(bent.tensions > 0.0, truth.statics.commanded_pulls(bent), -0.05)
    truth.follow(pulls, only(0))
    shape.follow(commands(time, np.zeros(2), STIFF))
    for _ in range(15):
        time += 0.2
        shape.follow(commands(time, pulls, only(0)))
        shape.measure(time, truth.pulled())
    shape.unpredicted = ShapeError('the model has none')  # when the segment is stiffened
    for _ in range(15):
        time += 0.2
        with pytest.raises(ShapeError, match='unknown'):
            shape.follow(commands(time, pulls, STIFF))
    tip = DiscMeasurement(3, truth.state.poses[::2][3], np.diag([1e-6] * 6))
    assert shape.measure(time, [tip]) is not None
    shape.follow(commands(time, pulls, STIFF))


def test_tensions_do_not_hide_that_the_shape_is_not_known_any_more():
    shape = ArmShape(HANGING, 1e-3)
    truth = TrueArm(factors=FACTORS, arm=HANGING)
    truth.follow((0.0, 0.0), STIFF)
    for step in range(1, 6):
        shape.follow(ActuatorState(0.1 * step, np.zeros(2), (True,) * 3, None, (0, 0)))
        shape.measure(0.1 * step, truth.pulled())
    with pytest.raises(ShapeError):
        shape.follow(ActuatorState(0.7, np.array([0.01, 0.01]), (True,) * 3, None, (0, 0)))


def told(**accuracy):
    """Return the state of a device that tells how well it knows tensions."""
    return TendonActuationState(connected=True, tendons=NAMES, **accuracy)


def test_a_tension_is_trusted_as_far_as_its_device_knows_it():
    tensions = MeasuredTensions(NAMES, PARAMETERS)

    def used(time):
        tensions.put(time, {NAMES[0]: 20.0})
        return [(one.stddev, one.relative) for _, (one,) in tensions.take()]

    assert used(100.0) == [(0.3, 0.1)]
    tensions.receive(told(tension_stddevs=[8.2, 1.0], tension_relative_stddevs=[0.3, 0.2]))
    assert used(101.0) == [(8.2, 0.3)]
    tensions.receive(TendonActuationState())  # it is lost, and may come back
    for wrong in ([8.2], [8.2, 1.0, 1.0], [float('nan')] * 2, [0.0, 1.0], [-8.2, 1.0], [inf] * 2):
        with pytest.raises(ValueError, match=r'tension_stddevs of tendon_actuation/state'):
            tensions.receive(told(tension_stddevs=wrong))
    with pytest.raises(ValueError, match=r'a number from 0 to 1, or none'):
        tensions.receive(told(tension_relative_stddevs=[1.1, 0.2]))
    assert used(102.0) == [(8.2, 0.3)]
    tensions.receive(told())  # a device that does not tell, or a recording of before it could
    assert used(103.0) == [(0.3, 0.1)]


def test_tensions_wait_for_how_well_they_are_known_but_not_for_long():
    told_at, never = (MeasuredTensions(NAMES, PARAMETERS, UNCHECKED_TIME) for _ in range(2))
    for each in (told_at, never):
        each.put(100.0, {NAMES[0]: 20.0})
        assert each.take() == []
    told_at.receive(told(tension_stddevs=[8.2, 8.2]))
    for each, stddev in ((told_at, 8.2), (never, 0.3)):
        each.put(100.0 + UNCHECKED_TIME, {NAMES[0]: 20.0})
        (_, (one,)), = each.take()
        assert one.stddev == stddev


@pytest.mark.parametrize(('seen', 'model', 'cell', 'servo'), [
    (0.0, 20.0, 'slack', ''), (0.0, 30.0, 'slack', 'slack'),
    (45.0, 20.0, 'friction', ''), (60.0, 20.0, 'friction', 'friction'),
    (60.0, 0.0, 'friction', 'friction'), (4.0, 0.0, '', '')])
def test_a_tension_differs_from_the_model_by_more_than_its_device_does_not_know(
        seen, model, cell, servo):
    tensions = MeasuredTensions(NAMES, PARAMETERS)
    for words in (cell, servo):
        for time in (0.0, 1.0, 3.0):
            problem = tensions.problem(time, {NAMES[0]: seen}, [model, 0.0])
        assert words in problem
        assert bool(problem) is bool(words)
        # Three deviations: 24.6 N near 0, 30.5 N of a tension of 20 N.
        tensions = MeasuredTensions(NAMES, PARAMETERS)
        tensions.receive(told(tension_stddevs=[8.2] * 2, tension_relative_stddevs=[0.3] * 2))


def test_ten_tensions_a_second_are_used_of_cells_that_measure():
    tensions = MeasuredTensions(NAMES, PARAMETERS)
    tensions.put(100.0, {})  # no load cells
    assert tensions.take() == []
    used = []
    for n in range(50):
        tensions.put(100.0 + 0.02 * n, {NAMES[0]: float('nan'), NAMES[1]: 4.0})
        used += tensions.take()
    assert 1.0 / TENSION_INTERVAL - 1 <= len(used) <= 1.0 / TENSION_INTERVAL + 1
    for _, (one,) in used:
        assert (one.tendon, one.tension, one.stddev, one.relative) == (1, 4.0, 0.3, 0.1)
