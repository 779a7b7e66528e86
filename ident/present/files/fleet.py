"""A fleet as rows, and as priors for the next robot."""

from typing import Any

import numpy as np

from ident.identify.fleet import Fleet
from ident.present.text.units import unit_of


def fleet_rows(fleet: Fleet) -> list[dict[str, Any]]:
    """Return a row for each member and stiffness: own and shrunk estimate, and how far it is from the others."""
    population, judged = fleet.population, fleet.deviations
    if population is None or judged is None:
        return []
    middle = population.next_mean
    return [
        {
            "robot": fleet.robots[place].name,
            "parameter": name,
            "unit": unit_of(name),
            "own": float(np.exp(fleet.robots[place].theta[i])),
            "own_sd_log": float(fleet.robots[place].sd[i]),
            "shrunk": float(np.exp(population.robot_mean[r, i])),
            "shrunk_sd_log": float(population.robot_sd[r, i]),
            "against_fleet_log": float(population.robot_mean[r, i] - middle[i]),
            "against_others_log": float(judged.difference[r, i]),
            "healthy_sd_log": float(judged.sd[r, i]),
            "chance_if_healthy": float(judged.p[r, i]),
            "stands_out": i in fleet.standing_out.get(r, ()),
        }
        for r, place in enumerate(fleet.members)
        for i, name in enumerate(fleet.names)
    ]


def fleet_priors(fleet: Fleet) -> dict[str, str]:
    """Return the population's prediction of the next healthy robot as log-normal priors [SI], by stiffness."""
    if fleet.population is None:
        return {}
    ends = zip(fleet.names, np.exp(fleet.population.next_mean), fleet.population.next_sd, strict=True)
    return {name: f"log-normal:{median:.6g}:{sd:.3g}" for name, median, sd in ends}
