# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The hand-written C that the solver is measured against, compiled when it is needed."""

import ctypes
from pathlib import Path
import shutil
import subprocess
import tempfile

import numpy as np

from soft_continuum.mechanics import (
    Equilibrium,
    RIGHT,
)
from soft_continuum.mechanics.arm import Array
from soft_continuum.mechanics.plane.chain import PlaneChain

SOURCE = Path(__file__).with_name('reference.c')
FLAGS = ('-O2', '-std=gnu11', '-fPIC', '-shared')


class MissingCompilerError(RuntimeError):
    """There is no C compiler."""


class Reference:
    """
    Equilibria of a weightless arm, all segments soft, right tendon of given length, in C.

    Every size is a constant for the compiler.
    """

    def __init__(self, chain: PlaneChain) -> None:
        """Compile for the sizes of ``chain`` and pack its numbers."""
        self.chain = chain
        library = _compiled(chain.segments, chain.joints_per_segment)
        self._solve, self._time = library.solve, library.time_solve
        self._time.restype = ctypes.c_double
        self._chain = np.concatenate([
            chain.body_lengths, chain.joint_stiffness, chain.guides[:, 0], chain.guides[:, 1]])
        self._tension = ctypes.c_double()
        self._iterations, self._residual = ctypes.c_int(), ctypes.c_double()
        self._theta = np.empty(chain.bodies)
        pointer, double = ctypes.c_void_p, ctypes.c_double
        self._solve.argtypes = [pointer, double, pointer, pointer, pointer, pointer]
        self._time.argtypes = [pointer, double, pointer, double, ctypes.c_int]
        self._pointers = (
            self._theta.ctypes.data, ctypes.addressof(self._tension),
            ctypes.addressof(self._iterations), ctypes.addressof(self._residual))
        self._arm = self._chain.ctypes.data

    @property
    def iterations(self) -> int:
        """Newton iterations of the last solve."""
        return self._iterations.value

    @property
    def residual(self) -> float:
        """Largest unbalanced moment that the last solve left, N m."""
        return self._residual.value

    def solve(self, theta: Array, tension: float, pull: float) -> Array:
        """Return absolute angles (joints,) rad for a pull (m), from absolute angles and N."""
        self._theta[:] = theta
        self._tension.value = tension
        ended = self._solve(self._arm, self.chain.straight_paths[0] - pull, *self._pointers)
        if ended != 0:
            raise RuntimeError(f'the C reference did not converge: status {ended}')
        return self._theta

    def seconds_per_solve(self, start: Equilibrium, pull: float, repeats: int) -> float:
        """Return the time of one solve (s), timed inside of C."""
        theta = np.cumsum(start.joint_angles)
        return float(self._time(
            self._arm, self.chain.straight_paths[0] - pull, theta.ctypes.data,
            float(start.tensions[RIGHT]), repeats))


def _compiled(segments: int, joints: int) -> ctypes.CDLL:
    """Compile the source in a temporary directory and load it."""
    compiler = shutil.which('cc')
    if compiler is None:
        raise MissingCompilerError('no C compiler (cc); on Debian or Ubuntu: apt-get install gcc')
    with tempfile.TemporaryDirectory() as directory:
        library = Path(directory) / 'reference.so'
        subprocess.run(
            [compiler, *FLAGS, f'-DSEGMENTS={segments}', f'-DJOINTS={joints}', '-o', library,
             SOURCE, '-lm'], check=True)
        return ctypes.CDLL(str(library))
