# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The example of a driver as a package of its own is built, found, emulated and driven."""

from contextlib import ExitStack
import os
from pathlib import Path
import re
import subprocess
import sys

PACKAGE = Path(__file__).resolve().parents[2] / 'examples' / 'my_tendons'
TIMEOUT = 120  # s

MOVE = """
import sys, time
from pathlib import Path
from soft_continuum.commissioning.doctor import check_tendons
from soft_continuum.hardware.drivers import families, TENDON_DRIVERS
from soft_continuum.hardware.protocols import HardwareError
from soft_continuum.ros.description import load_rig
values = load_rig([Path(path) for path in sys.argv[1:]])
print([check.step for check in check_tendons(values)])
driver = families(TENDON_DRIVERS)[values['tendon_driver']].make(values, time.monotonic)
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


def test_the_package_is_built_found_and_drives_its_emulated_motors(tmp_path):
    subprocess.run(
        [sys.executable, '-m', 'colcon', 'build', '--base-paths', PACKAGE,
         '--build-base', tmp_path / 'build', '--install-base', tmp_path / 'install'],
        cwd=tmp_path, env={**os.environ, 'COLCON_DEFAULTS_FILE': os.devnull}, check=True,
        capture_output=True, timeout=TIMEOUT)
    packages, = (tmp_path / 'install').glob('my_tendons/lib/python*/site-packages')
    file = tmp_path / 'install/my_tendons/share/my_tendons/config/my_tendons.yaml'
    here = tmp_path / 'here.yaml'
    environment = {**os.environ, 'PYTHONPATH': f'{packages}:{os.environ.get("PYTHONPATH", "")}'}

    def start(*words):
        return ended.enter_context(subprocess.Popen(
            [sys.executable, *map(str, words)], env=environment, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE))

    def say(program, line):
        assert program.stdin is not None
        print(line, file=program.stdin, flush=True)

    def read(program, lines=1):
        assert program.stdout is not None
        return ''.join(program.stdout.readline() for _ in range(lines))

    with ExitStack() as ended:
        box = start('-m', 'soft_continuum', 'emulate', 'my_tendons', '--port', 0)
        ended.callback(box.kill)
        here.write_text(read(box, 6), encoding='utf-8')
        assert 'Type a fault' in read(box)
        program = start('-c', MOVE, file, here)
        ended.callback(program.kill)
        # It opens, the module COMMISSIONING of the driver checks it, and it has no zero.
        assert read(program) == ("['tendon driver my_tendons', 'motor box', 'tendon reference']\n")
        assert read(program, 3) == 'False\n[1.0, -2.0]\nquiet\n'
        say(box, 'state')
        assert re.fullmatch(r'at \[6\.0, 5\.0\] mm, stopped [1-9] times\n', read(box))
        say(box, 'hang')
        assert read(box) == 'done\n'
        say(program, '')
        assert 'the motor box said nothing for' in read(program)
        say(box, 'quit')
        assert box.wait(TIMEOUT) == 0
