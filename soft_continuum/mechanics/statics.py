# Copyright 2026 The soft_continuum authors
# SPDX-License-Identifier: Apache-2.0
"""
Statics of the arm: the shape in which springs, weights, wrenches and tendons balance.

The paper integrates its multibody model for 10 s with a backward Euler solver and uses the end
state only.  Here that end state is solved for: a minimum of the potential energy under the lengths
of the tendons, whose Lagrange multipliers are the tensions (a tendon pulls or is slack).

Equilibria depend on the path, so every solve starts from the state before it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from soft_continuum.mechanics import _kernel
from soft_continuum.mechanics._checks import finite, soft_flags, tensions_of, whole
from soft_continuum.mechanics.arm import Arm, Array
from soft_continuum.mechanics.chain import Chain, check_start, Equilibrium, SLACK
from soft_continuum.mechanics.errors import OverconstrainedError

if TYPE_CHECKING:
    from soft_continuum.mechanics.batch import Batch, Problems

Booleans = NDArray[np.bool_]
LOCKED_TOLERANCE = 1e-6  # m: rounding of a pull against a locked arm
SLACK_ALLOWANCE = 1e-4
"""m of pull that rope and guides absorb; the model's inextensible tendons would buckle the arm."""

PRETENSIONS = (0.0, 0.3)
"""N that tendons carry at least, tried in turn to hold a bending in space."""


@dataclass(frozen=True, eq=False)
class HeldBending:
    """
    A state in which soft segments bend as is wanted, and what the motors do for it.

    pulls: (tendons,) m at the motors, stretch included, SLACK for a tendon that does not carry.
    """

    state: Equilibrium
    pulls: Array


