# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many arms solved at once are the same arms solved one by one."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import SLACK, Statics, StaticsError
from soft_continuum.mechanics.arm import mounted
from soft_continuum.mechanics.batch import solve_batch, solve_path
from soft_continuum.mechanics.laws import Jam, MomentCurvature
from support.flat_arm import guides_of, made_of
from support.general_arms import arms, between, FEW, masks, paper_like


def assert_as_one_by_one(batch, models, start, asked, soft):
    """Check every row of a batch against Statics.solve, to 1e-12."""
    for i, pulls in enumerate(asked):
        try:
            state = models[i % len(models)].solve(start, pulls, soft)
        except StaticsError:
            assert not batch.found[i]
            for rows in (batch.configurations, batch.tensions, batch.pulls, batch.residual):
                assert np.all(np.isnan(rows[i]))
            assert not batch.jumped[i]
            continue
        assert batch.found[i]
        assert batch.configurations[i] == pytest.approx(state.joint_angles, abs=1e-12)
        assert batch.tensions[i] == pytest.approx(state.tensions, abs=1e-12, rel=1e-12)
        assert batch.pulls[i] == pytest.approx(state.pulls, abs=1e-12)
        assert batch.jumped[i] == state.jumped
        assert batch.residual[i] <= 1e-10


@FEW
@given(arms(stretch=True, jam=st.sampled_from([Jam(), Jam(5.0), Jam(5.0, yield_moment=0.02)])),
       st.data())
def test_one_arm_under_many_pulls(arm, data):
    statics = Statics(arm)
    soft = data.draw(masks(arm))
    start = statics.chain.straight()
    reach = sum(min(pair) for pair, free in zip(guides_of(arm), soft, strict=True) if free)
    right = [data.draw(between(-0.3, 0.6)) * reach for _ in range(6)]
    left = [data.draw(st.sampled_from([SLACK, -1.2 * abs(p) - 1e-3])) for p in right]
    asked = np.array([right, left]).T
    asked[::2] = asked[::2, ::-1]
    batch = solve_batch(statics, start, asked, soft)
    assert batch.configurations.shape == (6, statics.chain.bodies)
    assert_as_one_by_one(batch, [statics], start, asked, soft)


@FEW
@given(st.lists(st.tuples(between(0.5, 2.0), between(0.0, 3.0), between(0.0, 0.02)),
                min_size=2, max_size=8), st.sampled_from([Jam(), Jam(4.0)]))
def test_many_arms_under_their_own_pulls(kinds, jam):
    base = paper_like(2, jam, gravity=9.80665)
    models = [Statics(replace(
        base, gravity=mounted(mounting), payload=0.01 * stiffness, segments=tuple(
            replace(s, stiffness_y=stiffness * s.stiffness_y)
            for s in base.segments))) for stiffness, mounting, _ in kinds]
    asked = np.array([(pull, SLACK) for _, _, pull in kinds])
    start = models[0].chain.straight()
    batch = solve_batch(models, start, asked, (True, False))
    assert_as_one_by_one(batch, models, start, asked, (True, False))


def test_many_arms_under_the_same_pulls():
    models = [Statics(paper_like(2, gravity=9.80665, mounting_angle=m)) for m in (1.0, 2.0, 3.0)]
    start = models[0].chain.straight()
    batch = solve_batch(models, start, (0.01, SLACK), (True, True))
    assert_as_one_by_one(batch, models, start, [(0.01, SLACK)] * 3, (True, True))


@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_rows_that_a_full_step_does_not_reach_are_followed_in_small_ones(gravity):
    statics = Statics(paper_like(3, gravity=gravity, mounting_angle=1.0))
    start, soft = statics.chain.straight(), (True,) * 3
    asked = np.array([(p, SLACK) for p in np.linspace(-0.01, 0.09, 11)])
    batch = solve_batch(statics, start, asked, soft)
    turned = np.abs(batch.configurations.reshape(11, 3, -1).sum(axis=2)).max(axis=1)
    assert np.any(turned[batch.found] > 0.9)  # more than a full step is trusted with
    assert_as_one_by_one(batch, [statics], start, asked, soft)


