# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""How well a servo follows: a sine, its frequency response, and a grid of wrong models."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from math import degrees, pi, radians, sin, sqrt
from pathlib import Path
import time

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from benchmarks.servo_loop import follow, Measuring, Record, StaticPlant, TwinPlant
from benchmarks.tables import DOCUMENTS, machine, number, Section, table
from benchmarks.timing import progress
from soft_continuum.mechanics import Arm, Jam, Statics
from soft_continuum.mechanics.arm import Array
from soft_continuum.ros.description import load_arm
from soft_continuum.sequencing.servo import AngleServo, ServoSettings
from soft_continuum.sim.twin.model_errors import ModelErrors, read_model_errors
from soft_continuum.user_files import description_file

IMAGE = DOCUMENTS / 'images' / 'servo.svg'
SETTINGS = ServoSettings()
AMPLITUDE, FREQUENCY = radians(15.0), 0.1  # rad, Hz: of the goal
SINE_TIME, SINE_BEGIN = 32.0, 2.0  # s followed, and from which on it counts
NOISE = radians(0.1)  # of the measured angles
SOURCES = (('predicted', None), ('camera, 100 ms late', Measuring(0.1, stddev=NOISE)),
           ('camera, 150 ms late', Measuring(0.15, stddev=NOISE)))
SMALL = radians(2.0)  # rad, amplitude of the frequency response
FREQUENCIES = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.4)  # Hz
STIFFNESS, DELAYS = (0.5, 0.71, 1.0, 1.41, 2.0), (0.0, 0.05, 0.1, 0.15)
STEP, STEP_TIME = radians(20.0), 5.0  # to either side, s each
LAST = 1.0  # s at the end of a step in which it has to rest
AXIAL_STIFFNESS, RATIO, DEAD_BAND, LAG = 5e3, 50.0, 1e-4, 0.1  # N, K, m, s: of the grid


def run(quick: bool) -> Section:
    """Measure; the section is of the page about the closed loop."""
    arm = load_arm(description_file())
    presets = {name: read_model_errors(description_file().with_name('twin.yaml'), name)
               for name in ('typical', 'severe')}
    responses = _responses(arm, presets['typical'], quick)
    rows, steps, rested, runs = _grid(arm, quick)
    if not quick:
        _draw(responses, steps, IMAGE)
    body = '\n\n'.join([
        f'Simulated with motors of {SETTINGS.speed * 1e3:g} mm/s, default parameters, a '
        f'target every 50 ms and 15 images per second with {degrees(NOISE):.1f}° of noise. '
        + machine(),
        f'**A sine** of ±{degrees(AMPLITUDE):.0f}° at {FREQUENCY:g} Hz, RMS / largest error of '
        'the worst segment, degrees:',
        table(('preset', *(name for name, _ in SOURCES)), _sines(arm, presets, quick)),
        '**Bandwidth** with the camera 100 ms late, '
        f'±{degrees(SMALL):.0f}°, `typical`: gain and phase from target to true angle',
        table(('Hz', *(f'segment {s + 1}' for s in range(len(responses)))),
              [(f'{f:g}', *(f'{abs(z):.2f}, {round(np.angle(z, deg=True))}°' for z in each))
               for f, *each in zip(FREQUENCIES, *responses, strict=False)]),
        f'**Wrong models**: steps of {2 * degrees(STEP):.0f}° of each segment of a plant with '
        f'{STIFFNESS[0]:g} to {STIFFNESS[-1]:g} times the stiffness, K = {RATIO:g}, '
        f'tendons of {AXIAL_STIFFNESS / 1e3:g} kN, a friction '
        f'band of {DEAD_BAND * 1e3:g} mm and a lag of {LAG * 1e3:g} ms. {rested} of {runs} runs '
        'came to rest. *Unstamped*: the time stamps omit the delay.',
        table(('delay', 'largest overshoot, degrees', 'unstamped',
               f'largest error in the last {LAST:g} s, degrees', 'unstamped'), rows),
        f'**Margins** of the loop at a delay of {1e3 * DELAYS[-1]:.0f} ms, computed from its '
        'formula:',
        table(('k', 'gain margin', 'unstamped', 'phase margin, degrees', 'unstamped'),
              _margins()),
        f'**Processor time**: one cycle takes {number(_cost(arm) * 1e3)} ms (median), enabling '
        f'the servo {number(_enabling(arm) * 1e3)} ms.'])
    return Section('benchmarks/closed_loop.md', 'servo', body)


