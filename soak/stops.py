# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Stop requests at random moments of a motion: how long motors still run, and where they stop."""

from random import Random
import time

from trajectory_msgs.msg import JointTrajectory

from soak.report import progress, Report, spread
from soak.workbench import ClaimError, FAILED, Workbench, workbench
from support.ros_rig import trajectory

TRIALS = 1000
MAX_TRIES = 5
MAX_STOP_TIME = 0.3  # s
REACH, SLACK = 0.008, 0.0005  # m
SPEEDS = 0.008, 0.028  # m/s
PARAMETERS = {'modbus.baud_rate': 115200}


def run(share: float, board: str = 'grbl') -> Report:
    """Stop ``share`` of 1000 motions; board: one of BOARDS."""
    random, off = Random(1), 0.0
    times: list[float] = []
    failures: list[str] = []
    trials = max(1, round(share * TRIALS))
    with workbench(PARAMETERS, board=board) as bench:
        bench.start_all()
        bench.rig.soften(3)
        side = 1.0
        for _ in range(MAX_TRIES * trials):
            if len(times) == trials:
                break
            side = -side
            try:
                ceased = _stop(bench, random, side)
                if ceased is not None:
                    times.append(ceased)
                    off = max(off, bench.differences(commanded=False)[0])
                    bench.check_nodes()
                if not bench.rig.trigger('tendon_actuation/resume').success:
                    progress('restored: a busy computer makes devices seem to fail')
                    bench.restore()
                    bench.rig.soften(3)
            except FAILED as error:
                failures.append(str(error))
                break
            bench.clear()
    median, percentile, largest = spread(times)
    if len(times) < trials:
        failures.append(f'only {len(times)} of {trials} motions took place')
    late = sum(t >= MAX_STOP_TIME for t in times)
    if late:
        failures.append(f'{late} of {len(times)} stops took {MAX_STOP_TIME * 1e3:.0f} ms or more')
    if off > bench.board.resolution:
        failures.append(f'a reported pull was {1e3 * off:.3f} mm off')
    return Report(
        f'{len(times)} stops in motion: median {median} ms, 99 % {percentile} ms, longest '
        f'{largest} ms. {late} took {MAX_STOP_TIME * 1e3:.0f} ms or more. Reported and emulated '
        f'pulls differed by at most {1e3 * off:.4f} mm (allowed: '
        f'{1e3 * bench.board.resolution:.4f} mm).', tuple(failures))


def _stop(bench: Workbench, random: Random, side: float) -> float | None:
    """Return the s from a request until the motors rest; None when there was no motion."""
    rig, board = bench.rig, bench.board
    pull = side * random.uniform(0.5, 1.0) * REACH
    target = pull - SLACK, -pull - SLACK
    distance = max(abs(a - b) for a, b in zip(target, rig.pulls, strict=True))
    message = trajectory([(distance / random.uniform(*SPEEDS), target)])
    rig.publisher(JointTrajectory, 'tendon_actuation/joint_trajectory').publish(message)
    deadline = time.monotonic() + 1.0
    while not board.driven:
        if time.monotonic() > deadline:  # refused: a busy computer delays messages
            progress(f'no motion: {rig.statuses["tendon_actuation"].last.message}')
            return None
        time.sleep(0.005)
    time.sleep(random.uniform(0.0, 0.4))
    if not board.driven:
        return None
    rest = board.watch_rest()
    answer = rig.trigger('tendon_actuation/stop')
    if not answer.success:
        raise ClaimError(answer.message)
    bench.wait_for_rest()
    return rest.result()
