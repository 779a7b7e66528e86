"""The last way to an optimum that Levenberg-Marquardt nears but slowly, or from a place where it gets stuck."""

import numpy as np
from jaxtyping import Float

from ident.inference.convergence import OPTIMUM_STEP, SEVERAL, Convergence, convergence, weighed
from ident.inference.least_squares import End, look, solve
from ident.inference.problem import InverseProblem

WALL = 1e3
"""Times the cost at the start that counts where the model has no answer."""
ITERATIONS = 200
"""Iterations at most."""
AGAIN = 4
"""Times at most that a search which got stuck begins anew."""


def ended(problem: InverseProblem, end: End) -> tuple[End, Convergence]:
    """Return where a search ended, and how; one that got stuck goes on until it ends, or is as it was.

    Gauss-Newton leaves the residuals' own bend out. Where they are large, as in a poor optimum or where two modes
    cross, its steps then take the rest of the way by a constant factor only; BFGS learns the bend from the gradients.
    Where it gets no further either, as where what the values belong to changes with every step downhill, the search
    begins anew half the way towards the parameters' own start.
    """
    stuck = here = end, convergence(problem, end)
    first = problem.parameters.theta(problem.parameters.column("start"))
    for _ in range(AGAIN):
        here = _finished(problem, *here)
        if here[1].converged or not np.isfinite(here[0].cost):
            break
        nearer = solve(problem, (here[0].theta + first) / 2)
        here = nearer, convergence(problem, nearer)
    return here if here[1].converged else stuck


def _finished(problem: InverseProblem, end: End, how: Convergence) -> tuple[End, Convergence]:
    """Go on by quasi-Newton steps from an end that is none; the same end where that does not end either."""
    if how.converged or not np.isfinite(how.step):
        return end, how
    lower = _descended(problem, end)
    then = convergence(problem, lower)
    return (lower, then) if then.converged and lower.cost <= end.cost else (end, how)


def _descended(problem: InverseProblem, end: End) -> End:
    """Minimise half the cost from there, in coordinates of one standard deviation each, with the choice held."""
    from scipy.optimize import minimize  # long to import, and most fits need none

    _, s, Vt = np.linalg.svd(weighed(problem, end)[1], full_matrices=False)
    ways = Vt.T / np.maximum(s, 1 / SEVERAL)

    def half_cost(x: Float[np.ndarray, "P"]) -> tuple[float, Float[np.ndarray, "P"]]:
        there = look(problem, end.theta + ways @ x, end.choice.held)
        if not np.isfinite(there.cost):
            return WALL * float(end.cost), np.zeros_like(x)
        return float(there.cost) / 2, ways.T @ there.gradient / 2

    options = {"gtol": OPTIMUM_STEP / 10, "norm": 2, "maxiter": ITERATIONS}
    found = minimize(half_cost, np.zeros(len(s)), jac=True, method="BFGS", options=options)
    return look(problem, end.theta + ways @ found.x, end.choice.held)
