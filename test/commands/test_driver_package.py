# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The example of a driver as a package of its own is built, found, and drives its motor box."""

from collections.abc import Iterator
import contextlib
import os
from pathlib import Path
import socketserver
import subprocess
import sys
import threading
import time

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / 'examples' / 'my_tendons'
TIMEOUT = 120  # s

MOVE = """
import sys, time
from pathlib import Path
from soft_continuum.commissioning.checks import check_tendons
from soft_continuum.hardware.drivers import make_driver, TENDON_DRIVERS
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.parameters.files import load_rig
values = load_rig([Path(path) for path in sys.argv[1:]])
print([check.step for check in check_tendons(values)])
driver = make_driver(TENDON_DRIVERS, values['tendon_driver'], values, time.monotonic)
driver.open()
print(driver.read().referenced)
driver.reference()
for step in range(1, 11):
    driver.move((1e-4 * step, -2e-4 * step), 0.02)
    time.sleep(0.02)
while driver.read().moving:
    time.sleep(0.01)
print([round(1e3 * pull, 3) for pull in driver.read().pulls])
driver.stop()
print('quiet', flush=True)
sys.stdin.readline()
try:
    while True:
        driver.read()
except HardwareError as error:
    print(error)
driver.close()
"""


class Box(socketserver.ThreadingTCPServer):
    """The motor box of the example: its motors are at once where they are sent."""

    daemon_threads, allow_reuse_address = True, True

    def __init__(self) -> None:
        self.at, self.held, self.says = [5.0, 7.0], 0, True  # mm
        super().__init__(('127.0.0.1', 0), _Talk)


class _Talk(socketserver.StreamRequestHandler):
    server: Box

    def handle(self) -> None:
        threading.Thread(target=self._say, daemon=True).start()
        with contextlib.suppress(ConnectionResetError):
            for line in self.rfile:
                word, *numbers = line.decode('ascii').split()
                if word == 'go':
                    self.server.at = [float(number) for number in numbers[1:]]
                self.server.held += word == 'hold'

    def _say(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            while True:
                if self.server.says:
                    text = ' '.join(f'{mm:.4f}' for mm in self.server.at)
                    self.wfile.write(f'at 0 {text}\n'.encode('ascii'))
                time.sleep(0.01)


@pytest.fixture
def box() -> Iterator[Box]:
    with Box() as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


def test_the_package_is_built_found_and_drives_its_motors(tmp_path: Path, box: Box) -> None:
    subprocess.run(
        [sys.executable, '-m', 'colcon', 'build', '--base-paths', PACKAGE,
         '--build-base', tmp_path / 'build', '--install-base', tmp_path / 'install'],
        cwd=tmp_path, env={**os.environ, 'COLCON_DEFAULTS_FILE': os.devnull}, check=True,
        capture_output=True, timeout=TIMEOUT)
    packages, = (tmp_path / 'install').glob('my_tendons/lib/python*/site-packages')
    file = tmp_path / 'install/my_tendons/share/my_tendons/config/my_tendons.yaml'
    here = tmp_path / 'here.yaml'
    here.write_text('/**:\n  ros__parameters:\n    my_tendons:\n      address: '
                    f'127.0.0.1:{box.server_address[1]}\n', encoding='utf-8')
    environment = {**os.environ, 'PYTHONPATH': f'{packages}:{os.environ.get("PYTHONPATH", "")}'}

    with subprocess.Popen([sys.executable, '-c', MOVE, file, here], env=environment, text=True,
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE) as program:
        assert program.stdin is not None and program.stdout is not None
        lines = [program.stdout.readline().strip() for _ in range(4)]
        # It opens, the module COMMISSIONING of the driver checks it, and it has no zero.
        assert lines[0] == "['tendon driver my_tendons', 'motor box', 'tendon reference']"
        assert lines[1:] == ['False', '[1.0, -2.0]', 'quiet']
        assert box.at == pytest.approx([6.0, 5.0])
        assert box.held
        box.says = False
        program.stdin.write('\n')
        program.stdin.close()
        assert 'the motor box said nothing for' in program.stdout.read()
