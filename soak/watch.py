# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Continuous checks against the state of the emulators, which the nodes cannot see."""

from contextlib import suppress
from dataclasses import dataclass, field
from math import log
import os
from pathlib import Path
import threading
import time

import numpy as np

from soak.workbench import Workbench
from soft_continuum.hardware.jamming_controller import JammingSettings
from soft_continuum.hardware.simulated_jamming import JammingPlant
from soft_continuum.nodes.shape_sequencer import RESULT_TIMEOUT
from support.ros_rig import SEGMENTS

PERIOD = 0.005  # s
STALE = 0.5  # s after which the other nodes take a flag as stale (stale_timeout)
SOFT_VACUUM = 10e3  # Pa
TENDON_SPEED = 0.015  # m/s, the default of a planned motion
THRESHOLDS = JammingSettings()
PLANT = JammingPlant()
VENTING = PLANT.valve_delay + PLANT.venting_time * log(PLANT.ultimate_vacuum / SOFT_VACUUM)
EVACUATION = PLANT.valve_delay + PLANT.evacuation_time * log(
    PLANT.ultimate_vacuum / (PLANT.ultimate_vacuum - THRESHOLDS.stiff_vacuum))


@dataclass
class Longest:
    """The longest uninterrupted time (s) for which a condition held."""

    seconds: float = 0.0
    _since: float | None = None

    def note(self, holds: bool, now: float) -> None:
        """Note whether the condition holds now."""
        if not holds:
            self._since = None
        elif self._since is None:
            self._since = now
        else:
            self.seconds = max(self.seconds, now - self._since)


@dataclass
class Watch:
    """
    What was measured inside a ``with`` block.

    falsely_stiff: a segment counted as stiff below the release threshold.  moved_stiff: motors ran
    though all segments were stiff.  operation: s of it at the default speed.
    """

    bench: Workbench
    falsely_stiff: list[Longest] = field(
        default_factory=lambda: [Longest() for _ in range(SEGMENTS)])
    moved_stiff: Longest = field(default_factory=Longest)
    operation: float = 0.0
    memory: list[tuple[float, float]] = field(default_factory=list)  # s, MB
    failure: str = ''

    def __enter__(self) -> 'Watch':
        """Begin."""
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self._end.set()
        self._thread.join()

    def memory_slope(self) -> float:
        """
        Return by how much the nodes grew in the last third of the time, MB/h; nan if it was short.

        shape_sequencer keeps the results of goals for RESULT_TIMEOUT, so it grows for that long.
        """
        late = self.memory[2 * len(self.memory) // 3:]
        if not late or late[0][0] - self.memory[0][0] < RESULT_TIMEOUT:
            return float('nan')
        times, sizes = np.array(late).T
        return float(np.polyfit(times / 3600.0, sizes, 1)[0])

    def _run(self) -> None:
        try:
            self._watch()
        except Exception as error:  # a thread that has ended checks nothing
            self.failure = f'{type(error).__name__}: {error}'

    def _watch(self) -> None:
        bench, rig = self.bench, self.bench.rig
        pulls = bench.board.pulls
        stiff = [False] * SEGMENTS
        weighed = 0.0
        while not self._end.wait(PERIOD):
            now = time.monotonic()
            vacuum = [bench.modbus.vacuum(i) for i in range(SEGMENTS)]
            for i in range(SEGMENTS):
                flag, pressures = rig.stiff[i].last, rig.pressures[i].heard
                counts_as_stiff = bool(flag and flag.data and pressures
                                and time.time_ns() - pressures[-1].time < STALE * 1e9)
                self.falsely_stiff[i].note(
                    counts_as_stiff and vacuum[i] < THRESHOLDS.release_vacuum, now)
                if stiff[i] and vacuum[i] <= SOFT_VACUUM:
                    stiff[i] = False
                    self.operation += VENTING
                elif not stiff[i] and vacuum[i] >= THRESHOLDS.stiff_vacuum:
                    stiff[i] = True
                    self.operation += EVACUATION
            self.moved_stiff.note(
                bench.board.driven and min(vacuum) >= THRESHOLDS.stiff_vacuum, now)
            before, pulls = pulls, bench.board.pulls
            self.operation += max(
                abs(a - b) for a, b in zip(pulls, before, strict=True)) / TENDON_SPEED
            if now - weighed > 1.0:
                weighed = now
                self._weigh(now)

    def _weigh(self, now: float) -> None:
        pids = {node.process.pid for node in self.bench.nodes.values()}
        pages = 0
        for pid in pids:
            with suppress(OSError):  # it has ended; that is noticed elsewhere
                statm = Path(f'/proc/{pid}/statm').read_text(encoding='ascii')
                pages += int(statm.split()[1])
        self.memory.append((now, pages * os.sysconf('SC_PAGE_SIZE') / 1e6))
