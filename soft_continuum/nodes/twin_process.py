# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""The twin in a process of its own, for the verbs that start the nodes: ``--twin``."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
import signal
import subprocess
import sys
from tempfile import TemporaryDirectory
import threading
from time import sleep

from soft_continuum.arguments import Parser
from soft_continuum.emulators.driving import driving_parameters
from soft_continuum.nodes.processes import END_TIMEOUT, start_child, TWIN
from soft_continuum.parameters.parameter import ParameterError

DEFAULT_PRESET = 'typical'
PERIOD = 0.05  # s between two looks at whether it is ready


def add_twin_option(parser: Parser) -> None:
    """Add ``--twin [PRESET]``."""
    parser.add_argument('--twin', nargs='?', const=DEFAULT_PRESET, metavar='PRESET',
                        help='start a simulated rig in MuJoCo too, and drive it; ideal, typical '
                        f'or bad (without a name: {DEFAULT_PRESET})')


@contextmanager
def twin_process(preset: str | None, params_files: Sequence[Path] = (), namespace: str = ''
                 ) -> Iterator[list[str]]:
    """
    Run the twin of the described arm; yield the ROS arguments of nodes that drive it.

    Without a preset nothing is started and nothing yielded.  Raises ParameterError for a twin that
    does not start; it has said why by then.
    """
    if preset is None:
        yield []
        return
    with TemporaryDirectory(prefix='soft_continuum_') as directory:
        ports = {name: Path(directory) / name for name in ('grbl', 'modbus')}
        arguments = [f'--preset={preset}', f'--namespace={namespace}']
        for path in params_files:
            arguments.append(f'--params-file={path}')
        for name, path in ports.items():
            arguments.append(f'--{name}-link={path}')
        process = start_child(TWIN, arguments, subprocess.DEVNULL)
        ending = threading.Event()
        threading.Thread(target=_report_end, args=(process, ending), daemon=True).start()
        try:
            while not all(path.is_symlink() for path in ports.values()):
                if process.poll() is not None:
                    raise ParameterError('the twin did not start; the lines before say why')
                sleep(PERIOD)
            parameters = driving_parameters(ports['grbl'], ports['modbus'])
            yield [word for name, value in parameters.items()
                   for word in ('-p', f'{name}:={value}')]
        finally:
            ending.set()
            process.send_signal(signal.SIGINT)
            try:
                process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                print(f'the twin did not end within {END_TIMEOUT:g} s and is killed',
                      file=sys.stderr, flush=True)
                process.kill()
                process.wait()


def _report_end(process: 'subprocess.Popen[bytes]', ending: threading.Event) -> None:
    """Say so when the twin ends by itself."""
    status = process.wait()
    if not ending.is_set():
        print(f'the twin ended by itself (status {status}); the nodes have no boards any more',
              file=sys.stderr, flush=True)