class Statics:
    """
    Equilibria of one arm; those of a planar arm are solved for in its plane.

    ``soft`` masks have one flag per segment.  Softening returns the springs of a segment to their
    natural shape.  Stiffening locks it (paper, III-A) or, with a Jam of finite stiffness, adds
    the jam's springs about the shape at which it was stiffened; either way it moves nothing.
    compliance: of the tendons where nothing rubs, (tendons,) m/N.  precision: rad by which a
    segment that has its bending may miss it, and by which one may that comes no nearer.
    late_imports: modules that are loaded when a solve first needs them.
    """

    chain: Chain
    compliance: Array
    precision: tuple[float, float] = (1e-8, 1e-5)
    late_imports: tuple[str, ...] = ()

    def __new__(cls, arm: Arm) -> Self:
        """Make one of the kind of the arm."""
        kind: type[Any] = cls
        if cls is Statics:
            if arm.planar:
                from soft_continuum.mechanics.plane.statics import PlaneStatics as kind
            else:
                from soft_continuum.mechanics.space.statics import SpaceStatics as kind
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

        pulls: (tendons,) m, how much shorter each tendon is than in the straight arm; negative is
        paid out, SLACK never carries.  soft: one flag per segment.  tensions: (tendons,) N of
        tendons that are pulled by a force instead, nan for those that are not (default: none).
        vacuum: of each stiff segment, 0 to 1 of full vacuum (default: full); without any it is
        soft, and a rigid one knows no other parts.  sliding: of each tendon through its guides,
        for friction: 1 towards the base, -1 towards the tip, 0 frictionless, as all are by
        default.

        Raises OverconstrainedError when no shape has tendons that short, StaticsError when no
        equilibrium was found, ValueError for input of the wrong size or nan.
        """
        raise NotImplementedError

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

        In the plane one tendon carries it, whichever the loads ask for (if either can, that of the
        side to which the segment turns), and the other follows without tension; in space those do
        that pulls_for_bending finds.  The pulls of all paths are in the result.  Only ``segment``
        is soft unless ``soft`` says otherwise.  vacuum: as in ``solve``, but by default that of
        ``start``.  sliding: as in ``solve``; in space of no use.  Raises StaticsError when no
        tendon holds the arm there in a stable way.
        """
        raise NotImplementedError

    def _bent(self, start: Equilibrium, segment: int, angle: float, soft: Sequence[bool] | None,
              vacuum: Sequence[float] | None) -> tuple[Sequence[bool], Sequence[float] | None]:
        """Return which segments are soft, and the vacuum, for ``bend``; raises ValueError."""
        check_start(start)
        mask = soft_flags([i == segment for i in range(self.chain.segments)]
                          if soft is None else soft, self.chain.segments)
        if not (whole(segment) and 0 <= segment < self.chain.segments and mask[segment]):
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

        bending: (segments, 2) rad about x and y, of which that of soft segments counts, about the
        axes about which they bend; the vacuum is that of ``start``.  sliding: as in ``solve``; in
        space of no use, since tendons do not rub here.  pretensions: of which the first counts
        that holds the arm: what would fall over by its load needs tendons to all sides; in the
        plane of no use, since one tendon carries.  Raises StaticsError.
        """
        raise NotImplementedError

    def sliding_towards(self, change: Array, /) -> tuple[int, ...]:
        """
        Return how tendons slide, as of a solve, while bending (segments, 2) changes, rad.

        In space it is not known, so none does.
        """
        raise NotImplementedError

    def stretch_rates(self, state: Equilibrium, sliding: Sequence[int]) -> Array:
        """Return by how much each tendon stretches per N at the base, (tendons,), m/N."""
        raise NotImplementedError

    def solve_together(self, problems: 'Problems') -> 'Batch':
        """Return a batch with what compiled code finds of problems on all cores."""
        raise NotImplementedError

    def commanded_pulls(self, state: Equilibrium, sliding: Sequence[int] = ()) -> Array:
        """Return the pulls (tendons,) m at the motors that give a state: paths and stretch."""
        pulls: Array = state.pulls + self.stretch_rates(state, sliding) * np.nan_to_num(
            state.tensions)
        return pulls

    def _locked(self, start: Equilibrium, by_force: Booleans, target: Array) -> Equilibrium:
        """
        Return a wholly rigid arm: its tendons stretch, become slack, or cannot be pulled.

        start: with the segments that are stiff from now on.  target: (tendons,) m, pulls, or N of
        those by force.
        """
        short = np.where(by_force, 0.0, target - start.pulls)
        self._refuse_short(short, start)
        stretches = self.compliance > 0.0
        stretched = np.maximum(0.0, short) / np.where(stretches, self.compliance, 1.0)
        # Nothing determines what one carries that neither stretches nor is slack.
        found = np.where(stretches, stretched, np.where(short < -LOCKED_TOLERANCE, 0.0, np.nan))
        return replace(start, slack=np.maximum(0.0, -short), residual=0.0, iterations=0,
                       tensions=np.where(by_force, target, found), jumped=False)

    def _refuse_short(self, short: Array, start: Equilibrium) -> None:
        """Refuse tendons (tendons,) that are too short (m) where nothing can bend or stretch."""
        beyond = np.where(self.compliance > 0.0, 0.0, short)
        if beyond.max(initial=0.0) > LOCKED_TOLERANCE:
            worst = int(np.argmax(beyond))
            raise OverconstrainedError(
                f'every segment that {self.chain.arm.tendon_names[worst]} passes is stiff and '
                f'rigid, so it cannot be pulled in by another {1e3 * beyond[worst]:.3f} mm; '
                'soften a segment first', start)


def driven(pulls: Array, tensions: Array | None) -> tuple[Booleans, Array]:
    """
    Return which tendons a force pulls, and tensions (N) of these and pulls (m) of the others.

    pulls, tensions: (…, tendons), as of Statics.solve; so are both that are returned.
    """
    never = pulls == SLACK
    target = np.where(never, 0.0, pulls)
    if tensions is None:
        return never, target
    given = ~np.isnan(tensions)
    return given | never, np.where(given, tensions, target)


def warm_up() -> None:
    """
    Build the compiled solver, or load it, now rather than in the first solve.

    It takes up to a minute once, and some milliseconds later.
    """
    _kernel.functions()
