# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled solver called directly, without what Statics does around it."""

from collections.abc import Callable, Sequence
from typing import Any
from unittest.mock import patch

import numpy as np

from soft_continuum.mechanics import _kernel, _newton, Equilibrium, Statics
from soft_continuum.mechanics._arrays import State
from soft_continuum.mechanics.chain import Array


class Kernel:
    """One call of ``_newton.newton`` with everything but its state prepared."""

    def __init__(self, statics: Statics, start: Equilibrium, pulls: tuple[float, float],
                 soft: Sequence[bool]) -> None:
        """
        Take over the arguments of the first call that is made for a solve.

        A new Statics has not prepared anything yet that would go round that call.
        """
        calls: list[tuple[Any, ...]] = []

        def record(state: State, *arguments: Any) -> Any:
            calls.append((tuple(a.copy() for a in state), *arguments))
            return compiled(state, *arguments)

        functions = _kernel.functions()
        self._newton = compiled = functions.newton
        with patch.object(_kernel, 'functions', lambda: functions._replace(newton=record)):
            Statics(statics.chain.arm).solve(start, pulls, soft)
        self._state, *self._rest = calls[0]
        self._begin = self._state[0].copy(), self._state[1].copy()
        status, self.iterations, *_ = self.run()
        if status != _newton.CONVERGED:
            raise RuntimeError(f'the compiled solver ended with status {status}')
        self.joint_angles: Array = np.diff(self._state[0], prepend=0.0)

    def run(self) -> tuple[int, ...]:
        """Solve from the start; return what ``_newton.newton`` does."""
        self._state[0][:], self._state[1][:] = self._begin
        result: tuple[int, ...] = self._newton(self._state, *self._rest)
        return result


def repeated(kernels: Sequence[Kernel]) -> Callable[[], None]:
    """Return a call that runs all kernels one after the other."""
    def run() -> None:
        for kernel in kernels:
            kernel.run()
    return run
