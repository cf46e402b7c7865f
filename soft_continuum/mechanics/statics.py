# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Statics of the arm: the shape in which springs, weights, wrenches and tendons balance.

The paper integrates its multibody model for 10 s with a backward Euler solver and uses the end
state only.  Here that end state is solved directly: a minimum of the potential energy subject to
the tendon lengths, whose Lagrange multipliers are the tensions (a tendon pulls or is slack).

Equilibria depend on the path, so every solve starts from the previous state.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics import kinds
from soft_continuum.mechanics._checks import (
    bending_of,
    check_pretension,
    finite,
    listed,
    sliding_signs,
    soft_flags,
    tensions_of,
    whole,
)
from soft_continuum.mechanics.arm import Arm, Array, check_arm
from soft_continuum.mechanics.chain import Batch, Chain, check_start, Equilibrium, SLACK

Booleans = NDArray[np.bool_]
LOCKED_TOLERANCE = 1e-6  # m: rounding of a pull against a locked arm
SLACK_ALLOWANCE = 1e-4
"""m of pull absorbed by rope and guides; inextensible tendons would buckle the modelled arm."""

PRETENSIONS = (0.0, 0.3)
"""Pretensions, N, tried in order to hold a bending of a spatial arm."""


class StaticsError(RuntimeError):
    """
    No equilibrium was found.

    ``state`` is the last accepted Equilibrium on the path.
    """

    def __init__(self, message: str, state: Equilibrium) -> None:
        """Keep the state at which the search ended."""
        super().__init__(message)
        self.state = state


class OverconstrainedError(StaticsError):
    """The tendons are pulled in farther than any shape of the soft segments allows."""


@dataclass(frozen=True, eq=False)
class HeldBending:
    """
    A state with the commanded bending of soft segments, and the pulls of the motors.

    pulls: (tendons,) m at the motors, stretch included, SLACK for a tendon that does not carry.
    """

    state: Equilibrium
    pulls: Array

    def eased(self, slack: float, all_slack: float = SLACK_ALLOWANCE) -> Array:
        """
        Return the pulls of the motors, m, with slack (m) in tendons that do not carry.

        all_slack: of all tendons where none carries: all hold the arm, and just taut they fight.
        """
        carries = self.pulls != SLACK
        eased = self.state.pulls - (slack if carries.any() else all_slack)
        return np.where(carries, self.pulls, eased)


@dataclass(frozen=True)
class Problems:
    """
    The problems to solve; each field is shared by all or has ``count`` rows.

    pulls, tensions: m and N, as in Statics.solve, the latter with nan.  ways: sliding.  friction:
    the largest coefficient of the tendons.
    """

    models: Sequence[Any]
    starts: Sequence[Equilibrium]
    masks: Sequence[Sequence[bool]]
    pulls: Array
    tensions: Array
    vacuum: Sequence[Sequence[float] | None]
    ways: Sequence[tuple[int, ...]]
    friction: float
    count: int

    @property
    def rub(self) -> NDArray[np.bool_]:
        """Whether tendons slide with friction, (count,)."""
        return np.broadcast_to(np.any(self.ways, axis=1) & (self.friction > 0.0), self.count)

    def solve(self, i: int) -> Equilibrium:
        """Return the equilibrium of one of them; raises what Statics.solve raises."""
        tensions = self.tensions[i % len(self.tensions)]
        found: Equilibrium = self.models[i % len(self.models)].solve(
            self.starts[i % len(self.starts)], self.pulls[i % len(self.pulls)],
            self.masks[i % len(self.masks)],
            tensions=None if np.isnan(tensions).all() else tensions,
            vacuum=self.vacuum[i % len(self.vacuum)], sliding=self.ways[i % len(self.ways)])
        return found


