"""Samples a linear problem with checkpoints in a folder: python sample_forever.py FOLDER STEPS; to be killed."""

import sys
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
from chains import linear_problem  # noqa: E402

from ident.inference.fit import fit  # noqa: E402
from ident.inference.posterior import posterior  # noqa: E402
from ident.inference.sample import Settings, sample  # noqa: E402

folder, steps = Path(sys.argv[1]), int(sys.argv[2])
problem, _, _ = linear_problem()
found = fit(problem, starts=1)
print("sampling", flush=True)
settings = Settings(walkers=12, max_steps=steps, target_ess=1e12)
np.save(folder.with_suffix(".npy"), sample(found, posterior(problem), settings, folder=folder).theta)
