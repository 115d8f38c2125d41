"""A conic problem for Clarabel, solved in one thread; Ctrl-C ends it.

What Clarabel says is never asked: who calls rounds its numbers to rationals and checks them exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any


def solve(
    linear: Any,
    matrix: Any,
    offset: Any,
    cones: Sequence[Any],
    decided: Callable[[Any], bool] | None = None,
    **settings: Any,
) -> Any:
    """Minimise ``linear' x`` with ``offset - matrix x`` in the cones.

    Parameters
    ----------
    linear, matrix, offset, cones
        Shapes (n,), sparse (m, n) and (m,); Clarabel's cones, of m rows in all.
    decided
        Whether it may stop, asked once an iteration with Clarabel's record of it; None for never before the end.
    settings
        Further ones by Clarabel's names.

    Returns
    -------
    clarabel.DefaultSolution
    """
    import clarabel  # noqa: PLC0415 - it takes its time to load
    from scipy import sparse  # noqa: PLC0415

    chosen = clarabel.DefaultSettings()
    chosen.verbose = False
    chosen.max_threads = 1
    chosen.presolve_enable = False
    chosen.direct_solve_method = "faer"  # 4 to 10 times faster than the default from degree 6 on
    for name, value in settings.items():
        setattr(chosen, name, value)
    none = sparse.csc_matrix((len(linear), len(linear)))
    solver = clarabel.DefaultSolver(none, linear, matrix, offset, list(cones), chosen)
    interrupt = _Interrupt()
    if decided is not None:
        solver.set_termination_callback(interrupt.guarded(decided))
    solution = solver.solve()
    interrupt.reraise()
    return solution


class _Interrupt:
    """Clarabel swallows what its callback raises, Ctrl-C too: it is kept and raised after the solve."""

    def __init__(self) -> None:
        self._raised: BaseException | None = None

    def guarded(self, decided: Callable[[Any], bool]) -> Callable[[Any], bool]:
        def callback(info: Any) -> bool:
            try:
                return decided(info)
            except BaseException as error:
                self._raised = error
                return True

        return callback

    def reraise(self) -> None:
        if self._raised is not None:
            raise self._raised
