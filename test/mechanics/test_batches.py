# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many arms solved at once, and paths, are the same arms solved one by one."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from soft_continuum.mechanics import (
    Jam,
    MomentCurvature,
    OverconstrainedError,
    SLACK,
    solve_batch,
    solve_path,
    Statics,
    StaticsError,
)
from soft_continuum.mechanics.arm import mounted
from support import paper_arm as paper
from support.flat_arm import guides_of, made_of
from support.general_arms import arms, between, FEW, masks, paper_like
from support.spatial_arms import three_segments

BOTH = (True, True)
SOFT = (True, False, True)
PULLS = np.array([(0.006, -0.004, -0.003), (-0.002, 0.004, -0.003), (0.0, 0.0, 0.002)])


def each(values, count):
    """Return one value for every problem, of those for each or of one for all."""
    return values if isinstance(values, list) and len(values) == count else [values] * count


def assert_as_one_by_one(models, starts, pulls, masks, tolerance=1e-12, **more):
    """Solve a batch, check each of its rows against Statics.solve, and return it."""
    batch = solve_batch(models, starts, pulls, masks, **more)
    count = len(batch)
    rows = zip(each(models, count), each(starts, count), np.broadcast_to(
        pulls, (count, np.shape(pulls)[-1])), each(masks, count), strict=True)
    for i, (model, start, asked, soft) in enumerate(rows):
        drives = {name: values[i] for name, values in more.items()}
        try:
            alone = model.solve(start, asked, soft, **drives)
        except StaticsError:
            assert not batch.found[i] and not batch.jumped[i]
            for part in ('configurations', 'tensions', 'pulls', 'slack', 'residual', 'tips'):
                assert np.isnan(getattr(batch, part)[i]).all()
            with pytest.raises(LookupError, match=f'problem {i}'):
                batch[i]
            continue
        assert batch.found[i]
        assert batch.residual[i] <= (1e-10 if model.chain.arm.planar else 1e-8)
        for part in ('configuration', 'tensions', 'pulls', 'slack', 'held', 'vacuum', 'poses'):
            assert getattr(batch[i], part) == pytest.approx(
                getattr(alone, part), abs=tolerance, rel=1e-9, nan_ok=True), part
        assert (batch[i].stiff, batch[i].jumped) == (alone.stiff, alone.jumped)
        assert batch.configurations[i] == pytest.approx(alone.configuration, abs=tolerance)
        assert batch.tips[i] == pytest.approx(alone.poses[-1, :3], abs=tolerance)
        assert batch.bending[i] == pytest.approx(alone.bending, abs=tolerance)
    return batch


@FEW
@given(arms(stretch=True, jam=st.sampled_from([Jam(), Jam(5.0), Jam(5.0, yield_moment=0.02)])),
       st.data())
def test_one_arm_under_many_pulls(arm, data):
    statics, soft = Statics(arm), data.draw(masks(arm))
    reach = sum(min(pair) for pair, free in zip(guides_of(arm), soft, strict=True) if free)
    right = [data.draw(between(-0.3, 0.6)) * reach for _ in range(6)]
    left = [data.draw(st.sampled_from([SLACK, -1.2 * abs(p) - 1e-3])) for p in right]
    asked = np.array([right, left]).T
    asked[::2] = asked[::2, ::-1]
    batch = assert_as_one_by_one(statics, statics.chain.straight(), asked, soft)
    assert batch.configurations.shape == (6, statics.chain.bodies)


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
    assert_as_one_by_one(models, models[0].chain.straight(), asked, (True, False))


def hanging(arm):
    return replace(arm, gravity=(3.0, 0.0, 9.0))


SPATIAL = [three_segments(payload=0.02), hanging(three_segments()).with_compliant_tendons(2e-5),
           three_segments(jam=Jam(4.0))]