class Statics:
    """
    Equilibria of one arm; planar arms are solved in their plane.

    ``soft`` masks have one flag per segment.  Softening returns the springs of a segment to their
    natural shape.  Stiffening locks it (paper, III-A) or, with a Jam of finite stiffness, adds
    the jam's springs about the shape at that time; neither moves the arm.
    compliance: of the tendons without friction, (tendons,) m/N.  precision: rad, error at which a
    bending counts as reached, and error accepted when no step reduces it.
    late_imports: modules that are loaded when a solve first needs them.
    Raises ArmError for what is not an Arm.
    """

    chain: Chain
    compliance: Array
    precision: tuple[float, float] = (1e-8, 1e-5)
    late_imports: tuple[str, ...] = ()

    def __new__(cls, arm: Arm) -> Self:
        """Create the subclass for the arm."""
        kind: type[Any] = cls
        check_arm(arm)
        if cls is Statics:
            kind = kinds.subclass('Statics', arm.planar)
        made: Self = super().__new__(kind)
        return made

    def __init__(self, arm: Arm) -> None:
        """Discretise ``arm`` and prepare the arrays of the solver."""
        raise NotImplementedError

    def solve(self, start: Equilibrium, pulls: ArrayLike, soft: Sequence[bool], *,
              tensions: ArrayLike | None = None, vacuum: Sequence[float] | None = None,
              sliding: Sequence[int] = ()) -> Equilibrium:
        """
        Return the equilibrium for given pulls, followed from ``start``.

        pulls: (tendons,) m, shortening of each tendon relative to the straight arm; negative is
        paid out, SLACK never carries.  soft: one flag per segment.  tensions: (tendons,) N for
        tendons with a given force instead, nan for others (default: none).
        vacuum: of each stiff segment, 0 to 1 of full vacuum (default: full); with 0 it is soft,
        and rigid jams accept only 0 or 1.  sliding: direction of each tendon through its guides,
        for friction: 1 towards the base, -1 towards the tip, 0 frictionless (default: all 0).

        Raises OverconstrainedError when no shape has tendons that short, StaticsError when no
        equilibrium was found, ValueError for input of the wrong size or nan.
        """
        raise NotImplementedError

    def solve_eased(self, start: Equilibrium, pulls: ArrayLike, soft: Sequence[bool], *,
                    vacuum: Sequence[float] | None = None, sliding: Sequence[int] = ()
                    ) -> Equilibrium:
        """
        Return the equilibrium of ``solve`` for pulls that a motor has rounded.

        With inextensible tendons that are all a micrometre too short, by rounding of steppers,
        the arm would buckle.  Up to SLACK_ALLOWANCE one is slackened, if possible the one that
        carries least.
        """
        state = self.solve(start, pulls, soft, vacuum=vacuum, sliding=sliding)
        if np.all(state.tensions > 0.0) and not self.compliance.any():
            for tendon in np.argsort(state.tensions):
                eased = np.array(pulls)
                eased[tendon] -= SLACK_ALLOWANCE
                other = self.solve(start, eased, soft, vacuum=vacuum, sliding=sliding)
                if not other.tensions[tendon] > 0.0:
                    return other
        return state

    def solve_tensions(self, start: Equilibrium, tensions: ArrayLike, soft: Sequence[bool], *,
                       vacuum: Sequence[float] | None = None, sliding: Sequence[int] = ()
                       ) -> Equilibrium:
        """
        Return the equilibrium for given tensions (tendons,), N >= 0, followed from ``start``.

        The other arguments and errors are those of ``solve``.
        """
        return self.solve(start, np.zeros(len(self.compliance)), soft, vacuum=vacuum,
                          sliding=sliding,
                          tensions=tensions_of(tensions, len(self.compliance)))

    def bend(self, start: Equilibrium, segment: int, angle: float,
             soft: Sequence[bool] | None = None, *, vacuum: Sequence[float] | None = None,
             sliding: Sequence[int] = ()) -> Equilibrium:
        """
        Return the equilibrium in which ``segment`` (0-based) is bent by ``angle`` (rad) about y.

        In a planar arm one tendon carries, as the loads require (if either can, the one on the
        side to which the segment turns), and the other follows without tension; in a spatial arm
        pulls_for_bending chooses.  The result has the pulls of all paths.  By default only
        ``segment`` is soft.  vacuum: as in ``solve``, but by default that of ``start``.
        sliding: as in ``solve``; ignored for spatial arms.  Raises StaticsError when no tendon
        holds the arm there in a stable way.
        """
        raise NotImplementedError

    def _bent(self, start: Equilibrium, segment: int, angle: float, soft: Sequence[bool] | None,
              vacuum: Sequence[float] | None, sliding: Sequence[int]
              ) -> tuple[Sequence[bool], Sequence[float] | None]:
        """Return which segments are soft, and the vacuum, for ``bend``; raises ValueError."""
        check_start(start)
        sliding_signs(sliding, len(self.compliance))
        number = int(segment) if whole(segment) else -1
        mask = (tuple([i == number for i in range(self.chain.segments)]) if soft is None
                else soft_flags(soft, self.chain.segments))
        if not (0 <= number < self.chain.segments and mask[number]):
            raise ValueError(f'segment index {segment} is not one of the soft segments; '
                             f'soft: {list(mask)}')
        if vacuum is None:
            vacuum = start.vacuum or None
        if not finite(angle):
            raise ValueError(
                f'the bending angle must be a finite number in rad; given: {angle!r}')
        return mask, vacuum

    def hold(self, start: Equilibrium, bending: Array, soft: Sequence[bool], *,
             sliding: Sequence[int] = (), pretensions: Sequence[float] = PRETENSIONS
             ) -> HeldBending:
        """
        Return the state in which soft segments have their bending, and the pulls that hold it.

        bending: (segments, 2) rad about x and y; used for soft segments, about axes of finite
        stiffness.  The vacuum is that of ``start``.  sliding: as in ``solve``; ignored for
        spatial arms, whose tendons are frictionless here.  pretensions: N, tried in order; an arm
        that would fall over under its load needs tension on all sides.  Ignored for planar arms,
        in which one tendon carries.  Raises StaticsError.
        """
        raise NotImplementedError

    def _wanted(self, start: Equilibrium, bending: ArrayLike, soft: Sequence[bool],
                sliding: Sequence[int], pretensions: Sequence[float]
                ) -> tuple[Array, tuple[bool, ...]]:
        """Return bending and which segments are soft, for ``hold``; raises ValueError."""
        check_start(start)
        sliding_signs(sliding, len(self.compliance))
        mask = soft_flags(soft, self.chain.segments)
        if not any(mask):
            raise ValueError(f'one segment or more must be soft; given: {soft!r}')
        if not listed(pretensions):
            raise ValueError(f'pretensions must be one number (N) or more; given: {pretensions!r}')
        for pretension in pretensions:
            check_pretension(pretension)
        return bending_of(bending, self.chain.segments), mask

    def sliding_towards(self, change: Array, /) -> tuple[int, ...]:
        """
        Return sliding, as for solve, while bending (segments, 2) changes, rad.

        For spatial arms it is unknown and all are 0.
        """
        raise NotImplementedError

    def stretch_rates(self, state: Equilibrium, sliding: Sequence[int]) -> Array:
        """Return the compliance of each tendon for the tension at the base, (tendons,), m/N."""
        raise NotImplementedError

    def solve_together(self, given: Problems, /) -> Batch:
        """Return a batch with the equilibria that compiled code finds, on all cores."""
        raise NotImplementedError

    def commanded_pulls(self, state: Equilibrium, sliding: Sequence[int] = ()) -> Array:
        """Return the pulls (tendons,) m at the motors that give a state: paths and stretch."""
        rates = self.stretch_rates(state, sliding)
        pulls: Array = state.pulls + rates * np.nan_to_num(state.tensions)
        return pulls

    def _locked(self, start: Equilibrium, by_force: Booleans, target: Array) -> Equilibrium:
        """
        Return the state of a rigid arm: its tendons stretch, become slack, or cannot be pulled.

        start: with the new stiff segments.  target: (tendons,) m, pulls, or N of those by force.
        """
        short = np.where(by_force, 0.0, target - start.pulls)
        self._refuse_short(short, start)
        stretches = self.compliance > 0.0
        stretched = np.maximum(0.0, short) / np.where(stretches, self.compliance, 1.0)
        # The tension of a taut, inextensible tendon is undetermined.
        found = np.where(stretches, stretched, np.where(short < -LOCKED_TOLERANCE, 0.0, np.nan))
        return replace(start, slack=np.maximum(0.0, -short), residual=0.0, iterations=0,
                       tensions=np.where(by_force, target, found), jumped=False)

    def _refuse_short(self, short: Array, start: Equilibrium) -> None:
        """Raise OverconstrainedError for tendons that are too short (m) in a rigid arm."""
        beyond = np.where(self.compliance > 0.0, 0.0, short)
        if beyond.max(initial=0.0) > LOCKED_TOLERANCE:
            worst = int(np.argmax(beyond))
            raise OverconstrainedError(
                f'every segment that {self.chain.arm.tendon_names[worst]} passes is stiff and '
                f'rigid, so it cannot be pulled in by another {1e3 * beyond[worst]:.3f} mm; '
                'soften a segment first', start)


def driven(pulls: Array, tensions: Array | None) -> tuple[Booleans, Array, Booleans]:
    """
    Return which tendons have a given force, and tensions (N) of these, pulls (m) of the others.

    And which never carry.  pulls, tensions: (…, tendons), as for Statics.solve; all results have
    this shape.
    """
    never = pulls == SLACK
    target = np.where(never, 0.0, pulls)
    if tensions is None:
        return never, target, never
    given = ~np.isnan(tensions)
    return given | never, np.where(given, tensions, target), never & ~given
