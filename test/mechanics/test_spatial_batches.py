# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Many spatial arms solved at once, and paths, are the same solved one by one."""

from dataclasses import replace

import numpy as np
import pytest

from soft_continuum.mechanics import Jam, OverconstrainedError, SLACK, Statics, StaticsError
from soft_continuum.mechanics.batch import solve_batch, solve_path
from soft_continuum.mechanics.space.statics import SpaceStatics
from support import paper_arm as paper
from support.spatial_arms import three_segments

SOFT = (True, False, True)
PULLS = np.array([(0.006, -0.004, -0.003), (-0.002, 0.004, -0.003), (0.0, 0.0, 0.002)])


def test_rows_are_as_one_by_one():
    models = [SpaceStatics(three_segments(payload=p)) for p in (0.0, 0.01, 0.02)]
    starts = [m.chain.straight() for m in models]
    batch = solve_batch(models, starts, PULLS, SOFT)
    assert len(batch) == 3 and batch.found.all()
    for i, state in enumerate(batch):
        alone = models[i].solve(starts[i], PULLS[i], SOFT)
        assert state.points == pytest.approx(alone.points, abs=1e-12)
        assert batch.tips[i] == pytest.approx(alone.tip, abs=1e-12)
        assert batch.tensions[i] == pytest.approx(alone.tensions, abs=1e-9)
        assert batch.bending[i] == pytest.approx(alone.bending, abs=1e-12)
        assert batch.configurations[i] == pytest.approx(alone.rotations, abs=1e-12)


def test_one_arm_under_many_pulls_and_given_tensions():
    statics = SpaceStatics(three_segments())
    start, given = statics.chain.straight(), (np.nan, np.nan, 0.5)
    batch = solve_batch(statics, start, PULLS, SOFT, tensions=given)
    assert batch.tensions[:, 2] == pytest.approx(0.5)
    for row, state in zip(PULLS, batch, strict=True):
        assert state.tip == pytest.approx(
            statics.solve(start, row, SOFT, tensions=given).tip, abs=1e-12)


@pytest.mark.parametrize('plane', [False, True], ids=['space', 'plane'])
def test_friction_vacuum_and_given_tensions_of_each_row_are_as_one_by_one(plane):
    arm = paper.build(bodies_per_segment=4) if plane else three_segments()
    arm = replace(arm, segments=tuple(replace(s, jam=Jam(5.0)) for s in arm.segments),
                  tendons=tuple(replace(t, friction=0.2) for t in arm.tendons))
    statics, count = Statics(arm), len(arm.tendons)
    start = statics.chain.uniform([(0.0, 0.1)] * 3)
    more = {'vacuum': [(1.0, 0.5, 0.0), (0.2, 1.0, 1.0), (1.0, 1.0, 1.0)],
            'sliding': np.array([(1, -1, 1), (0, 0, 0), (-1, 1, 0)])[:, :count],
            'tensions': np.array([(np.nan,) * 3, (0.7, np.nan, np.nan), (np.nan,) * 3])[:, :count]}
    with pytest.raises(ValueError, match='friction'):
        solve_batch(statics, start, PULLS[:, :count], SOFT)
    batch = solve_batch(statics, start, PULLS[:, :count], SOFT, **more)
    for i, state in enumerate(batch):
        alone = statics.solve(start, PULLS[i, :count], SOFT,
                              **{name: rows[i] for name, rows in more.items()})
        for name in ('configuration', 'tensions', 'pulls', 'slack', 'held', 'vacuum'):
            assert getattr(state, name) == pytest.approx(getattr(alone, name), abs=1e-12), name