@pytest.mark.parametrize('plane', [False, True], ids=['space', 'plane'])
def test_any_mixture_of_arms_starts_masks_and_drives_is_as_one_by_one(plane):
    random, count, tendons = np.random.default_rng(3), 40, 2 if plane else 3
    kinds = [paper_like(3, Jam(6.0), gravity=9.80665, mounting_angle=m, tendon=made_of(stretch))
             for m, stretch in ((2.0, np.inf), (1.5, 5e3))] if plane else SPATIAL
    models = [Statics(kinds[i % len(kinds)]) for i in range(count)]
    starts = [m.solve(m.chain.straight(), (p, *random.uniform(-0.006, -0.004, tendons - 1)),
                      (True,) * 3) for m, p in zip(models, random.uniform(-0.004, 0.002, count),
                                                   strict=True)]
    masks = random.integers(0, 2, (count, 3)).astype(bool).tolist()
    pulls = np.array([s.pulls for s in starts]) + random.uniform(-0.006, 0.002, (count, tendons))
    pulls[::7, 1] = SLACK
    forces = np.full((count, tendons), np.nan)
    forces[::5, -1] = random.uniform(0.0, 2.0, len(forces[::5]))
    batch = assert_as_one_by_one(models, starts, pulls, masks, tensions=forces)
    assert batch.found.sum() > 25
    assert plane or not batch.found.all()  # rigid arms cannot follow
    forth = batch.configurations[batch.found]
    back = solve_batch(models[::-1], starts[::-1], pulls[::-1], masks[::-1], tensions=forces[::-1])
    assert np.array_equal(forth, back.configurations[::-1][batch.found])


def test_more_arms_than_are_solved_side_by_side_are_as_one_by_one():
    random, count = np.random.default_rng(5), 400
    arms = [Statics(paper_like(3, gravity=9.80665, mounting_angle=m, tendon=made_of(stretch)))
            for m in (2.0, 2.5, 3.0) for stretch in (np.inf, 5e3)]
    models = [arms[i] for i in random.integers(0, len(arms), count)]
    masks = [[(True, True, True), (True, False, True)][i] for i in random.integers(0, 2, count)]
    # Far enough that some converge late, not at all, or with both tendons taut.
    pulls = np.column_stack([random.choice([0.002, 0.03, 0.06], count) * random.random(count),
                             random.choice([SLACK, -0.03, 0.0], count)])
    pulls[::2] = pulls[::2, ::-1]
    start, alone = arms[0].chain.straight(), []
    batch = solve_batch(models, start, pulls, masks)
    for i in range(count):
        try:
            alone.append(models[i].solve(start, pulls[i], masks[i]))
        except StaticsError:
            alone.append(None)
    assert batch.found.tolist() == [state is not None for state in alone]
    found = [i for i in range(count) if batch.found[i]]
    assert batch.configurations[found] == pytest.approx(
        np.array([alone[i].configuration for i in found]), abs=1e-11)
    assert batch.tensions[found] == pytest.approx(
        np.array([alone[i].tensions for i in found]), abs=1e-9)
    assert (batch.tensions > 1e-3).all(axis=1).sum() > 10 and len(found) > 300


@pytest.mark.parametrize('plane', [False, True], ids=['space', 'plane'])
def test_friction_vacuum_and_given_tensions_of_each_row_are_as_one_by_one(plane):
    arm = paper.build(bodies_per_segment=4) if plane else three_segments()
    arm = replace(arm, segments=tuple(replace(
        s, jam=Jam(5.0, stiffness_exponent=0.7)) for s in arm.segments),
        tendons=tuple(replace(t, friction=0.2) for t in arm.tendons))
    statics, count = Statics(arm), len(arm.tendons)
    start, pulls = statics.chain.uniform([(0.0, 0.1)] * 3), PULLS[:, :count]
    more = {'vacuum': [(1.0, 0.5, 0.0), (0.2, 1.0, 1.0), (1.0, 1.0, 1.0)],
            'sliding': np.array([(1, -1, 1), (0, 0, 0), (-1, 1, 0)])[:, :count],
            'tensions': np.array([(np.nan,) * 3, (0.7, np.nan, np.nan), (np.nan,) * 3])[:, :count]}
    with pytest.raises(ValueError, match='friction'):
        solve_batch(statics, start, pulls, SOFT)
    batch = assert_as_one_by_one(statics, start, pulls, SOFT, **more)
    assert batch[1].vacuum == (0.2, 1.0, 1.0)
    path = solve_path(statics, start, pulls[:1], SOFT, **{
        name: rows[:1] for name, rows in more.items()})
    assert path.configurations[0] == pytest.approx(batch.configurations[0], abs=1e-9)


