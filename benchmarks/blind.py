# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Where the simulated arm ends up when its closed loop loses its sight, beside the open loop."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from benchmarks.closed import closed_loop
from benchmarks.contenders import open_loop
from benchmarks.fault_runs import moved
from benchmarks.lab import CAMERA, Description, Lab
from benchmarks.loop import judged, judged_in, random_goal, Result
from benchmarks.tables import machine, Section, table
from benchmarks.timing import progress
from soft_continuum.estimation.measuring import DiscMeasurement
from soft_continuum.sim.twin.model_errors import ModelErrors, read_model_errors
from soft_continuum.user_files import description_file

FIRST_SEED, SEEDS = 200, 20  # of rigs on which nothing was tried before
MOMENTS = (0.25, 0.5, 0.75)  # parts of the pictures that an undisturbed run takes
TURNED = np.radians([0.0, 2.0, 0.0])  # rad: the camera was bumped, and by how many m
SHIFTED = np.array([0.01, 0.0, -0.006])
Seen = dict[int, DiscMeasurement]
LOST = 'has not been measured'  # in the message of a run that ended since its sight was lost
SURE = 0.5e-3  # m: a tip that is as good to this is no worse


def _nothing(seen: Seen) -> Seen:
    return {}


def _without(disc: int, seen: Seen) -> Seen:
    return {n: pose for n, pose in seen.items() if n != disc}


def _bumped(seen: Seen) -> Seen:
    poses = moved(np.array([one.pose for one in seen.values()]), SHIFTED, TURNED, np.zeros(3))
    return {n: replace(one, pose=pose)
            for (n, one), pose in zip(seen.items(), poses, strict=True)}


FAULTS: dict[str, Callable[[Seen], Seen]] = {
    'no images, or dark or frozen ones': _nothing,
    'the tip disc hidden': partial(_without, 3),
    'disc 2 hidden': partial(_without, 2),
    'camera bumped by 2° and 12 mm': _bumped,
}


class _Blinded(Lab):
    """A lab whose pictures from a number on are spoilt."""

    def __init__(self, description: Description, given: ModelErrors, first: int,
                 spoil: Callable[[Seen], Seen]) -> None:
        super().__init__(description, given, CAMERA)
        self._first_spoilt, self._spoil, self.looks = first, spoil, 0

    def look(self) -> Seen:
        """Measure the discs."""
        self.looks += 1
        seen = super().look()
        return seen if self.looks <= self._first_spoilt else self._spoil(seen)


def run(quick: bool) -> Section:
    """Measure; the section is of the page about the closed loop."""
    cv2.setNumThreads(1)
    description = Description.read()
    given = read_model_errors(description_file().with_name('twin.yaml'), 'typical')
    results: dict[str, list[tuple[Result, Result]]] = {}
    seeds = range(FIRST_SEED, FIRST_SEED + (1 if quick else SEEDS))
    for seed in seeds:
        goal, rig = random_goal(description, seed), replace(given, seed=seed)
        without = judged(description, rig, goal, open_loop)
        sighted = _Blinded(description, rig, 10**9, _nothing)
        whole = judged_in(sighted, goal, closed_loop)
        results.setdefault('none', []).append((whole, without))
        for name, spoil in FAULTS.items():
            for moment in MOMENTS:
                lab = _Blinded(description, rig, round(moment * sighted.looks), spoil)
                found = judged_in(lab, goal, closed_loop)
                results.setdefault(name, []).append((found, without))
                progress(f'blind: seed {seed}, {name}, {moment:g}: '
                         f'{1e3 * found.tip_error:.2f} mm, open loop '
                         f'{1e3 * without.tip_error:.2f} mm {found.outcome.failed[:60]}')
    rows = [_row(name, each) for name, each in results.items()]
    head = ('fault', 'ended with an error', 'others worse than in open loop')
    moments = ', '.join(f'{moment:.0%}' for moment in MOMENTS)
    return Section('benchmarks/closed_loop.md', 'blind', '\n\n'.join([
        f'Simulated: {len(seeds)} rigs `typical`, random shapes other than those of `loop`, aim '
        f'on the tip, faults after {moments} of the images. {machine()}', table(head, rows)]))


def _row(name: str, results: list[tuple[Result, Result]]) -> tuple[str, ...]:
    done = [pair for pair in results if LOST not in pair[0].outcome.failed]
    worse = sum(a.tip_error > b.tip_error + SURE for a, b in done)
    return name, f'{len(results) - len(done)} of {len(results)}', str(worse)
