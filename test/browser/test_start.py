# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""``./run ui`` starts the nodes and the view, and ends them."""

import json
import signal

from websockets.sync.client import connect

from support.page import address_of, DEADLINE, start_view
from support.ros_rig import ALL


def test_nodes_and_view_start_and_end_together(make_rig, processes):
    rig = make_rig(namespace='/left')
    process = start_view(processes, 'ui', '--namespace', 'left')
    rig.wait_until_ready(*ALL)
    address = address_of(process)
    with connect(f'{address.replace("http", "ws")}bar', open_timeout=DEADLINE) as bar:
        while json.loads(bar.recv(DEADLINE))['kind'] != 'ready':
            pass  # the view has yet to find the nodes that this test has found
        bar.send('stop')
        rig.wait_for_status('tendon_actuation', 'stopped', 'stop was called')
    process.send(signal.SIGINT)
    assert process.wait() == 0, process.output
    assert 'Traceback' not in process.output, process.output