def test_rows_that_fall_over_say_that_they_jumped():
    light, heavy = (Statics(paper_like(2, gravity=9.80665, payload=p)) for p in (0.0, 0.3))
    start = light.chain.straight()
    asked = np.array([(SLACK, SLACK)] * 4)
    batch = solve_batch([light, heavy, light, heavy], start, asked, (True, True))
    assert batch.jumped.tolist() == [False, True, False, True]
    assert np.all(batch.found)
    assert_as_one_by_one(batch, [light, heavy], start, asked, (True, True))


def test_rows_without_an_equilibrium_are_nan_and_do_not_touch_the_others():
    statics = Statics(paper_like(2))
    start, soft = statics.chain.straight(), (True, True)
    asked = np.array([(0.01, SLACK), (0.05, 0.05), (SLACK, 0.02), (0.5, SLACK)])
    batch = solve_batch(statics, start, asked, soft)
    assert batch.found.tolist() == [True, False, True, False]
    assert_as_one_by_one(batch, [statics], start, asked, soft)


def test_a_single_problem_is_a_batch_of_one():
    statics = Statics(paper_like(2))
    start = statics.chain.straight()
    batch = solve_batch(statics, start, (0.01, SLACK), (True, True))
    assert batch.configurations.shape == (1, statics.chain.bodies)
    assert_as_one_by_one(batch, [statics], start, [(0.01, SLACK)], (True, True))


def test_the_order_of_the_problems_does_not_matter():
    statics = Statics(paper_like(3, tendon=made_of(1e4)))
    start, soft = statics.chain.straight(), (True, False, True)
    asked = np.array([(p, SLACK) for p in np.linspace(0.0, 0.03, 40)])
    forth = solve_batch(statics, start, asked, soft)
    back = solve_batch(statics, start, asked[::-1], soft)
    assert np.array_equal(forth.configurations, back.configurations[::-1])
    assert np.array_equal(forth.tensions, back.tensions[::-1])


def test_a_batch_starts_from_a_bent_shape_and_keeps_what_is_stiff():
    statics = Statics(paper_like(3, Jam(6.0), gravity=9.80665, mounting_angle=2.0))
    start = statics.solve(statics.chain.straight(), (0.02, SLACK), (True,) * 3)
    soft = (False, True, False)
    asked = np.array([(p, SLACK) for p in (0.015, 0.02, 0.025)])
    assert_as_one_by_one(
        solve_batch(statics, start, asked, soft), [statics], start, asked, soft)


def test_arms_of_which_some_are_rigid_where_others_are_elastic_are_not_mixed_up():
    rigid, elastic = Statics(paper_like(2)), Statics(paper_like(2, Jam(5.0)))
    start, soft = rigid.chain.straight(), (True, False)
    asked = np.array([(0.01, SLACK)] * 2)
    for models in ([rigid, elastic], [elastic, rigid]):
        try:
            batch = solve_batch(models, start, asked, soft)
        except ValueError:
            continue  # refused is as good as solved
        assert_as_one_by_one(batch, models, start, asked, soft)


def test_soft_and_very_stiff_arms_do_not_share_their_tolerances():
    base = paper_like(1, gravity=9.80665, mounting_angle=1.0)
    models = [Statics(replace(base, segments=(replace(
        base.segments[0], stiffness_y=stiffness),))) for stiffness in (900.0, 0.0265)]
    start, asked = models[0].chain.straight(), np.array([(1e-4, SLACK), (0.01, SLACK)])
    batch = solve_batch(models, start, asked, (True,))
    alone = models[1].solve(start, asked[1], (True,))
    assert batch.configurations[1] == pytest.approx(alone.joint_angles, abs=1e-12)


@pytest.mark.parametrize('asked', [
    (), (0.01,), (0.01, 0.0, 0.0), [[0.01], [0.02]], [[np.nan, 0.0]], [[[0.01, 0.0]]],
    [[np.inf, 0.0]], np.zeros((0, 2))])
def test_pulls_that_are_not_pairs_are_refused(asked):
    statics = Statics(paper_like(2))
    with pytest.raises(ValueError):
        solve_batch(statics, statics.chain.straight(), asked, (True, True))