def _sines(arm: Arm, presets: dict[str, ModelErrors], quick: bool) -> list[tuple[str, ...]]:
    rows = []
    for name, given in presets.items():
        cells = []
        for source, measuring in SOURCES:
            errors = []
            for segment in range(1 if quick else len(arm.segments)):
                found = follow(arm, TwinPlant(arm, given, segment), segment,
                               lambda t: AMPLITUDE * sin(2.0 * pi * FREQUENCY * t),
                               6.0 if quick else SINE_TIME, measuring, SETTINGS)
                error = np.degrees(found.error(SINE_BEGIN))
                errors.append((sqrt(np.mean(error**2)), np.abs(error).max()))
                progress(f'servo: sine, {name}, {source}, segment {segment + 1}: {errors[-1]}')
            cells.append(' / '.join(f'{each:.2f}' for each in np.max(errors, axis=0)))
        rows.append((f'`{name}`', *cells))
    return rows


def _responses(arm: Arm, given: ModelErrors, quick: bool) -> list[list[complex]]:
    """Return the frequency response of each segment."""
    responses = []
    for segment in range(1 if quick else len(arm.segments)):
        response = []
        for frequency in FREQUENCIES[:2] if quick else FREQUENCIES:
            periods = max(3.0, 10.0 * frequency)

            def target(t: float, frequency: float = frequency) -> float:
                return SMALL * sin(2.0 * pi * frequency * t)

            found = follow(arm, TwinPlant(arm, given, segment), segment, target,
                           2.0 + periods / frequency, SOURCES[1][1], SETTINGS)
            response.append(_gain(found, frequency, periods / frequency))
        responses.append(response)
        progress(f'servo: frequency response of segment {segment + 1} done')
    return responses


def _gain(found: Record, frequency: float, duration: float) -> complex:
    """Return the true angle over the target at one frequency, in the last ``duration`` s."""
    last = found.times > found.times[-1] - duration
    wave = np.exp(-2j * pi * frequency * found.times[last])
    angles = found.angles[last] - found.angles[last].mean()
    return complex((angles * wave).sum() / (found.targets[last] * wave).sum())


def _grid(arm: Arm, quick: bool
          ) -> tuple[list[tuple[str, ...]], dict[float, Record], int, int]:
    """
    Return the table of the wrong models, and steps of segment 1 by stiffness factor.

    Then how many runs came to rest, and how many there were.
    """
    rows: list[tuple[str, ...]] = []
    steps: dict[float, Record] = {}
    rested = runs = 0
    for delay in DELAYS[-1:] if quick else DELAYS:
        cells = []
        for stamp_error in sorted({0.0, delay}):
            results = []
            for factor in STIFFNESS:
                for segment in range(len(arm.segments)):
                    found = _step(arm, factor, segment, Measuring(delay, stamp_error, NOISE / 5))
                    results.append(_judge(found))
                    if (delay, stamp_error, segment) == (0.15, 0.0, 0):
                        steps[factor] = found
            overshoots, errors = np.array(results).T
            cells.append((f'{overshoots.max():.1f}', f'{errors.max():.2f}'))
            rested, runs = rested + int(np.sum(errors < 1.0)), runs + len(results)
        cells += [('-', '-')] * (2 - len(cells))
        rows.append((f'{delay * 1e3:.0f} ms', *chain(*zip(*cells, strict=True))))
        progress(f'servo: grid {rows[-1]}')
    return rows, steps, rested, runs


def _step(arm: Arm, factor: float, segment: int, measuring: Measuring) -> Record:
    worn = replace(
        arm.with_tendons(axial_stiffness=AXIAL_STIFFNESS, free_length=arm.length),
        segments=tuple(replace(s, stiffness_y=factor * s.stiffness_y,
                               jam=Jam(ratio=RATIO)) for s in arm.segments))
    return follow(arm, StaticPlant(worn, segment, DEAD_BAND, LAG), segment,
                  lambda t: STEP if t < STEP_TIME else -STEP, 2.0 * STEP_TIME, measuring,
                  SETTINGS)


