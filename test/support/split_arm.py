# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm whose hardware nodes run on one computer and the others on another: see two_computers."""

from collections.abc import Callable, Mapping
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any, Self

import yaml

from soft_continuum.ros.environment import PROFILES
from soft_continuum.user_files import description_file
from support.processes import NodeProcess, Processes
from support.ros_rig import Rig
from support.two_computers import Computer, Computers, PERFECT, Quality, RIG, WORKSTATION

END_TIMEOUT = 15.0  # s
OPEN = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET', **dict.fromkeys(PROFILES, '')}
PARAMETERS = {
    'simulated_jamming.evacuation_time': 0.1, 'simulated_jamming.venting_time': 0.1,
    'simulated_jamming.valve_delay': 0.0}
"""Segments are switched quickly; tendons are as fast as by default."""
CLIENT = """
import json, sys
from soft_continuum.client import Arm, ClientError
with Arm(timeout=30.0) as arm:
    print('ready', flush=True)
    for line in sys.stdin:
        try:
            arm.wait_for(lambda s: s.pulls and s.bending_angles and None not in s.pressures)
            arm.run(*json.loads(line))
        except ClientError as error:
            print(error, flush=True)
        else:
            print('reached', flush=True)
"""


class Operator:
    """A program on the workstation that sends goals, one after the other."""

    def __init__(self, split: 'SplitArm') -> None:
        """Start it; ``answer`` is 'ready' when it has found the arm."""
        self._split = split
        self._process = subprocess.Popen(
            split.computers.workstation.command(sys.executable, '-c', CLIENT),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, **OPEN, 'ROS_DOMAIN_ID': str(split.domain)})
        self._lines = self._process.stdout
        os.set_blocking(self._lines.fileno(), False)

    def send(self, *shapes: Any) -> None:
        """Send a goal."""
        self._process.stdin.write(json.dumps(shapes) + '\n')
        self._process.stdin.flush()

    def answer(self, within: float = 60.0) -> str:
        """Return what became of the goal that was sent last: 'reached', or why it was not."""
        return str(self._split.rig.wait_for(
            lambda: self._lines.readline().strip() or time.sleep(0.02), 'an answer', within))

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.communicate()


class SplitArm:
    """
    The nodes on both computers, and an observer on that of the rig, which the cable does not cut.

    rig: the observer.  ups: the processes that run the nodes, by computer.
    """

    def __init__(self, domain: int, folder: Path, quality: Quality = PERFECT,
                 parameters: Mapping[str, Any] = PARAMETERS) -> None:
        self.domain, self._processes = domain, Processes(domain, folder)
        self._file = folder / 'split.yaml'
        self._file.write_text(
            yaml.safe_dump({'/**': {'ros__parameters': dict(parameters)}}), encoding='utf-8')
        self.ups: dict[str, NodeProcess] = {}
        self.computers = Computers()
        self._closing: list[Callable[[], None]] = [self.computers.close, self._processes.close]
        try:
            self.computers.set(quality)
            with self.computers.rig.inside():
                self.rig = Rig(domain, '/')
            self._closing.append(self.rig.close)
            for name in (RIG, WORKSTATION):
                self.up(name)
            self.rig.wait_until_ready('tendon_actuation', 'jamming_valves')
            self.operate()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def operate(self) -> None:
        """Start the program that sends goals; return when it has found the arm."""
        self.operator = Operator(self)
        self._closing.append(self.operator.close)
        assert self.operator.answer() == 'ready'

    def up(self, name: str, *arguments: str) -> NodeProcess:
        """Start the nodes of a computer."""
        self.ups[name] = self.start(
            self._computer(name), 'up', '--computer', name, '--params-file',
            str(description_file()), '--params-file', str(self._file), *arguments)
        return self.ups[name]

    def start(self, computer: Computer, *command: str) -> NodeProcess:
        """Start a verb on a computer."""
        return self._processes.start(
            computer.command(sys.executable, '-m', 'soft_continuum', *command), environment=OPEN)

    def _computer(self, name: str) -> Computer:
        return self.computers.rig if name == RIG else self.computers.workstation

    def kill(self, name: str) -> int:
        """Kill all nodes of a computer at once, as its power supply would; return when, ns."""
        up = self.ups.pop(name)
        for pid in (up.process.pid, *up.children):
            os.kill(pid, signal.SIGKILL)
        now = time.time_ns()
        up.wait()
        return now

    # The rig.

    @property
    def moving(self) -> bool:
        """Whether a tendon moves."""
        return bool(self.rig.tendons.last and any(self.rig.tendons.last.velocity))

    @property
    def valves(self) -> tuple[int, ...]:
        """What the valves are: stiff, soft or unknown, as their node reports it."""
        return tuple(self.rig.states['jamming_valves'].last.stiffness)

    def moved_after(self, begin: int) -> float:
        """Return how long after ``begin`` (ns) a tendon has still moved, s; 0 for not at all."""
        heard, last = list(self.rig.tendons.heard), begin
        for before, now in zip(heard, heard[1:], strict=False):
            if now.message.position != before.message.position:
                last = max(last, now.time)
        return (last - begin) * 1e-9

    def clear(self) -> None:
        """Keep only the last messages."""
        for recording in (self.rig.tendons, *self.rig.pressures):
            del recording.heard[:-5]

    def close(self) -> None:
        """End everything."""
        for up in self.ups.values():
            up.send(signal.SIGINT)
        for up in self.ups.values():
            up.wait(END_TIMEOUT)
        self.ups.clear()
        while self._closing:
            self._closing.pop()()