def test_arms_and_pulls_that_do_not_go_together_are_refused():
    one, short, coarse = (Statics(a) for a in (
        paper_like(2), paper_like(1), paper_like(2, bodies=3)))
    start = one.chain.straight()
    with pytest.raises(ValueError, match='3 arms and 2 rows of pulls'):
        solve_batch([one] * 3, start, [(0.01, SLACK)] * 2, (True, True))
    for other in (short, coarse):
        with pytest.raises(ValueError, match='same number'):
            solve_batch([one, other], start, [(0.01, SLACK)] * 2, (True, True))
    with pytest.raises(ValueError):
        solve_batch([], start, (0.01, SLACK), (True, True))
    with pytest.raises(ValueError, match='soft'):
        solve_batch(one, start, (0.01, SLACK), (True,))
    with pytest.raises(ValueError):
        solve_batch(one, short.chain.straight(), (0.01, SLACK), (True, True))
    with pytest.raises(ValueError, match='2 starts and 3 soft masks'):
        solve_batch(one, [start] * 2, (0.01, SLACK), [(True, True)] * 3)


LAWS = (MomentCurvature((0.0, 1.0, 3.0), (0.0, 0.02, 0.05)),
        MomentCurvature((0.0, 1.0, 3.0), (0.0, 0.03, 0.05)))


@pytest.mark.parametrize('kinds', [
    [{'soft_law': LAWS[0]}],
    [{'jam': Jam(law=MomentCurvature((0.0, 1.0, 3.0), (0.0, 0.1, 0.3)))}],
    [{'soft_law': LAWS[0]}, {'soft_law': LAWS[1]}], [{}, {'soft_law': LAWS[0]}]])
def test_measured_laws_of_each_arm(kinds):
    models = [Statics(paper_like(1, **kind)) for kind in kinds]
    start = models[0].chain.straight()
    asked = np.array([(0.01, SLACK), (SLACK, 0.02)])
    assert_as_one_by_one(solve_batch(models, start, asked, (True,)), models, start, asked, (True,))


def test_every_problem_with_a_start_and_a_mask_of_its_own():
    statics = Statics(paper_like(3, Jam(6.0), gravity=9.80665, mounting_angle=2.0))
    masks = [(True, False, False), (False, True, True), (False, False, False), (True,) * 3]
    starts = [statics.solve(statics.chain.straight(), (pull, SLACK), (True,) * 3)
              for pull in (0.0, 0.01, 0.02, 0.03)]
    asked = np.array([(0.02, SLACK), (SLACK, 0.01), (0.0, SLACK), (0.01, SLACK)])
    batch = solve_batch(statics, starts, asked, masks)
    assert batch.found.all()
    for i, state in enumerate(batch):
        alone = statics.solve(starts[i], asked[i], masks[i])
        for name in ('joint_angles', 'tensions', 'pulls', 'slack', 'held', 'stiff'):
            assert getattr(state, name) == pytest.approx(getattr(alone, name), abs=1e-12)
        assert batch.bending[i, :, 1] == pytest.approx(alone.bending_angles, abs=1e-12)
        assert batch.tips[i] == pytest.approx(alone.poses[-1, :3], abs=1e-12)
        assert batch.slack[i] == pytest.approx(alone.slack, abs=1e-12)


def test_a_batch_goes_on_from_the_states_of_another():
    statics = Statics(paper_like(2))
    first = solve_batch(statics, statics.chain.straight(), [(0.01, SLACK), (0.02, SLACK)],
                        (True, True))
    second = solve_batch(statics, first, (0.025, SLACK), [(True, False), (False, True)])
    held = [first[0].bending_angles[1], first[1].bending_angles[0]]
    assert [second[0].bending_angles[1], second[1].bending_angles[0]] == pytest.approx(held)
    assert not np.allclose(second.bending, first.bending, atol=0.01)


def test_tendons_with_friction_slide_in_each_problem_their_own_way():
    statics = Statics(paper_like(2, tendon=made_of(friction=0.2)))
    start, soft = statics.chain.straight(), (True, True)
    asked, ways = [(0.02, SLACK)] * 3, [(1, 0), (0, 0), (-1, 0)]
    batch = solve_batch(statics, start, asked, soft, sliding=ways)
    for i, way in enumerate(ways):
        assert batch.tensions[i] == pytest.approx(
            statics.solve(start, asked[i], soft, sliding=way).tensions, rel=1e-12)
    right = batch.tensions[:, 0]
    assert right[0] > 1.05 * right[1] > 1.1 * right[2]
    with pytest.raises(ValueError, match='without_friction'):
        solve_batch(statics, start, asked, soft)


