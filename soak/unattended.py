# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""An arm that nobody attends to: the memory of each of its processes while it works for hours."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path
import re
import subprocess
import sys
import tempfile
import threading
import time

import msgspec
import numpy as np
import viser
from websockets.sync.client import connect

from benchmarks.tables import table
from soak.report import progress, Report
from soak.workbench import domain
from soft_continuum.client import Arm, ClientError
from soft_continuum.nodes.shape_sequencer import RESULT_TIMEOUT

DURATION = 3600.0  # s
MAX_GROWTH = 5.0  # MB/h, of all processes together but RECORDING
RECORDING = 'recording'  # which keeps the index of its file until it ends
START_TIMEOUT = 120.0  # s
SHAPES = 'c_form', 'upright_c_form', 's_form'
CAMERA = {'type': 'ViewerCameraMessage', 'wxyz': [1, 0, 0, 0], 'position': [0, 0, 1], 'fov': 1.0,
          'near': 0.1, 'far': 10.0, 'image_height': 100, 'image_width': 100,
          'look_at': [0.0, 0.0, 0.0], 'up_direction': [0.0, 0.0, 1.0]}
Sizes = dict[str, list[tuple[float, float]]]  # s and MB, by process


def run(share: float) -> Report:
    """Let nodes, recorder, recording and view work for ``share`` of an hour, watched by a page."""
    sizes: Sizes = {}
    failures: list[str] = []
    goals = ended_early = 0
    with (tempfile.TemporaryDirectory() as directory, domain() as number,
          _domain_of_programs(number), _Programs(Path(directory)) as programs,
          Arm(timeout=START_TIMEOUT) as arm):
        address = programs.start_view()
        arm.run(SHAPES[0])  # waits for the nodes
        programs.start(RECORDING, 'record', '--output', str(Path(directory, 'recording')))
        ended = threading.Event()
        page = threading.Thread(target=_look, args=(address, ended), daemon=True)
        page.start()
        begin = noted = time.monotonic()
        while (now := time.monotonic()) - begin < share * DURATION:
            try:
                arm.run(*SHAPES)
                goals += 1
            except ClientError:  # such as of a node that a busy machine kept waiting
                ended_early += 1
            _weigh(sizes, programs.running, time.monotonic() - begin)
            if now - noted > 600.0:
                noted = now
                progress(f'{(now - begin) / 60:.0f} min, {goals} goals')
        failures += [f'{name} has ended' for name, process in programs.running.items()
                     if process.poll() is not None]
        failures += [] if page.is_alive() else ['the page has lost its connection']
        ended.set()
    growths = {name: _growth(rows) for name, rows in sizes.items()}
    growth = sum(of for name, of in growths.items() if name != RECORDING)
    if growth > MAX_GROWTH:
        failures.append(f'memory grew by {growth:.1f} MB/h')
    rows = [(name, f'{of[-1][1]:.1f}', f'{growths[name]:+.1f}') for name, of in sizes.items()]
    return Report(
        f'{share * DURATION / 60:.0f} min, {goals} goals of {len(SHAPES)} shapes, '
        f'{ended_early} that ended early, one page open. Allowed growth of all but recording: '
        f'{MAX_GROWTH:g} MB/h.\n\n'
        + table(('process', 'MB in the end', 'growth in the second half, MB/h'), rows),
        tuple(failures))


@contextmanager
def _domain_of_programs(domain: int) -> Iterator[None]:
    """Have the programs that are started, and this one, in a ROS domain of their own."""
    before = os.environ.get('ROS_DOMAIN_ID', '')
    os.environ['ROS_DOMAIN_ID'] = str(domain)
    try:
        yield
    finally:
        os.environ['ROS_DOMAIN_ID'] = before


class _Programs:
    """Programs of the suite as a user starts them, which end with a ``with`` block."""

    def __init__(self, folder: Path) -> None:
        """Start nothing yet; folder: for what they write."""
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        self._folder = folder

    def __enter__(self) -> '_Programs':
        """Begin."""
        return self

    def __exit__(self, *_: object) -> None:
        """End them."""
        for program in self.running.values():
            program.terminate()
        for program in self.running.values():
            program.wait(30.0)

    def start(self, name: str, *command: str) -> None:
        """Start a verb with its options."""
        with (self._folder / f'{name}.txt').open('wb') as output:
            self.running[name] = subprocess.Popen(
                [sys.executable, '-m', 'soft_continuum', *command], stdin=subprocess.DEVNULL,
                stdout=output, stderr=output)

    def start_view(self, *options: str) -> str:
        """Start nodes, recorder and view, with options; return the address of the page."""
        self.start('view', 'ui', '--port', '0', *options)
        deadline = time.monotonic() + START_TIMEOUT
        output = self._folder / 'view.txt'
        while not (found := re.search(r' is at (http\S+)', output.read_text())):
            if time.monotonic() > deadline:
                raise RuntimeError(f'no view:\n{output.read_text()}')
            time.sleep(0.1)
        return found[1]


def _look(address: str, ended: threading.Event) -> None:
    """Be a page: take all that it is sent."""
    with connect(address.replace('http', 'ws'), max_size=None,
                 subprotocols=[f'viser-v{viser.__version__}']) as page:  # type: ignore[list-item]
        page.send(msgspec.msgpack.encode(CAMERA))
        while not ended.is_set():
            with suppress(TimeoutError):
                page.recv(timeout=60.0)


def _weigh(sizes: Sizes, programs: dict[str, subprocess.Popen[bytes]], now: float) -> None:
    """Note the resident memory of the programs and of the nodes that they started."""
    names = {process.pid: name for name, process in programs.items()}
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            parent = int((folder / 'stat').read_text().rpartition(')')[2].split()[1])
            words = (folder / 'cmdline').read_text().split('\0')
            if int(folder.name) in names:
                name = names[int(folder.name)]
            elif parent in names and '-c' in words:
                name = words[words.index('-c') + 3]
            else:
                continue
            pages = int((folder / 'statm').read_text().split()[1])
        except OSError:  # it ended meanwhile
            continue
        sizes.setdefault(name, []).append((now, pages * os.sysconf('SC_PAGE_SIZE') / 1e6))


def _growth(rows: list[tuple[float, float]]) -> float:
    """Return by how much a process grew in the second half, MB/h; nan if the run was short."""
    late = rows[len(rows) // 2:]
    if late[0][0] < RESULT_TIMEOUT:
        return float('nan')
    times, sizes = np.array(late).T
    return float(np.polyfit(times / 3600.0, sizes, 1)[0])
