# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Times of several contenders, measured in turn so that the machine's load falls on all alike.

A thread's own processor time is measured: other processes do not count.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import gc
import sys
import time

import numpy as np

from soft_continuum.mechanics.arm import Array

SAMPLE = 2e-3  # s that one sample lasts at least: short calls are repeated
LEAST_ROUNDS = 5

Sampler = Callable[[], float]
"""Does something once or more often and returns the time that once took, s."""


@dataclass(frozen=True, eq=False)
class Timing:
    """Times of one contender, s, one per round."""

    samples: Array

    @property
    def median(self) -> float:
        """Half of the rounds were faster, s."""
        return float(np.median(self.samples))


def sampler(call: Callable[[], object], sample: float = SAMPLE) -> Sampler:
    """Return a sampler of ``call`` that repeats it for about ``sample`` s, after two calls."""
    call()
    begin = time.thread_time()
    call()
    repeats = max(1, int(sample / max(time.thread_time() - begin, 1e-9)))

    def run() -> float:
        begin = time.thread_time()
        for _ in range(repeats):
            call()
        return (time.thread_time() - begin) / repeats

    return run


def interleave(samplers: Mapping[str, Sampler], rounds: int, budget: float) -> dict[str, Timing]:
    """
    Sample all in turn, ``rounds`` times; slow ones only until they have used ``budget`` s.

    Garbage is collected between the rounds and not in a sample.
    """
    samples: dict[str, list[float]] = {name: [] for name in samplers}
    spent = dict.fromkeys(samplers, 0.0)
    enabled = gc.isenabled()
    gc.disable()
    try:
        for _ in range(rounds):
            gc.collect(0)
            for name, run in samplers.items():
                if spent[name] > budget and len(samples[name]) >= LEAST_ROUNDS:
                    continue
                begin = time.thread_time()
                samples[name].append(run())
                spent[name] += time.thread_time() - begin
    finally:
        if enabled:
            gc.enable()
    return {name: Timing(np.array(times)) for name, times in samples.items()}


def progress(message: str) -> None:
    """Say on stderr what is going on."""
    print(f'bench: {message}', file=sys.stderr, flush=True)
