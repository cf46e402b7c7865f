# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The four nodes as processes on emulated devices, and an operator who restores the arm."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
import fcntl
from pathlib import Path
import tempfile
import time
from typing import Any

import pytest
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory
import yaml

from soak.boards import Board, BOARDS, Pulls
from soft_continuum.mechanics._kernel import warm_up
from soft_continuum.sim.emulators.modbus import ModbusEmulator
from soft_continuum.user_files import description_file
from support.processes import NodeProcess, Processes
from support.ros_rig import ALL, LATCHED, Recording, RELIABLE, Rig, SEGMENTS

NAMESPACE = '/soak'
KEPT = 200  # messages of every topic
MANAGED = 'tendon_actuation', 'jamming_valves'
AT_REST = 0.2  # s without a motion


class ClaimError(AssertionError):
    """A claim about the arm does not hold."""


FAILED = (AssertionError, pytest.fail.Exception)
"""What a claim that does not hold raises, and a wait that takes too long."""


class Workbench:
    """
    Devices, nodes, and the messages of the nodes.

    zero: pulls of the straight arm, m.  trajectories: those sent to tendon_actuation.
    """

    def __init__(self, board: Board[Any], modbus: ModbusEmulator, rig: Rig,
                 processes: Processes, parameters: Path) -> None:
        """Start no node yet; parameters: a file for all of them."""
        self.board, self.modbus, self.rig = board, modbus, rig
        self.zero = board.pulls
        self.trajectories: Recording = rig.record(
            JointTrajectory, 'tendon_actuation/joint_trajectory', RELIABLE)
        self.nodes: dict[str, NodeProcess] = {}
        self._processes = processes
        self._parameters = parameters
        self._recordings = [
            *rig.statuses.values(), *rig.states.values(), *rig.stiff, *rig.pressures,
            rig.tendons, rig.joints, rig.segment_poses, rig.disc_poses, self.trajectories]

    def start_all(self) -> None:
        """Start all nodes, each as a process of its own, on a straight arm."""
        self.start(*ALL)
        self._get_ready()

    def start(self, *names: str) -> None:
        """Start some nodes as processes and wait for the status of each."""
        received = {name: len(self.rig.statuses[name]) for name in names}
        for name in names:
            self.nodes[name] = self._processes.node(
                name, namespace=NAMESPACE, files=[description_file(), self._parameters])
        self.rig.wait_for(lambda: all(len(self.rig.statuses[n]) > received[n] for n in names),
                          f'a status of {", ".join(names)}')
        self._activate(*names)

    def clear(self) -> None:
        """Keep only the last messages; not while something waits for more of them."""
        for recording in self._recordings:
            del recording.heard[:-KEPT]

    def check_nodes(self) -> None:
        """Raise ClaimError when a node has ended or an exception has escaped from one."""
        for name, node in self.nodes.items():
            if 'Traceback' in node.output:
                raise ClaimError(f'{name} wrote:\n{node.output[-3000:]}')
            if not node.running:
                raise ClaimError(f'{name} has ended:\n{node.output[-3000:]}')

    # Motors

    def wait_for_rest(self) -> Pulls:
        """Wait until the motors have rested for a while; return the true pulls, m."""
        moved = time.monotonic()

        def rested() -> bool:
            nonlocal moved
            if self.board.moving:
                moved = time.monotonic()
            return time.monotonic() - moved > AT_REST

        self.rig.wait_for(rested, 'motors at rest')
        return self.board.pulls

    @property
    def referenced(self) -> bool:
        """Whether tendon_actuation is connected and knows where the tendons are."""
        state = self.rig.states['tendon_actuation'].last
        return bool(state.connected and state.referenced)

    def differences(self, commanded: bool) -> tuple[float, float]:
        """
        Return by how many m, at most, pulls at rest differ from the reported and commanded ones.

        commanded: whether the last trajectory has been followed to its end; else that is 0.
        """
        pulls = [p - z for p, z in zip(self.wait_for_rest(), self.zero, strict=True)]

        def farthest(others: Sequence[float]) -> float:
            return max(abs(a - b) for a, b in zip(pulls, others, strict=True))

        deadline = time.monotonic() + 2.0  # the last report may be on its way
        while (differs := farthest(self.rig.pulls)) > self.board.resolution and (
                time.monotonic() < deadline):
            time.sleep(0.02)
        if not commanded:
            return differs, 0.0
        last = next(m for m in reversed(list(self.trajectories)) if m.points)
        return differs, farthest(last.points[-1].positions)

    def check_rest(self, before: Pulls, why: str) -> None:
        """Raise ClaimError if tendons are not where they were; why: they might be."""
        now = self.board.pulls
        if max(abs(a - b) for a, b in zip(now, before, strict=True)) > self.board.reach:
            raise ClaimError(f'the tendons went from {before} to {now} m {why}')

    # The operator

    def _get_ready(self) -> None:
        """Make the arm stiff and take it to be straight."""
        self._activate(*MANAGED)
        self.rig.wait_until_ready(*MANAGED, 'shape_sequencer')
        self.stiffen()
        self._reference()

    def _activate(self, *names: str) -> None:
        """Configure and activate nodes that a busy computer kept from doing so by themselves."""
        def active(name: str) -> bool:
            for state, transition in (('unconfigured', 'configure'), ('inactive', 'activate')):
                if self.rig.lifecycle_state(name) == state:
                    self.rig.transition(name, transition)
            return bool(self.rig.lifecycle_state(name) == 'active')

        for name in MANAGED:
            if name in names:
                self._until(lambda name=name: active(name), f'{name} active')

    def stiffen(self) -> None:
        """Make every segment stiff."""
        def accepted() -> bool:
            answer = self.rig.call(SetBool, 'jamming_valves/set_all_stiff', data=True)
            return bool(answer.success)
        self._until(accepted, 'valves that switch')
        self.rig.wait_for(lambda: self.rig.all_stiff, 'a stiff arm')

    def restore(self) -> None:
        """
        End all faults and make the arm ready as an operator would, without a motion.

        Where the position or the shape is not known, the arm is
        straightened by hand, the tendons are made taut again, and there is the new zero.
        """
        rig = self.rig
        self.modbus.repair()
        self.modbus.plug()
        self.board.repair()
        rests_at = self.wait_for_rest()
        self.emergency_stop(False)
        self._until(lambda: self._sound('tendon_actuation') and self._sound('jamming_valves'),
                    'both devices back')
        self.stiffen()
        self.check_rest(rests_at, 'without a command')
        self._until(lambda: rig.trigger('tendon_actuation/resume').success, 'a resume')
        rig.wait_for(lambda: not rig.states['tendon_actuation'].last.stopped, 'no stop')
        shapes = len(rig.joints)
        rig.wait_for_more(rig.tendons, 10)  # to each kinematics answers with the shape, if known
        if not self.referenced or len(rig.joints) == shapes:
            self._reference()
        self.check_rest(rests_at, 'by a resume')

    def emergency_stop(self, on: bool) -> None:
        """Press or release the emergency stop."""
        self.rig.publisher(Bool, 'emergency_stop', LATCHED).publish(Bool(data=on))

    def _reference(self) -> None:
        rig = self.rig
        self._until(lambda: rig.trigger('tendon_actuation/reference').success, 'a reference')
        self.zero = self.board.pulls
        self._until(lambda: rig.trigger('kinematics/reset').success, 'a known shape')
        rig.wait_for_more(rig.joints, 1)

    def _sound(self, node: str) -> bool:
        """Whether a device answers and reports no fault."""
        state = self.rig.states[node].last
        return bool(state.connected and not state.fault
                    and not any(getattr(state, 'segment_faults', ())))

    def _until(self, done: Any, what: str) -> None:
        self.rig.wait_for(lambda: done() or time.sleep(0.1), what)


