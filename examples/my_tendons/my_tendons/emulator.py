# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``soft_continuum emulate my_tendons``: a motor box whose motors are at once where it is sent."""

from contextlib import suppress
import socketserver
import threading
import time

from soft_continuum.parameters.arguments import Parser, whole_number_in
from soft_continuum.sim.emulators.device import Command, execute, serve, set_to


class EmulatedBox(socketserver.ThreadingTCPServer):
    """at: positions of its motors, mm.  held: number of stops.  hang: whether it says nothing."""

    daemon_threads, allow_reuse_address = True, True

    def __init__(self, port):
        """Listen to a port of this computer; 0: any."""
        self.at, self.held, self.hang = [5.0, 7.0], 0, False
        super().__init__(('127.0.0.1', port), _Connection)
        threading.Thread(target=self.serve_forever, daemon=True).start()


class _Connection(socketserver.StreamRequestHandler):
    def handle(self):
        threading.Thread(target=self._report, daemon=True).start()
        with suppress(ConnectionResetError):
            for line in self.rfile:
                word, *numbers = line.decode('ascii').split()
                if word == 'go':
                    self.server.at = [float(number) for number in numbers[1:]]
                self.server.held += word == 'hold'

    def _report(self):
        with suppress(OSError, ValueError):
            while True:
                if not self.server.hang:
                    text = ' '.join(f'{mm:.4f}' for mm in self.server.at)
                    self.wfile.write(f'at 0 {text}\n'.encode('ascii'))
                time.sleep(0.01)


COMMANDS = {
    'hang': Command('', 'stop reporting', set_to('hang', True)),
    'repair': Command('', 'report again', set_to('hang', False)),
    'state': Command('', 'print where the motors are, and how often they were stopped',
                     lambda box: f'at {box.at} mm, stopped {box.held} times'),
}


def main(argv=None):
    """Serve the box until ``quit`` or Ctrl-C; faults are typed on standard input."""
    parser = Parser('emulate my_tendons', 'The motor box.')
    parser.add_argument('--port', type=whole_number_in(0, 65535), default=4000,
                        help='of this computer; 0: any (default: %(default)s)')
    port = parser.parse_args(argv).port
    return serve(
        parser, lambda: EmulatedBox(port),
        lambda box: {'tendon_driver': 'my_tendons',
                     'my_tendons.address': f'127.0.0.1:{box.server_address[1]}'},
        lambda box, line: execute(COMMANDS, {}, box, line))