@pytest.mark.parametrize('gravity', [0.0, 9.80665])
def test_rows_that_a_full_step_does_not_reach_are_followed_in_small_ones(gravity):
    statics = Statics(paper_like(3, gravity=gravity, mounting_angle=1.0))
    asked = np.array([(p, SLACK) for p in np.linspace(-0.01, 0.09, 11)])
    batch = assert_as_one_by_one(statics, statics.chain.straight(), asked, (True,) * 3)
    turned = np.abs(batch.bending[batch.found]).max()
    assert turned > 0.9  # more than a full step is trusted with


def test_rows_that_fall_over_or_buckle_say_that_they_jumped():
    light, heavy = (Statics(paper_like(2, gravity=9.80665, payload=p)) for p in (0.0, 0.3))
    batch = assert_as_one_by_one([light, heavy, light, heavy], light.chain.straight(),
                                 np.full((4, 2), SLACK), BOTH)
    assert batch.jumped.tolist() == [False, True, False, True]
    statics = Statics(paper_like(3, tendon=made_of(5000.0)))
    batch = assert_as_one_by_one(statics, statics.chain.straight(),
                                 np.array([[0.001, 0.001], [0.004, 0.003]]), (True,) * 3)
    assert batch.jumped.tolist() == [True, False]  # pulled unlike it bends without a jump


def test_rows_without_an_equilibrium_are_nan_and_do_not_touch_the_others():
    statics = Statics(paper_like(2))
    asked = np.array([(0.01, SLACK), (0.05, 0.05), (SLACK, 0.02), (0.5, SLACK)])
    batch = assert_as_one_by_one(statics, statics.chain.straight(), asked, BOTH)
    assert batch.found.tolist() == [True, False, True, False]
    assert batch[-2].joint_angles == pytest.approx(batch.configurations[2])
    assert len(batch[::2]) == 2
    for index in (-1, slice(None)):
        with pytest.raises(LookupError, match='problem [13]'):
            batch[index]
    with pytest.raises(IndexError):
        batch[4]


def test_a_single_problem_is_a_batch_of_one():
    statics = Statics(paper_like(2))
    batch = assert_as_one_by_one(statics, statics.chain.straight(), (0.01, SLACK), BOTH)
    assert batch.configurations.shape == (1, statics.chain.bodies)


def test_arms_of_which_some_are_rigid_where_others_are_elastic_are_not_mixed_up():
    rigid, elastic = Statics(paper_like(2)), Statics(paper_like(2, Jam(5.0)))
    for models in ([rigid, elastic], [elastic, rigid]):
        try:
            assert_as_one_by_one(models, rigid.chain.straight(), np.array([(0.01, SLACK)] * 2),
                                 (True, False))
        except ValueError:
            continue  # refused is as good as solved


def test_soft_and_very_stiff_arms_do_not_share_their_tolerances():
    base = paper_like(1, gravity=9.80665, mounting_angle=1.0)
    models = [Statics(replace(base, segments=(replace(
        base.segments[0], stiffness_y=stiffness),))) for stiffness in (900.0, 0.0265)]
    start, asked = models[0].chain.straight(), np.array([(1e-4, SLACK), (0.01, SLACK)])
    batch = solve_batch(models, start, asked, (True,))
    alone = models[1].solve(start, asked[1], (True,))
    assert batch.configurations[1] == pytest.approx(alone.joint_angles, abs=1e-12)


LAWS = (MomentCurvature((0.0, 1.0, 3.0), (0.0, 0.02, 0.05)),
        MomentCurvature((0.0, 1.0, 3.0), (0.0, 0.03, 0.05)))


@pytest.mark.parametrize('kinds', [
    [{'soft_law': LAWS[0]}] * 2,
    [{'jam': Jam(law=MomentCurvature((0.0, 1.0, 3.0), (0.0, 0.1, 0.3)))}] * 2,
    [{'soft_law': LAWS[0]}, {'soft_law': LAWS[1]}], [{}, {'soft_law': LAWS[0]}]])
def test_measured_laws_of_each_arm(kinds):
    models = [Statics(paper_like(1, **kind)) for kind in kinds]
    assert_as_one_by_one(models, models[0].chain.straight(),
                         np.array([(0.01, SLACK), (SLACK, 0.02)]), (True,))


def test_a_batch_goes_on_from_the_states_of_another():
    statics = Statics(paper_like(2))
    first = solve_batch(statics, statics.chain.straight(), [(0.01, SLACK), (0.02, SLACK)], BOTH)
    second = solve_batch(statics, first, (0.025, SLACK), [(True, False), (False, True)])
    held = [first[0].bending_angles[1], first[1].bending_angles[0]]
    assert [second[0].bending_angles[1], second[1].bending_angles[0]] == pytest.approx(held)
    assert not np.allclose(second.bending, first.bending, atol=0.01)