def test_any_mixture_of_arms_starts_masks_and_drives_is_as_one_by_one():
    random = np.random.default_rng(3)
    hanging = three_segments(gravity=(3.0, 0.0, 9.0))
    arms = [three_segments(payload=0.02), hanging.with_compliant_tendons(2e-5),
            three_segments(jam=Jam(4.0))]
    models = [SpaceStatics(arms[i % 3]) for i in range(60)]
    starts = [m.solve(m.chain.straight(), random.uniform(-0.004, 0.002, 3), (True,) * 3)
              for m in models]
    masks = random.integers(0, 2, (60, 3)).astype(bool)
    pulls = np.array([s.pulls for s in starts]) + random.uniform(-0.006, 0.002, (60, 3))
    pulls[::7, 1] = SLACK
    forces = np.full((60, 3), np.nan)
    forces[::5, 2] = random.uniform(0.0, 2.0, 12)
    batch = solve_batch(models, starts, pulls, masks, tensions=forces)
    assert 40 < batch.found.sum() < 60  # stiff arms cannot follow
    for i, model in enumerate(models):
        try:
            alone = model.solve(starts[i], pulls[i], masks[i], tensions=forces[i])
        except StaticsError:
            assert not batch.found[i]
            continue
        for name in ('configuration', 'tensions', 'pulls', 'slack', 'held', 'tip', 'bending'):
            assert getattr(batch[i], name) == pytest.approx(
                getattr(alone, name), abs=1e-12, nan_ok=True)
        assert (batch[i].stiff, batch[i].jumped) == (alone.stiff, alone.jumped)
        assert batch.tips[i] == pytest.approx(alone.tip, abs=1e-12)
        assert batch.bending[i] == pytest.approx(alone.bending, abs=1e-12)


def test_rows_without_an_equilibrium_are_nan():
    statics = SpaceStatics(three_segments())
    masks = [SOFT, (False,) * 3, SOFT]
    batch = solve_batch(statics, statics.chain.straight(), PULLS, masks)
    assert batch.found.tolist() == [True, False, True]
    assert np.isnan(batch.tips[1]).all() and np.isnan(batch.configurations[1]).all()
    with pytest.raises(LookupError, match='problem 1'):
        batch[1]
    assert len(batch[::2]) == 2


def test_a_path_is_followed_as_in_the_plane():
    flat = paper.build(bodies_per_segment=4)
    planar, solid = Statics(flat), SpaceStatics(flat)
    pulls = np.array([(p, -0.01 - p) for p in np.linspace(0.0, 0.006, 40)])
    masks = [(True, False, False)] * 20 + [(False, False, True)] * 20
    wanted = solve_path(planar, planar.chain.straight(), pulls, masks)
    found = solve_path(solid, solid.chain.straight(), pulls, masks)
    assert found.tips == pytest.approx(wanted.tips, abs=1e-9)
    assert found.bending == pytest.approx(wanted.bending, abs=1e-8)
    assert found.jumped.tolist() == wanted.jumped.tolist()


def test_a_path_that_ends_says_in_which_row():
    statics = SpaceStatics(three_segments())
    masks = [SOFT, SOFT, (False,) * 3]
    with pytest.raises(OverconstrainedError, match='row 2 of 3'):
        solve_path(statics, statics.chain.straight(), PULLS, masks)


def test_a_path_there_and_back_ends_where_it_began():
    statics = SpaceStatics(three_segments(gravity=(0.0, 0.0, 9.8)))
    part = np.sin(np.linspace(0.0, np.pi, 61))[:, None]
    path = solve_path(statics, statics.chain.straight(), part * PULLS[0], (True,) * 3)
    assert path.tips[-1] == pytest.approx(path.tips[0], abs=1e-9)
    assert not path.jumped.any()


@pytest.mark.parametrize(('change', 'words'), [
    ({'soft': [SOFT] * 2}, '3 rows of pulls and 2 soft masks do not go together'),
    ({'arms': None}, 'arms must be'), ({'start': 3}, 'the start must be')])
def test_what_does_not_go_together_is_refused(change, words):
    statics = SpaceStatics(three_segments())
    given = {'arms': statics, 'start': statics.chain.straight(), 'pulls': PULLS, 'soft': SOFT}
    with pytest.raises(ValueError, match=words):
        solve_batch(**{**given, **change})


def test_arms_of_other_sizes_and_paths_of_other_lengths_are_refused():
    statics = SpaceStatics(three_segments())
    other = SpaceStatics(replace(three_segments(), bodies_per_segment=2))
    with pytest.raises(ValueError, match='same number'):
        solve_batch([statics, other], statics.chain.straight(), PULLS[0], SOFT)
    with pytest.raises(ValueError, match='or as many'):
        solve_path(statics, statics.chain.straight(), PULLS, [SOFT] * 2)
