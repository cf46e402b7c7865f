# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Bytes of every kind for the readers of both protocols, by the strategies of the tests."""

from collections.abc import Callable
from dataclasses import dataclass
import gc
import time
from typing import Any

from hypothesis import given, settings
import pytest
import test_fuzz
import test_grbl_link

from benchmarks.tables import table
from soak.report import Report

CASES = 100_000
MAX_TIME = 1.0  # s for one input


@dataclass
class Inputs:
    """How many inputs were read, and the longest time that one took, s."""

    count: int = 0
    longest: float = 0.0

    def feed(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function with an input."""
        gc.disable()  # there is a lot of garbage, all of it from making the inputs
        begin = time.thread_time()
        try:
            return function(*arguments)
        finally:
            self.count += 1
            self.longest = max(self.longest, time.thread_time() - begin)
            gc.enable()


def run(share: float) -> Report:
    """Feed ``share`` of 100 000 inputs to each reader."""
    cases = max(100, round(share * CASES))
    rows, failures = [], []
    for name, feed in (('GRBL', _grbl), ('Modbus', _modbus), ('Dynamixel', _dynamixel)):
        inputs, crash = Inputs(), ''
        try:
            feed(cases, inputs)
        except Exception as error:
            crash = f'{name}: {type(error).__name__}: {error}'
            failures.append(crash)
        if inputs.count < cases and not crash:
            failures.append(f'{name}: only {inputs.count} of {cases} inputs')
        if inputs.longest > MAX_TIME:
            failures.append(f'{name}: one input took {inputs.longest:.1f} s')
        rows.append((name, str(inputs.count), 'yes' if crash else 'none',
                     f'{inputs.longest * 1e3:.1f} ms'))
    head = ('protocol', 'inputs', 'crashes or wrong answers', 'longest time for one')
    return Report(table(head, rows), tuple(failures))


def _grbl(cases: int, inputs: Inputs) -> None:
    test: Any = test_grbl_link.fuzz
    check = test.hypothesis.inner_test

    @settings(max_examples=cases, deadline=None, derandomize=True)
    @given(test_grbl_link.NOISE)
    def fuzz(chunks: list[bytes]) -> None:
        inputs.feed(check, chunks)

    fuzz()


def _modbus(cases: int, inputs: Inputs) -> None:
    _exchanges('modbus', cases, inputs)


def _dynamixel(cases: int, inputs: Inputs) -> None:
    _exchanges('dynamixel', cases, inputs)


def _exchanges(protocol: str, cases: int, inputs: Inputs) -> None:
    chosen = [each for name, each in test_fuzz.EXCHANGES.items() if name.startswith(protocol)]
    with pytest.MonkeyPatch.context() as patch:
        for check, name, data in chosen:
            _exchange(check, name, data, -(-cases // len(chosen)), inputs, patch)


def _exchange(check: Callable[..., Any], name: str, data: Any, cases: int, inputs: Inputs,
              patch: pytest.MonkeyPatch) -> None:
    @settings(max_examples=cases, deadline=None, derandomize=True)
    @given(data)
    def fuzz(received: Any) -> None:
        inputs.feed(check, patch, name, received)

    fuzz()
