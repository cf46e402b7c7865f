# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Motion of the servos: the goals that they get, and what their replies show.

A servo holds a load only with a position error: its goal is a little ahead of where it is.  This
``lead`` is adapted while the path rests, until the tendons are where they should be.  It is
proportional to the current, so a stop keeps the part of it that loaded tendons need.

A servo lags behind its goal, by more under load, so its position error is a poor indicator of a
blocked one, which soon stops the others.  Its travel is a better one: it is compared with that of
an unloaded motor.  Load and friction change a part of the travel, or change it once; a blocked
servo does not travel at all.
"""

from collections import deque
from collections.abc import Sequence

from soft_continuum.hardware.dynamixel.registers import RADIANS_PER_PULSE, TICK_RANGE
from soft_continuum.hardware.dynamixel.setup import (
    FoundServo,
    FRICTION_SHARE,
    profile_speed,
    ServoState,
    Spools,
)
from soft_continuum.hardware.simulated_tendons import SimulatedTendons

MAX_STEP = 0.03
"""s of the path per cycle: what a cycle comes late by more is not caught up."""
LEAD_RATE = 8.0  # 1/s with which the lead removes an error at rest
MAX_LEAD = 0.01  # m, of a goal
SATURATED = 0.95  # of the current that a servo may use: a lead would only wind up
MIN_COUNTS = 5  # of current, above which it determines the lead
PATH_RESOLUTION = 1e-9  # m


class HeldPath:
    """Where all tendons should be, in pulses of their servos; for one thread at a time."""

    def __init__(self, spools: Spools, zeros: Sequence[int], positions: Sequence[int],
                 goals: Sequence[int]) -> None:
        """Hold servos at their ``positions`` by their present ``goals``; zeros: of pulls."""
        self._spools, self._scale = spools, spools.pull_per_pulse
        self.zeros = list(zeros)
        self._leads_per_count = [0.0] * len(self._scale)  # as found at rest, pulses
        self.place(positions, goals)

    def place(self, positions: Sequence[int], goals: Sequence[int]) -> None:
        """Hold the servos at their positions, by their present goals."""
        self.wanted = [float(position) for position in positions]
        """Where the servos should be now, pulses."""
        self.lead = [
            max(-most, min(most, float(goal - position)))
            for goal, position, most in zip(goals, positions, self._max_lead(), strict=True)]
        self._origin = self._target = self.to_pulls(positions)
        self._time = 0.0  # s
        self._path = SimulatedTendons(
            lambda: self._time, self._spools.tendons, self._spools.speed_limit,
            self._spools.acceleration_limit, PATH_RESOLUTION)

    def aim(self, pulls: tuple[float, ...], duration: float) -> None:
        """Move on to ``pulls`` (m), to be there after ``duration`` (s) as far as limits allow."""
        self._target = pulls
        self._path.move(tuple(p - o for p, o in zip(pulls, self._origin, strict=True)), duration)

    @property
    def done(self) -> bool:
        """Whether the path has come to its end."""
        reading = self._path.read()
        return not reading.moving and all(
            abs(a + b - c) < 10 * PATH_RESOLUTION
            for a, b, c in zip(self._origin, reading.pulls, self._target, strict=True))

    def advance(self, elapsed: float) -> None:
        """Let time (s) pass."""
        self._time += min(elapsed, MAX_STEP)
        self.wanted = self.to_pulses([
            a + b for a, b in zip(self._origin, self._path.read().pulls, strict=True)])

    def adapt(self, elapsed: float, positions: Sequence[int], currents: Sequence[int],
              limits: Sequence[int]) -> None:
        """Increase the lead of servos that are short of the end; currents and limits: counts."""
        for i, (error, current, limit, most) in enumerate(zip(
                self.errors(positions), currents, limits, self._max_lead(), strict=True)):
            if abs(error) > self.tolerances[i] / 2.0:
                if abs(current) < SATURATED * limit or error * current < 0.0:
                    lead = self.lead[i] + LEAD_RATE * min(elapsed, MAX_STEP) * error
                    self.lead[i] = max(-most, min(most, lead))
            elif abs(current) >= MIN_COUNTS and self.lead[i] * current > 0.0:
                self._leads_per_count[i] = (self.lead[i] + error) / current

    def holding_goals(self, positions: Sequence[int], currents: Sequence[int]) -> list[int]:
        """Return goals that hold servos where they are, against loads that need the currents."""
        return [round(position + max(-most, min(most, per_count * current)))
                for position, current, per_count, most in zip(
                    positions, currents, self._leads_per_count, self._max_lead(), strict=True)]

    @property
    def goals(self) -> list[int]:
        """Goal Position of every servo."""
        return [round(a + b) for a, b in zip(self.wanted, self.lead, strict=True)]

    def errors(self, positions: Sequence[int]) -> list[float]:
        """Return the position errors of servos, pulses."""
        return [a - b for a, b in zip(self.wanted, positions, strict=True)]

    @property
    def tolerances(self) -> list[float]:
        """Position tolerances of arrival, pulses."""
        return [tolerance / abs(scale) for tolerance, scale in zip(
            self._spools.arrival_tolerances, self._scale, strict=True)]

    def to_pulls(self, positions: Sequence[float]) -> tuple[float, ...]:
        """Return the pulls (m) of positions (pulses)."""
        return tuple(scale * (position - zero) for scale, position, zero in zip(
            self._scale, positions, self.zeros, strict=True))

    def to_pulses(self, pulls: Sequence[float]) -> list[float]:
        """Return the positions (pulses) of pulls (m)."""
        return [zero + pull / scale for scale, pull, zero in zip(
            self._scale, pulls, self.zeros, strict=True)]

    def _max_lead(self) -> list[float]:
        return [MAX_LEAD / abs(scale) for scale in self._scale]


REST_TIME, REST_PULSES = 0.03, 1
"""Time (s) in which a servo at rest turns by at most so many pulses."""
VELOCITY_TIME = 0.008  # s
SHORT, SHARE = 1.5e-4, 0.15
"""Tolerated travel error (m), and share of the expected travel below which a servo is blocked."""
MEMORY = 1.0  # s in which the way is looked at
MOTOR_TIME, MAX_MOTOR_TIME = 0.015, 0.03
"""s in which a motor follows a voltage, est, and of one with much inertia, by its current."""
MAX_LATE = 0.005  # s between request and reply after which the goal in force is unknown
CYCLE, STEP = 0.01, 1e-3  # s


class Track:
    """Positions of servos in the last REST_TIME."""

    def __init__(self, time: float, positions: Sequence[int]) -> None:
        """Begin with servos at rest at ``positions``; time: s."""
        self._places = deque([(time, positions)])

    def add(self, time: float, positions: Sequence[int]) -> None:
        """Add positions of a later time (s)."""
        self._places.append((time, positions))
        while len(self._places) > 2 and self._places[1][0] <= time - REST_TIME:
            self._places.popleft()

    def velocities(self) -> list[float]:
        """Return the velocities in the last 0.01 s, pulses/s."""
        end, places = self._places[-1]
        begin, before = next(
            ((time, at) for time, at in reversed(self._places) if time <= end - VELOCITY_TIME),
            self._places[0])
        return [(b - a) / max(end - begin, VELOCITY_TIME)
                for a, b in zip(before, places, strict=True)]

    def still(self) -> bool:
        """Whether they have rested for REST_TIME."""
        return len(self._places) > 2 and (
            self._places[-1][0] - self._places[0][0] > 0.99 * REST_TIME) and all(
            max(places) - min(places) <= REST_PULSES
            for places in zip(*(places for _, places in self._places), strict=True))


class Following:
    """Compares servos with unloaded motors; for one thread at a time."""

    def __init__(self, servos: Sequence[FoundServo], spools: Spools,
                 states: Sequence[ServoState]) -> None:
        """Begin with servos at rest."""
        self._servos, self._scale = tuple(servos), spools.pull_per_pulse
        # Friction of the gear turns with the direction.
        self._short = [SHORT + 1.5 * abs(scale) * FRICTION_SHARE * servo.full_error
                       * servo.tension_limit * servo.radius / servo.model.stall_torque
                       for servo, scale in zip(servos, self._scale, strict=True)]
        self.place(states)

    def place(self, states: Sequence[ServoState]) -> None:
        """Start again with servos at rest."""
        self._places = [float(state.written.goal) for state in states]  # of the motors, pulses
        self._most = [  # pulses/s^2 with what its load leaves of the current of a servo
            max(0, servo.goal_current - abs(state.current)) * servo.tension(1) * servo.radius
            / servo.model.stall_torque * servo.model.no_load_speed / RADIANS_PER_PULSE
            / MAX_MOTOR_TIME for servo, state in zip(self._servos, states, strict=True)]
        self._speeds = [0.0] * len(self._places)  # pulses/s
        self._behind: list[deque[tuple[float, float]]] = [deque() for _ in self._places]
        """For each servo, where the motor and where it were, pulses, up to MEMORY ago."""

    def add(self, before: Sequence[ServoState], states: Sequence[ServoState], missed: bool
            ) -> None:
        """Add the latest positions; missed: whether states before them were lost."""
        for i, (old, new) in enumerate(zip(before, states, strict=True)):
            self._go_on(i, old, 1e-3 * ((new.tick - old.tick) % TICK_RANGE))
            seen = self._behind[i]
            if missed or new.time - new.asked > MAX_LATE:
                seen.clear()
            seen.append((self._places[i], new.position))
            if len(seen) > MEMORY / CYCLE:
                seen.popleft()

    def _go_on(self, i: int, state: ServoState, elapsed: float) -> None:
        """Let the motor of a servo go on to its goal."""
        fastest, lag = profile_speed(state.written), self._servos[i].lag_time
        while elapsed > 0.0:
            step = min(elapsed, STEP)
            wanted = (state.written.goal - self._places[i]) / lag
            wanted = max(-fastest, min(fastest, wanted))
            faster = (wanted - self._speeds[i]) / MOTOR_TIME
            self._speeds[i] += max(-self._most[i], min(self._most[i], faster)) * step
            self._places[i] += self._speeds[i] * step
            elapsed -= step

    @property
    def caught(self) -> int | None:
        """Which servo does not follow; None if all do."""
        for i, (seen, scale, short) in enumerate(zip(
                self._behind, self._scale, self._short, strict=True)):
            place, position = seen[-1] if seen else (0.0, 0.0)
            for motor, servo in seen:
                way, gone = abs(place - motor), position - servo
                gone = gone if place > motor else -gone
                if abs(scale) * (way - gone) > short and gone < SHARE * way:
                    return i
        return None


TAKE_UP_SPEED = 0.002  # m/s
MAX_TAKE_UP = 0.02  # m of each tendon
TAKE_UP_LEAD = 0.002
"""Largest lead of a goal (m), which limits the jerk if a tendon gives way."""
TAUT_SHARE = 0.9  # of the current for that tension
TAUT_TIME = 0.2  # s
TAUT_PULSES = 2  # that a taut tendon may move in that time
MAX_TAKE_UP_TIME = 30.0  # s for each tendon, whatever happens


class TakeUp:
    """
    Takes up the slack of one tendon after the other; for one thread at a time.

    The servo itself limits the tension: its Goal Current is that of the tension until all tendons
    are taut.  currents: Goal Current of each servo.  goals: Goal Position of each.  failed: why
    the slack was not taken up, or empty.  done: whether it has ended.
    """

    def __init__(self, servos: Sequence[FoundServo], spools: Spools, positions: Sequence[int],
                 goals: Sequence[int], now: float) -> None:
        """Begin from where servos rest at their ``goals``; now: s."""
        self._servos, self._scale = tuple(servos), spools.pull_per_pulse
        self._tension = spools.take_up_tension
        self.currents = [servo.goal_current for servo in servos]
        self.goals = list(goals)
        self.failed, self.done = '', False
        self._at = -1
        self._next(positions, now)

    def _next(self, positions: Sequence[int], now: float) -> None:
        """Go on with the next tendon, from where it is."""
        self._at += 1
        if self._at == len(self._servos):
            self.done = True
            return
        at = self._at
        self.currents[at] = max(1, self._servos[at].current(self._tension))
        self._start, self._began, self._stepped = positions[at], now, now
        self._goal = float(positions[at])
        self._still = (now, positions[at])  # since when it rests, and where

    def step(self, states: Sequence[ServoState], now: float) -> None:
        """Set goals and currents for now (s); ``states``: the last replies of the servos."""
        at, servo = self._at, self._servos[self._at]
        state, scale = states[at], self._scale[at]
        if abs(state.position - self._still[1]) > TAUT_PULSES:
            self._still = now, state.position
        sign = 1.0 if scale > 0.0 else -1.0
        taut = (sign * state.current >= TAUT_SHARE * self.currents[at]
                and now - self._still[0] >= TAUT_TIME)
        if taut:
            self._next([s.position for s in states], now)
            return
        travel = scale * (state.position - self._start)
        if travel > MAX_TAKE_UP or now - self._began > MAX_TAKE_UP_TIME:
            self.done = True
            self.failed = (
                f'{servo} pulled its tendon in by {1e3 * travel:.1f} mm without a tension of '
                f'{self._tension:g} N (dynamixel.take_up_tension): hook it in, take up slack by '
                'hand, or check dynamixel.signs and dynamixel.torque_constants')
            return
        ahead = self._goal + TAKE_UP_SPEED * min(now - self._stepped, 0.03) / scale
        most = state.position + TAKE_UP_LEAD / scale
        self._goal = min(ahead, most) if scale > 0.0 else max(ahead, most)
        self._stepped = now
        self.goals[at] = round(self._goal)