def test_a_row_without_an_equilibrium_has_no_state():
    statics = Statics(paper_like(2))
    batch = solve_batch(statics, statics.chain.straight(), [(0.01, SLACK), (0.5, SLACK)],
                        (True, True))
    assert len(batch) == 2
    assert batch[-2].joint_angles == pytest.approx(batch.configurations[0])
    assert np.isnan(batch.slack[1]).all()
    assert np.isnan(batch.tips[1]).all()
    for index in (1, -1, slice(None)):
        with pytest.raises(LookupError, match='problem 1'):
            batch[index]
    with pytest.raises(IndexError):
        batch[2]


def test_a_path_of_pulls_is_followed_from_row_to_row():
    statics = Statics(paper_like(2, Jam(8.0)))
    asked = [(0.01, SLACK), (0.02, SLACK), (0.02, SLACK), (SLACK, 0.02)]
    masks = [(True, True), (True, True), (True, False), (False, True)]
    path = solve_path(statics, statics.chain.straight(), asked, masks)
    state = statics.chain.straight()
    for i, (pulls, soft) in enumerate(zip(asked, masks, strict=True)):
        state = statics.solve(state, pulls, soft)
        assert path[i].joint_angles is path[i].joint_angles
        assert path.configurations[i] == pytest.approx(state.joint_angles, abs=0.0)
        assert path[i].stiff == state.stiff
    assert path.tips[-1] == pytest.approx(state.poses[-1, :3], abs=1e-12)
    with pytest.raises(StaticsError, match='row 1 of 2') as caught:
        solve_path(statics, statics.chain.straight(), [(0.01, SLACK), (0.5, SLACK)], (True, True))
    assert caught.value.state.joint_angles.shape == (statics.chain.bodies,)
    with pytest.raises(ValueError, match='4 rows of pulls'):
        solve_path(statics, statics.chain.straight(), asked, masks[:2])


def test_a_batch_does_not_find_the_arm_straight_where_it_buckles():
    statics = Statics(paper_like(3, tendon=made_of(5000.0)))
    asked = np.array([[0.001, 0.001], [0.004, 0.003]])
    batch = solve_batch(statics, statics.chain.straight(), asked, (True,) * 3)
    assert batch.jumped.tolist() == [True, False]  # pulled unlike it bends without a jump
    assert_as_one_by_one(batch, [statics], statics.chain.straight(), asked, (True,) * 3)


def test_vacuum_of_each_problem():
    statics = Statics(paper_like(2, Jam(6.0, stiffness_exponent=0.7)))
    bent = statics.solve(statics.chain.straight(), (0.02, SLACK), (True, True))
    asked, soft, parts = (SLACK, SLACK), (False, True), [(1.0, 0.0), (0.3, 0.0)]
    batch = solve_batch(statics, bent, asked, soft, vacuum=parts)
    path = solve_path(statics, bent, [asked], soft, vacuum=parts[1])
    for state, part in ((batch[0], parts[0]), (batch[1], parts[1]), (path[0], parts[1])):
        alone = statics.solve(bent, asked, soft, vacuum=part)
        assert state.joint_angles == pytest.approx(alone.joint_angles, abs=1e-12)
        assert state.vacuum == part
    assert batch.bending[0, 0, 1] > 1.2 * batch.bending[1, 0, 1]


@pytest.mark.parametrize('changes', [
    {'start': None}, {'soft': None}, {'soft': True}, {'sliding': 1}, {'arms': None},
    {'arms': paper_like(2)}, {'vacuum': 1.0}])
def test_what_is_no_input_of_a_batch_is_refused(changes):
    statics = Statics(paper_like(2))
    given = {'arms': statics, 'start': statics.chain.straight(), 'pulls': (0.0, 0.0),
             'soft': (True, True)} | changes
    with pytest.raises(ValueError, match='given'):
        solve_batch(**given)
