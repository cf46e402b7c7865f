# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled solver called directly, without what Statics does around it."""

from collections.abc import Callable, Sequence
from typing import Any
from unittest.mock import patch

from soft_continuum.mechanics import _kernel, Equilibrium, Statics
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.plane import _newton


class Kernel:
    """One call of ``_newton.equilibrium`` with everything prepared."""

    def __init__(self, statics: Statics, start: Equilibrium, pulls: tuple[float, float],
                 soft: Sequence[bool]) -> None:
        """Take over the arguments of the call that is made for a solve."""
        calls: list[tuple[Any, ...]] = []

        def record(*arguments: Any) -> Any:
            calls.append(arguments)
            return self._solve(*arguments)

        functions = _kernel.functions()
        self._solve = functions.equilibrium
        with patch.object(_kernel, 'functions', lambda: functions._replace(equilibrium=record)):
            statics.solve(start, pulls, soft)
        self._arguments = calls[0]
        status, self.iterations, *_ = self.run()
        if status != _newton.CONVERGED:
            raise RuntimeError(f'the compiled solver ended with status {status}')
        self.joint_angles: Array = self._arguments[-1][0]

    def run(self) -> tuple[int, ...]:
        """Solve from the start; return what ``_newton.equilibrium`` does."""
        result: tuple[int, ...] = self._solve(*self._arguments)
        return result


def repeated(kernels: Sequence[Kernel]) -> Callable[[], None]:
    """Return a call that runs all kernels one after the other."""
    def run() -> None:
        for kernel in kernels:
            kernel.run()
    return run
