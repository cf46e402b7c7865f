# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The view under attack, beside nodes that control an arm: what the control loop notices."""

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack, suppress
from http.client import HTTPConnection
import os
from pathlib import Path
import socket
import subprocess
import sys
import tempfile
import threading
import time
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from benchmarks.tables import table
from soak.report import Report, spread
from soak.unattended import _domain_of_programs, _Programs
from soak.workbench import domain
from support.ros_rig import ALL, Rig

DURATION = 20.0  # s of each attack
STOPS = 20
RESUME_PERIOD = 2.0  # s
MAX_GAP, MAX_STOP = 0.5, 1.0  # s: other nodes take tendon_states as stale; a stop is an error
TOKEN = 'a-token-of-this-soak-test'
ATTACKS = {
    'none': 'none',
    'silent': '100 connections that ask for nothing',
    'slow': '100 that do not take the page',
    'guess': '20 that guess tokens',
    'pages': '60 WebSockets that take nothing',
    'flood': '4 pages that send invalid messages',
}


def run(share: float) -> Report:
    """Attack in each way for ``share`` of DURATION."""
    rows, failures, sizes = [], [], list[float]()
    with (tempfile.TemporaryDirectory() as directory, domain() as number,
          _domain_of_programs(number), _Programs(Path(directory)) as programs):
        rig = Rig(number, '/soak')
        address = programs.start_view('--token', TOKEN, '--namespace', 'soak')
        rig.wait_until_ready(*ALL)
        view = programs.running['view'].pid
        port = urlsplit(address).port or 0
        cookie = _cookie(port)
        with connect(f'ws://127.0.0.1:{port}/bar', additional_headers={'Cookie': cookie}) as bar:
            threading.Thread(target=_take_all, args=(bar,), daemon=True).start()
            for kind, text in ATTACKS.items():
                with _attack(kind, port, cookie):
                    begin = time.time_ns()
                    time.sleep(share * DURATION)
                    end = time.time_ns()  # what was written before may still be on its way
                    rig.wait_for(lambda end=end: rig.tendons.heard[-1].time > end, 'the tendons')
                    times = [one.time for one in list(rig.tendons.heard)
                             if begin < one.time < end]
                    stops = [_stop(rig, bar) for _ in range(max(2, round(share * STOPS)))]
                gaps = (np.diff(times) * 1e-9).tolist()
                memory = Path(f'/proc/{view}/statm').read_text(encoding='ascii').split()[1]
                sizes.append(int(memory) * os.sysconf('SC_PAGE_SIZE') / 1e6)
                rows.append((text, spread(gaps)[2], spread(stops)[0], spread(stops)[2]))
                if max(gaps, default=1e9) > MAX_GAP or max(stops) > MAX_STOP:
                    failures.append(f'{kind}: tendon_states {max(gaps, default=1e9):.2f} s apart, '
                                    f'a stop after {max(stops):.2f} s')
        rig.close()
    head = ('attack', 'longest time between two tendon_states, ms',
            'from STOP to the state stopped, ms: median', 'longest')
    return Report(f'The view took at most {max(sizes):.0f} MB.\n\n{table(head, rows)}',
                  tuple(failures))


def _cookie(port: int) -> str:
    connection = HTTPConnection('127.0.0.1', port, timeout=30)
    connection.request('GET', f'/?token={TOKEN}')
    return str(connection.getresponse().headers['Set-Cookie']).partition(';')[0]


def _take_all(bar: ClientConnection) -> None:
    with suppress(ConnectionClosed):
        while True:
            bar.recv()


def _stop(rig: Rig, bar: ClientConnection) -> float:
    """Stop by the page, wait for the state, resume; return how long the stop took, s."""
    state, begin = rig.states['tendon_actuation'], time.monotonic()
    bar.send('stop')
    rig.wait_for(lambda: state.last.stopped, 'a stop')
    took = time.monotonic() - begin
    while state.last.stopped:  # on a busy machine the view has asked for the stop once more
        bar.send('resume')
        with suppress(AssertionError, pytest.fail.Exception):
            rig.wait_for(lambda: not state.last.stopped, 'a resume', RESUME_PERIOD)
    return took


@contextmanager
def _attack(kind: str, port: int, cookie: str) -> Iterator[None]:
    """Attack from a process of its own."""
    process = subprocess.Popen([sys.executable, '-m', 'soak.attacks', kind, str(port), cookie])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def main(kind: str, port: int, cookie: str) -> None:
    """Attack until this process is killed."""
    request = f'GET /{{}} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nCookie: {cookie}\r\n'
    upgrade = (request.format('bar') + 'Upgrade: websocket\r\nConnection: Upgrade\r\n'
               'Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n')
    while True:
        with ExitStack() as opened, suppress(OSError):
            if kind == 'none':
                time.sleep(1e6)
            count = {'guess': 20, 'pages': 60, 'flood': 4}.get(kind, 100)
            many = [opened.enter_context(socket.create_connection(('127.0.0.1', port), 30.0))
                    for _ in range(count)]
            if kind == 'slow':
                for one in many:
                    one.sendall(request.format('index.html').encode() + b'\r\n')
            elif kind == 'guess':
                for number, one in enumerate(many):
                    one.sendall(f'GET /?token=guess-{number} HTTP/1.1\r\nHost: x\r\n\r\n'.encode())
                for one in many:
                    one.recv(9999)
                continue
            elif kind in ('pages', 'flood'):
                for one in many:
                    one.sendall(upgrade.encode())
                if kind == 'pages':
                    time.sleep(1e6)
                frames = 1000 * b'\x81\x84\0\0\0\0nono'
                for one in many:
                    one.setblocking(False)
                while True:
                    for one in many:
                        with suppress(BlockingIOError):
                            one.send(frames)
            time.sleep(0.5)


if __name__ == '__main__':
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
