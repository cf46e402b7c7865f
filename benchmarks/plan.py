# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Plans by tip among obstacles: how many random goals are reached, how soon, and what is wrong."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import pi
from time import process_time

import numpy as np

from benchmarks.lab import Description, Lab, LabError, NOTHING
from benchmarks.plan_contenders import base_to_tip, NoPlanError, ours, rrt_connect
from benchmarks.queries import AROUND, check, MARGIN, nearest, Query, random_query, Verdict
from benchmarks.tables import machine, Section, table
from benchmarks.timing import progress
from soft_continuum.mechanics.arm import Arm, Array, mounted
from soft_continuum.mechanics.rotations import planar_pose
from soft_continuum.mechanics.statics import StaticsError
from soft_continuum.planning.plans import Move, PlanError
from soft_continuum.sim.twin.model_errors import read_model_errors
from soft_continuum.user_files import description_file

QUERIES, IN_SPACE, ON_TWIN, QUICK = 500, 200, 60, 7
LIMIT, LIMIT_IN_SPACE = 5.0, 10.0  # s of processor time
PIECE = 0.1  # s of a motion of the twin between two looks
ARCS = 12  # points of a segment of the twin, which tells its discs only

Contender = Callable[[Description, Query, float], Sequence[Move]]
OURS = 'soft_continuum, first plan'
CONTENDERS: dict[str, Contender] = {
    OURS: ours, 'base to tip, obstacles ignored': base_to_tip,
    'OMPL RRT-Connect over angles': rrt_connect}
HEAD = ('planner', 'solved', 'without violation', 'collisions', 'time, s: median', '95 %',
        'softenings, mean')


@dataclass(frozen=True)
class Result:
    """What one contender made of one query; verdict None where it found no plan in time."""

    verdict: Verdict | None
    seconds: float
    softenings: int
    moves: Sequence[Move] = ()


def run(quick: bool) -> Section:
    """Measure; the section is of the page about planning."""
    upright = Description.read()
    planar = (upright, replace(upright, arm=replace(upright.arm, gravity=mounted(pi))))
    spatial = Description.read(description_file().with_name('spatial_jamming.yaml'))
    seeds, others = (range(QUICK), range(3)) if quick else (range(QUERIES), range(IN_SPACE))
    twin: list[float] = []
    results: dict[str, list[Result]] = {name: [] for name in CONTENDERS}
    for seed in seeds:
        description = planar[seed % 2]
        query = random_query(description, seed)
        for name, contender in CONTENDERS.items():
            results[name].append(judged(description, query, contender, LIMIT))
        if results[OURS][-1].verdict and len(twin) < (
                2 if quick else ON_TWIN) and query.obstacles:
            twin.append(on_twin(description, query, seed,
                                results[OURS][-1].moves))
        progress(f'plan: query {seed}')
    rows = [row(name, each) for name, each in results.items()]
    in_space = []
    for seed in others:
        in_space.append(judged(spatial, random_query(spatial, seed), ours, LIMIT_IN_SPACE))
        progress(f'plan: query {seed} in space')
    rows.append(row('soft_continuum, spatial arm', in_space))
    near = np.array(twin)
    body = '\n\n'.join([
        f"{len(seeds)} random goals of the paper's arm, upright and hanging, with 0 to 6 "
        f'obstacles, and {len(others)} of `config/spatial_jamming.yaml`. Each can be reached with '
        f'at least {1e3 * MARGIN:g} mm of clearance. Solved: a plan within {LIMIT:g} s of '
        f'processor time, for the spatial arm {LIMIT_IN_SPACE:g} s. A separate checker looks for '
        'collisions, jumps, exceeded limits (it allows 10 mrad beyond `bending_angle_limits`) and '
        'missed tips every 10 ms, without lock-in, friction or wrong stiffness. '
        + machine(),
        table(HEAD, rows),
        f'{len(near)} of the plans around obstacles were run in open loop on the simulated rig '
        f'(`typical`): {int((near > 0.0).sum())} touched nothing, '
        f'{int((near >= MARGIN).sum())} kept the whole margin. The smallest clearance was '
        f'{1e3 * near.min():.1f} mm.'])
    return Section('benchmarks/planning.md', 'plan', body)


