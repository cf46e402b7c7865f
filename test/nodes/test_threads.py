# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The threads of a node: what they do for others, and that nothing ends them."""

import os
import threading

import pytest

from soft_continuum.hardware.real_time import NICENESS, priority_allowed
from soft_continuum.nodes import threads
from soft_continuum.nodes.runtime import shut_down, Signals
from soft_continuum.nodes.threads import ControlLoop, Worker
from support.ros_rig import QUICK

DEADLINE = 20.0  # s


class Cycles:
    """Notes how late cycles are, and what failed."""

    def __init__(self):
        self.late = []
        self.failures = []
        self.raises = None
        self._changed = threading.Condition()

    def cycle(self, late):
        with self._changed:
            self.late.append(late)
            self._changed.notify_all()
        if self.raises is not None:
            raise self.raises

    def failed(self, error):
        self.failures.append(error)
        raise RuntimeError('and so does what should report it')

    def wait_for_more(self, count=3):
        with self._changed:
            before = len(self.late)
            assert self._changed.wait_for(lambda: len(self.late) >= before + count, DEADLINE)


@pytest.fixture
def cycles():
    return Cycles()


@pytest.fixture
def loop(cycles):
    loop = ControlLoop('test', 0.005, cycles.cycle, cycles.failed)
    yield loop
    loop.close()


def test_what_is_asked_for_is_done_on_the_thread_of_the_loop(loop, cycles):
    cycles.wait_for_more()
    assert loop.call(threading.current_thread) is not threading.current_thread()
    assert loop.call(threading.current_thread) is loop.call(threading.current_thread)


def test_what_it_raises_comes_to_who_asked(loop, cycles):
    with pytest.raises(ValueError, match='invalid literal'):
        loop.call(int, 'x')
    assert not cycles.failures


def test_a_call_that_is_not_done_in_time_says_what_was_waited_for(loop, monkeypatch):
    monkeypatch.setattr(threads, 'CALL_TIMEOUT', 0.05)
    worker, go = Worker('devices', lambda _: None, limit=1), threading.Event()
    loop.post(go.wait, DEADLINE)
    worker.submit(go.wait, DEADLINE)
    with pytest.raises(TimeoutError, match='the thread test has not finished len within 0.05 s'):
        loop.call(len, '')
    for _ in range(2):  # also when another one waits already
        with pytest.raises(TimeoutError, match='thread devices has not finished len within'):
            worker.call(0.05, len, '')
    go.set()
    worker.close(DEADLINE)


def test_a_cycle_that_was_missed_is_reported_late_and_left_out(loop, cycles):
    cycles.wait_for_more()
    missed = loop.call(lambda: (len(cycles.late), threading.Event().wait(0.1)))[0]  # 20 periods
    cycles.wait_for_more(10)
    late, *after = cycles.late[missed:]
    assert late > 0.08
    # One that were made up for would come a whole period, 5 ms, early.
    assert sum(after[:6]) > -0.015


def test_nothing_that_fails_ends_the_loop(loop, cycles):
    cycles.raises = OSError('cycle')
    cycles.wait_for_more()
    loop.post(int, 'x')
    cycles.wait_for_more()
    assert {type(error) for error in cycles.failures} == {OSError, ValueError}


def test_a_worker_does_one_thing_after_another_and_refuses_too_many():
    failures = []
    worker, go, done = Worker('test', failures.append, limit=2), threading.Event(), []
    begun = threading.Event()
    assert worker.submit(lambda: (begun.set(), go.wait(DEADLINE)))
    assert begun.wait(DEADLINE)
    assert worker.submit(done.append, 1)
    assert worker.submit(int, 'x')
    assert not worker.submit(done.append, 2)
    go.set()
    assert worker.call(DEADLINE, len, done) == 1
    worker.close(DEADLINE)
    assert [type(error) for error in failures] == [ValueError]


def test_a_callback_that_fails_ends_neither_the_spinning_nor_the_holding_of_others(monkeypatch):
    monkeypatch.setattr('signal.signal', lambda *_: None)
    monkeypatch.setattr('rclpy.ok', lambda: True)
    monkeypatch.setattr('rclpy.try_shutdown', lambda: None)
    spun, held = [], []

    class Executor:
        def spin_once(self, timeout_sec):
            spun.append(timeout_sec)
            raise ValueError('callback')

        def shutdown(self): ...

    class Node:
        def quit(self):
            held.append(self)
            raise OSError('no device')

        def destroy_node(self): ...

    executor = Executor()
    Signals().spin(executor, ended=lambda: len(spun) == 2)
    shut_down(executor, [Node(), Node()])
    assert (len(spun), len(held)) == (2, 2)


def test_all_threads_of_a_node_that_controls_a_device_go_on_before_other_programs(rig, processes):
    node = processes.node('tendon_actuation', parameters=QUICK)
    rig.wait_until_ready('tendon_actuation')
    found = {(os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK,
              os.getpriority(os.PRIO_PROCESS, thread))
             for thread in map(int, os.listdir(f'/proc/{node.process.pid}/task'))}
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    assert found == ({(os.SCHED_FIFO, NICENESS), (os.SCHED_OTHER, NICENESS)}
                     if all(priority_allowed()) else {(os.SCHED_OTHER, usual)})
