# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""What a tendon does when its motion is replaced, canceled or stopped, in simulated time."""

from collections.abc import Callable, Sequence
from math import nan
from pathlib import Path

from matplotlib.figure import Figure
import numpy as np

from benchmarks.tables import DOCUMENTS, Section, table
from soft_continuum.hardware.simulated_tendons import SimulatedTendons
from soft_continuum.hardware.tendon_controller import (
    MotionRefusedError,
    TendonController,
    TendonLimits,
)
from soft_continuum.mechanics.arm import Array

IMAGE = DOCUMENTS / 'images' / 'behaviour.svg'
LIMITS = TendonLimits(('right_tendon', 'left_tendon'), (-0.06, 0.06), 0.03)
ACCELERATION, STEP = 0.3, 5e-6  # m/s^2, m
PERIOD = 20  # ms of the control cycle
EVENT, LATER, END = 510, 910, 1800  # ms: amid a period, a trajectory after it, of the record
FIRST, SECOND, DURATION = 0.02, 0.005, 800  # m of pull, where trajectories of so many ms end
Event = Callable[[TendonController], None]
EVENTS: dict[str, Event | None] = {
    'Replaced by a second trajectory': None,
    'Canceled; a second trajectory 0.4 s later': TendonController.hold,
    'Emergency stop; a second trajectory 0.4 s later is refused':
        lambda controller: controller.stop('emergency_stop is on')}


class WatchedTendons(SimulatedTendons):
    """Simulated steppers that tell the set-point of the first tendon, nan while they brake."""

    set_point = 0.0

    def move(self, pulls: tuple[float, ...], duration: float) -> None:
        """Keep where it is sent."""
        self.set_point = pulls[0]
        super().move(pulls, duration)

    def stop(self) -> None:
        """Keep that it is sent nowhere."""
        self.set_point = nan
        super().stop()


def run(quick: bool) -> Section:
    """Follow the trajectories; the section is of the page of tendon_actuation."""
    records = [_record(event) for event in EVENTS.values()]
    if not quick:
        _draw([record for record, _ in records], IMAGE)
    rows = []
    for (name, event), ((_, pulls, speeds), answer) in zip(EVENTS.items(), records, strict=True):
        moving = np.flatnonzero(speeds[:END if event is None else LATER])
        rows.append((name.partition(';')[0], f'{1e3 * (pulls[EVENT:].max() - pulls[EVENT]):.1f}',
                     f'{1e-3 * (moving[-1] + 1 - EVENT):.2f}', answer))
    return Section('../msg_docs/tendon_actuation.md', 'behaviour', table(
        ('event', 'runs on by, mm', 'rests after, s', 'second trajectory'), rows))


def _record(event: Event | None) -> tuple[Array, str]:
    """Return set-point, pull (m) and speed (m/s) at each ms, and what the second one becomes."""
    ms, rows, answer = 0, [], 'accepted'
    driver = WatchedTendons(lambda: 1e-3 * ms, LIMITS.tendons, LIMITS.speed_limit, ACCELERATION,
                            STEP)
    controller = TendonController(driver, LIMITS)
    goals = {0: FIRST, EVENT if event is None else LATER: SECOND}
    for ms in range(END):
        reading = driver.read()
        rows.append((driver.set_point, reading.pulls[0], reading.speeds[0]))
        if ms == EVENT and event is not None:
            event(controller)
        if ms in goals:
            try:
                controller.accept(np.array([1e-3 * (ms + DURATION)]),
                                  np.array([[goals[ms], -goals[ms]]]), 1e-3 * ms)
            except MotionRefusedError as error:
                answer = f'refused: `{error.reason.name}`'
        if ms % PERIOD == 0:
            controller.update(1e-3 * ms, 1e-3 * PERIOD)
    return np.array(rows).T, answer


def _draw(records: Sequence[Array], path: Path) -> None:
    figure = Figure(figsize=(6.5, 5.6), layout='constrained')
    panels = figure.subplots(len(records), 1, sharex=True, sharey=True)
    times = 1e-3 * np.arange(END)
    for axes, title, (sent, pulls, _) in zip(panels, EVENTS, records, strict=True):
        axes.plot(times[::PERIOD], 1e3 * sent[::PERIOD], color='black', linewidth=1.0, zorder=3,
                  label='commanded')
        axes.plot(times, 1e3 * pulls, color='0.65', linewidth=3.0, label='measured')
        axes.plot([0.0, 1e-3 * DURATION], [0.0, 1e3 * FIRST], ':', color='0.3', zorder=1,
                  label='first trajectory')
        axes.axvline(1e-3 * EVENT, color='0.3', linewidth=0.8)
        if EVENTS[title] is not None:
            axes.axvline(1e-3 * LATER, color='0.3', linewidth=0.8, linestyle='--')
        axes.set_title(title, fontsize=10, loc='left')
        axes.set_ylabel('pull in mm')
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=8, loc='upper right')
    panels[-1].set_xlabel('time in s')
    figure.savefig(path)