def judged(description: Description, query: Query, contender: Contender, limit: float) -> Result:
    """Return how a contender did."""
    began = process_time()
    try:
        moves = contender(description, query, limit)
    except (NoPlanError, PlanError, StaticsError, StopIteration):
        return Result(None, process_time() - began, 0)
    seconds = process_time() - began
    if seconds > limit:
        return Result(None, seconds, 0)
    return Result(check(description, query, moves), seconds, len(moves), moves)


def row(name: str, results: Sequence[Result]) -> list[str]:
    """Return the row of a contender."""
    solved = [one for one in results if one.verdict is not None]
    problems = [set(one.verdict.problems) for one in solved if one.verdict]
    seconds = [one.seconds for one in results]
    return [name, f'{len(solved)} of {len(results)}', str(sum(not some for some in problems)),
            str(sum('collision' in some for some in problems)), f'{np.median(seconds):.2f}',
            f'{np.quantile(seconds, 0.95):.2f}',
            f'{np.mean([one.softenings for one in solved]):.2f}' if solved else '-']


def on_twin(description: Description, query: Query, seed: int, moves: Sequence[Move]) -> float:
    """Return how near the simulated arm comes to an obstacle when moves are run, m."""
    given = read_model_errors(description_file().with_name('twin.yaml'), 'typical')
    lab = Lab(description, replace(given, seed=seed), NOTHING)
    least = float('inf')

    def run_moves(several: Sequence[Move], looks: bool) -> None:
        nonlocal least
        for move in several:
            lab.switch(move.segment, False)
            least = min(least, _near(description.arm, lab, query)) if looks else least
            for begin in np.arange(0.0, move.times[-1], PIECE):
                times = np.linspace(begin, min(begin + PIECE, move.times[-1]), 5)
                lab.follow(times - begin, np.stack(
                    [np.interp(times, move.times, tendon) for tendon in move.pulls.T], axis=1))
                least = min(least, _near(description.arm, lab, query)) if looks else least
            lab.wait(1.0)
            lab.switch(move.segment, True)
            least = min(least, _near(description.arm, lab, query)) if looks else least

    try:
        run_moves(query.before, looks=False)
        run_moves(moves, looks=True)
    except LabError as error:
        progress(f'plan: query {seed} on the twin: {error}')
        return float('nan')
    return least


def _near(arm: Arm, lab: Lab, query: Query) -> float:
    """Return how far the simulated arm is from the nearest obstacle, m: discs, arcs between."""
    discs, rims = planar_pose(lab.truth).reshape(-1, 2, 3), []
    turn = np.linspace(0.0, 2.0 * pi, AROUND, endpoint=False)
    for s, segment in enumerate(arm.segments):
        below, above = discs[s, 1], discs[s + 1, 0]
        for part in np.linspace(0.0, 1.0, ARCS):
            rims.append((_between(below, above, part), segment.outer_diameter / 2))
        rims.append((discs[s + 1, 1], segment.outer_diameter / 2))
    points = [np.array([x, 0.0, z]) + radius * (
        np.cos(turn)[:, None] * [np.cos(angle), 0.0, -np.sin(angle)]
        + np.sin(turn)[:, None] * [0.0, 1.0, 0.0]) for (x, z, angle), radius in rims]
    return nearest(query.obstacles, np.concatenate(points))


def _between(below: Array, above: Array, part: float) -> Array:
    """Return a pose of the cubic curve between two poses (x, z, angle), with their tangents."""
    length = float(np.hypot(*(above - below)[:2]))
    one, other = ([length * np.sin(pose[2]), length * np.cos(pose[2])] for pose in (below, above))
    h = (2 * part**3 - 3 * part**2 + 1, part**3 - 2 * part**2 + part,
         3 * part**2 - 2 * part**3, part**3 - part**2)
    x, z = (h[0] * below[k] + h[1] * one[k] + h[2] * above[k] + h[3] * other[k] for k in (0, 1))
    return np.array([x, z, (1.0 - part) * below[2] + part * above[2]])
