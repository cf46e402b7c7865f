# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of Modbus boards: whether and how fast they answer; nothing is switched."""

from collections.abc import Iterator, Mapping
from typing import Any

from soft_continuum.hardware.clock import STEADY
from soft_continuum.hardware.commissioning import Check, FAIL, OK, WARN
from soft_continuum.hardware.modbus.bus import MAX_PAUSE, ModbusBus
from soft_continuum.hardware.modbus.jamming import Board, Outputs, Relays, Transmitters
from soft_continuum.hardware.protocols import HardwareError

PORT = 'modbus.port'

ROUND_TRIPS, MAX_LOST_REPLIES = 5, 1
"""Requests to each board, and replies that may be missing before it counts as failed."""
MAX_TIMEOUT_SHARE = 0.5
"""Share of modbus.timeout that a reply may take."""
OUTPUT_BOARD = 'output board'


def checks(values: Mapping[str, Any]) -> Iterator[Check]:
    """Yield the state of both boards."""
    boards: dict[str, Board] = (
        {OUTPUT_BOARD: Outputs.from_parameters(values)} if values['modbus.regulators'] else
        {'relay board': Relays.from_parameters(values)})
    boards['analog board'] = Transmitters.from_parameters(values)
    bus = ModbusBus(values['modbus.port'], values['modbus.baud_rate'], values['modbus.timeout'])
    try:
        bus.open()
    except HardwareError as error:
        yield Check('jamming port', FAIL, str(error))
        return
    yield Check('jamming port', OK, f'{values["modbus.port"]} opened, no other program uses it')
    trips: list[float] = []
    try:
        for name, board in boards.items():
            state: tuple[int, ...] = ()
            lost: list[str] = []
            for _ in range(ROUND_TRIPS):
                begin = STEADY()
                try:
                    state = board.ask_all(bus)
                    trips.append(STEADY() - begin)
                except HardwareError as error:
                    lost.append(str(error))
                    STEADY.sleep(MAX_PAUSE)
                    bus.open()  # so that no late reply is received
                if len(lost) > MAX_LOST_REPLIES:
                    break
            message = f'unit {board.unit} answers: ' + ', '.join(
                _state(name, a, s) for a, s in zip(board.span, state, strict=False))
            if len(lost) > MAX_LOST_REPLIES:
                yield Check(name, FAIL, lost[-1])
            elif lost:
                yield Check(name, WARN, f'{message}; {len(lost)} of {ROUND_TRIPS} replies '
                            f'missed: {lost[0]}')
            else:
                yield Check(name, OK, message)
    except HardwareError as error:
        yield Check('jamming port', FAIL, str(error))
        return
    finally:
        bus.close()
    if trips:
        yield _check_round_trip(trips, values['modbus.timeout'])


def _state(board: str, address: int, state: int) -> str:
    if board == OUTPUT_BOARD:
        return f'register {address} is {state}'
    if isinstance(state, bool):
        return f'coil {address} {"on" if state else "off"}'
    return f'register {address} {state / 1000:.2f} mA'


def _check_round_trip(trips: list[float], timeout: float) -> Check:
    slowest = max(trips)
    message = (f'slowest of {len(trips)} replies after {1e3 * slowest:.0f} ms, '
               f'modbus.timeout is {1e3 * timeout:g} ms')
    if slowest > MAX_TIMEOUT_SHARE * timeout:
        return Check('modbus round trip', WARN,
                     f'{message}; set it to {2.0 / MAX_TIMEOUT_SHARE * slowest:.2f} s or more')
    return Check('modbus round trip', OK, message)