# Paths

@pytest.mark.parametrize('plane', [False, True], ids=['space', 'plane'])
def test_a_path_of_pulls_is_followed_from_row_to_row(plane):
    statics = Statics(paper_like(3, Jam(8.0)) if plane else three_segments(jam=Jam(8.0)))
    asked = np.array([(0.01, SLACK, SLACK), (0.02, SLACK, SLACK), (0.02, SLACK, SLACK),
                      (SLACK, 0.015, SLACK)])[:, :2 if plane else 3]
    masks = [(True,) * 3, (True,) * 3, (True, False, True), (False, True, True)]
    path = solve_path(statics, statics.chain.straight(), asked, masks)
    state = statics.chain.straight()
    for i, (pulls, soft) in enumerate(zip(asked, masks, strict=True)):
        state = statics.solve(state, pulls, soft)
        assert path[i].configuration is path[i].configuration
        assert path.configurations[i] == pytest.approx(state.configuration, abs=1e-9)
        assert path[i].stiff == state.stiff
        assert path.jumped[i] == state.jumped
    assert path.tips[-1] == pytest.approx(state.poses[-1, :3], abs=1e-9)
    with pytest.raises(StaticsError, match='row 1 of 2') as caught:
        solve_path(statics, statics.chain.straight(), asked[[0, 0]] + [[0.0], [0.5]], (True,) * 3)
    assert caught.value.state.configuration.shape == state.configuration.shape
    with pytest.raises(ValueError, match='4 rows of pulls'):
        solve_path(statics, statics.chain.straight(), asked, masks[:2])


def test_a_path_onto_a_rigid_arm_ends_there():
    statics = Statics(three_segments())
    with pytest.raises(OverconstrainedError, match='row 2 of 3'):
        solve_path(statics, statics.chain.straight(), PULLS, [SOFT, SOFT, (False,) * 3])


def test_a_path_there_and_back_ends_where_it_began():
    statics = Statics(three_segments(gravity=(0.0, 0.0, 9.8)))
    part = np.sin(np.linspace(0.0, np.pi, 61))[:, None]
    path = solve_path(statics, statics.chain.straight(), part * PULLS[0], (True,) * 3)
    assert path.tips[-1] == pytest.approx(path.tips[0], abs=1e-9)
    assert not path.jumped.any()


# What is refused

@pytest.mark.parametrize('asked', [
    (), (0.01,), (0.01, 0.0, 0.0), [[0.01], [0.02]], [[np.nan, 0.0]], [[[0.01, 0.0]]],
    [[np.inf, 0.0]], np.zeros((0, 2))])
def test_pulls_that_are_not_pairs_are_refused(asked):
    statics = Statics(paper_like(2))
    with pytest.raises(ValueError):
        solve_batch(statics, statics.chain.straight(), asked, BOTH)


ONE, SHORT, COARSE = (Statics(arm) for arm in (
    paper_like(2), paper_like(1), paper_like(2, bodies=3)))


@pytest.mark.parametrize(('changes', 'words'), [
    *((changes, 'given') for changes in (
        {'start': None}, {'soft': None}, {'soft': True}, {'sliding': 1}, {'arms': None},
        {'arms': paper_like(2)}, {'vacuum': 1.0})),
    ({'arms': [ONE] * 3}, '3 arms and 2 rows of pulls'), ({'arms': [ONE, SHORT]}, 'same number'),
    ({'arms': [ONE, COARSE]}, 'same number'), ({'arms': []}, '.'), ({'soft': (True,)}, 'soft'),
    ({'start': SHORT.chain.straight()}, '.'),
    ({'start': [ONE.chain.straight()] * 2, 'soft': [BOTH] * 3, 'pulls': (0.0, 0.0)},
     '2 starts and 3 soft masks')])
def test_what_is_no_input_of_a_batch_or_does_not_go_together_is_refused(changes, words):
    given = {'arms': ONE, 'start': ONE.chain.straight(), 'pulls': [(0.0, 0.0)] * 2, 'soft': BOTH}
    with pytest.raises(ValueError, match=words):
        solve_batch(**given | changes)