def _judge(found: Record) -> tuple[float, float]:
    """Return overshoot and last error, degrees."""
    away = np.degrees(found.angles - found.targets)
    first, last = found.times < STEP_TIME, found.times > 2.0 * STEP_TIME - LAST
    overshoot = max(away[first].max(), -away[~first].min(), 0.0)
    return float(overshoot), float(np.abs(away[last]).max())


def _margins() -> list[tuple[str, ...]]:
    """Return the margins of the loop for gains k, with SETTINGS.response_time as lag."""
    rows: list[tuple[str, ...]] = []
    s = 2j * pi * np.logspace(-3.0, 2.0, 400_001)
    delay = DELAYS[-1]
    for k in (0.5, 1.0, 2.0):
        cells = []
        for told in (delay, 0.0):
            loop = (k * np.exp(-s * delay) / (1.0 + SETTINGS.response_time * s)
                    / (1.0 + SETTINGS.integral_time * s - np.exp(-s * told)))
            turned = (loop.imag[:-1] * loop.imag[1:] < 0.0) & (loop.real[1:] < 0.0)
            crossed = np.flatnonzero((np.abs(loop[:-1]) > 1.0) & (np.abs(loop[1:]) <= 1.0))
            phase = 180.0 - np.abs(np.angle(loop[crossed], deg=True))
            cells.append((f'{1.0 / np.abs(loop[1:][turned]).max():.1f}', f'{phase.min():.0f}'))
        rows.append((f'{k:g}', *chain(*zip(*cells, strict=True))))
    return rows


def _cost(arm: Arm) -> float:
    """Return the processor time of one cycle with a measurement, s."""
    statics = Statics(arm)
    state = statics.chain.straight()
    servo, samples = AngleServo(statics, SETTINGS, state, 1), []
    for now in np.arange(10.0, 20.0, SETTINGS.period):
        begin = time.thread_time()
        servo.observe(state, now - 0.1, now - 0.1, now)
        servo.set_angle(AMPLITUDE * sin(now), now)
        servo.advance(now, (0.0, 0.0))
        samples.append(time.thread_time() - begin)
    return float(np.median(samples))


def _enabling(arm: Arm) -> float:
    statics, samples = Statics(arm), []
    for _ in range(10):
        begin = time.thread_time()
        AngleServo(statics, SETTINGS, statics.chain.straight(), 1)
        samples.append(time.thread_time() - begin)
    return float(np.median(samples))


def _draw(responses: Sequence[Sequence[complex]], steps: dict[float, Record], path: Path) -> None:
    figure = Figure(figsize=(9.0, 3.4), layout='constrained')
    left, middle, right = figure.subplots(1, 3)
    for segment, response in enumerate(responses):
        values = np.array(response)
        left.semilogx(FREQUENCIES, np.abs(values), 'o-', markersize=3,
                      label=f'segment {segment + 1}')
        middle.semilogx(FREQUENCIES, np.degrees(np.unwrap(np.angle(values))), 'o-', markersize=3)
    left.axhline(sqrt(0.5), color='0.5', linestyle=':', label='-3 dB')
    left.set_ylim(0.0, 2.6)
    left.set_title('gain', fontsize=10)
    middle.set_title('phase in degrees', fontsize=10)
    for axes in (left, middle):
        axes.set_xlabel('frequency in Hz')
        axes.set_xticks(FREQUENCIES, [f'{f:g}' for f in FREQUENCIES], fontsize=8)
        axes.minorticks_off()
    left.legend(fontsize=8)
    _draw_steps(right, steps)
    for axes in (left, middle, right):
        axes.grid(alpha=0.3)
    figure.savefig(path)


def _draw_steps(axes: Axes, steps: dict[float, Record]) -> None:
    for factor, found in steps.items():
        if factor in (STIFFNESS[0], 1.0, STIFFNESS[-1]):
            axes.plot(found.times, np.degrees(found.angles), label=f'stiffness x {factor:g}')
    target: Array = np.degrees(found.targets)
    axes.plot(found.times, target, color='0.3', linestyle=':', label='target')
    axes.set_xlabel('time in s')
    axes.set_title('segment 1 in degrees, 150 ms late', fontsize=10)
    axes.legend(fontsize=8)
