"""The last way to an optimum that Levenberg-Marquardt nears but slowly: where residuals are large and bend."""

import numpy as np
from jaxtyping import Float

from ident.inference.convergence import SEVERAL, SHORT, Convergence, convergence, weighed
from ident.inference.least_squares import End, look
from ident.inference.problem import InverseProblem

WALL = 1e3
"""Times the cost at the start that counts where the model has no answer."""
ITERATIONS = 200
"""Iterations at most."""


def ended(problem: InverseProblem, end: End) -> tuple[End, Convergence]:
    """Return where a search ended, and how; one that has not ended goes on by quasi-Newton steps.

    Gauss-Newton leaves the residuals' own bend out. Where they are large, as in a poor optimum or where two modes
    cross, its steps then take the rest of the way by a constant factor only; BFGS learns the bend from the gradients.
    """
    how = convergence(problem, end)
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

    options = {"gtol": SHORT / 10, "norm": 2, "maxiter": ITERATIONS}
    found = minimize(half_cost, np.zeros(len(s)), jac=True, method="BFGS", options=options)
    return look(problem, end.theta + ways @ found.x, end.choice.held)
