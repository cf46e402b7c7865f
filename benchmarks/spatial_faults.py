# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of the simulated arm in space: which cause is named, how soon, and without any."""

from benchmarks.faults import alarms, HEAD, row, simulated, total
from benchmarks.lab import Description
from benchmarks.tables import machine, Section, table
from soft_continuum.sim.twin.model_errors import read_model_errors
from soft_continuum.user_files import description_file

ARM = 'spatial_jamming.yaml'
RUNS, OPEN = 5, 10  # of each fault; sequences without one
SHAPES = 3  # of a sequence without a fault


def run(quick: bool) -> Section:
    """Measure; the section is of the page about estimation."""
    broken, sequences = simulated(
        Description.read(description_file().with_name(ARM)).arm,
        read_model_errors(description_file().with_name('twin.yaml'), 'typical'),
        *((1, 1, 1) if quick else (RUNS, OPEN, SHAPES)))
    body = '\n\n'.join([
        f'Simulated: as for the planar arm, with `config/{ARM}` in random directions. '
        + machine(),
        table((*HEAD[:2], 's until named, worst'), [
            (*row(fault, outcomes)[:2], row(fault, outcomes)[3])
            for fault, outcomes in broken.items()]), total(broken),
        alarms(in_open_loop=sequences, before_faults=sum(broken.values(), []))])
    return Section('benchmarks/estimation.md', 'spatial_faults', body)