@contextmanager
def workbench(parameters: Mapping[str, Any], faster: float = 1.0, board: str = 'grbl'
              ) -> Iterator[Workbench]:
    """
    Devices on pseudo-terminals and an observer; parameters: those of all nodes.

    faster: by which pump, segments and stepper motors are quicker than those of the paper's arm.
    board: one of BOARDS.
    """
    warm_up()  # or the first nodes would compile for longer than anybody waits
    with tempfile.TemporaryDirectory() as directory, domain() as number:
        folder = Path(directory)
        with (BOARDS[board](folder, faster) as (tendons, given),
              ModbusEmulator(SEGMENTS, link=folder / 'modbus') as modbus):
            values = {**given, 'jamming_driver': 'modbus', 'modbus.port': modbus.port,
                      **parameters}
            path = folder / 'soak.yaml'
            path.write_text(yaml.safe_dump({'/**': {'ros__parameters': values}}),
                            encoding='utf-8')
            begin = time.monotonic()
            for segment in modbus.segments:  # the emulated boards have no clock of their own
                segment._clock = lambda: begin + faster * (time.monotonic() - begin)
            rig = Rig(number, NAMESPACE)
            bench = Workbench(tendons, modbus, rig, Processes(number, folder), path)
            try:
                yield bench
            finally:
                for node in bench.nodes.values():
                    node.kill()
                rig.close()


@contextmanager
def domain() -> Iterator[int]:
    """Return a ROS domain that neither the tests nor another soak test uses."""
    for number in range(101, 0, -1):
        path = Path(tempfile.gettempdir()) / f'soft_continuum_domain_{number}.lock'
        try:
            lock = path.open('w')
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:  # in use, or made by another user
            continue
        with lock:
            yield number
        return
    raise RuntimeError('every ROS domain from 1 to 101 is in use; end other tests first')
