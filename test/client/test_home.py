# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The way home without a plan: not among obstacles, and nothing is left soft by an error."""

from types import SimpleNamespace

import pytest

from soft_continuum.client.arm import Arm
from soft_continuum.client.errors import RefusedError


class Fake:
    """An arm whose sequencer refuses to straighten it; does: what was asked of it by hand."""

    def __init__(self, obstacles=(), error=None, stopped=''):
        self.obstacles = SimpleNamespace(known=[SimpleNamespace(name=name) for name in obstacles])
        self.description = SimpleNamespace(segments=(1, 2, 3))
        self.error, self.stopped, self.does = error, stopped, []
        self.state = SimpleNamespace(
            stopped='', progress=None, stiff=(True, True, True), bending_angles=(0.5, 0.0, 0.0),
            tendons=('right', 'left'), pulls=(0.01, 0.0), node=lambda name: SimpleNamespace(
                level='ok'), nodes=[SimpleNamespace(name='shape_sequencer', running=True)])

    def run(self, *shapes):
        raise RefusedError('shape_sequencer: no plan')

    def wait_for(self, condition, timeout):
        return condition(self.state)

    def soften(self, segment):
        self.does.append(f'soften {segment}')

    def stiffen(self):
        self.does.append('stiffen')

    def jog(self, **moves):
        self.does.append('jog')
        self.state.stopped = self.stopped
        if self.error is not None:
            raise self.error
        self.state.pulls = tuple(pull + moves[name] for name, pull in zip(
            self.state.tendons, self.state.pulls, strict=True))


def test_without_a_plan_it_goes_home_and_ends_stiff():
    arm = Fake()
    assert 'straightened without a plan, because shape_sequencer: no plan' in Arm.home(arm)
    assert arm.does == ['soften 3', 'jog', 'soften 2', 'soften 1', 'stiffen']


def test_it_moves_nothing_without_a_plan_where_there_are_obstacles():
    arm = Fake(obstacles=['lamp', 'post'])
    with pytest.raises(RefusedError, match=r'no plan; without a plan .* \(lamp, post\)'):
        Arm.home(arm)
    assert arm.does == []


@pytest.mark.parametrize(('error', 'stopped', 'end'), [
    (KeyboardInterrupt(), '', 'stiffen'), (RefusedError('too much tension'), '', 'stiffen'),
    (RefusedError('stopped'), 'by hand', 'jog')])
def test_what_interrupts_it_leaves_no_segment_soft_but_a_stop_does(error, stopped, end):
    arm = Fake(error=error, stopped=stopped)
    with pytest.raises(type(error)):
        Arm.home(arm)
    assert arm.does[-1] == end
