"""`ident diagnose` with few of everything: what is tested is the way through. As a program it can be killed."""

import numpy as np

from ident import cli
from ident.assess import remedies, task
from ident.cli import diagnose
from ident.vibrate.redesign.search import Effort

SMALL = {
    (diagnose, "ESS"): 100.0,
    (diagnose, "DRAWS"): 30,
    (diagnose, "FEW"): 4,
    (task, "SEEN"): 10,
    (remedies, "SPEEDS"): np.array([0.5, 1.25]),
    (remedies, "FEW"): 4,
    (remedies, "TRIED"): 5,
    (remedies, "EFFORT"): Effort(screened=4, iterations=4),
}

if __name__ == "__main__":
    for (module, name), value in SMALL.items():
        setattr(module, name, value)
    cli.main()
