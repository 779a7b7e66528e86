"""Compute an arm's static equilibrium and its mode shapes by kept programs, in a process of its own.

`python kept_program.py CACHE`: prints the numbers' hash, how often jax has traced, and which programs there are.
"""

import hashlib
import json
import sys

import jax
import numpy as np
from arms import lcd_arm

from ident.arm.chain import at_posture
from ident.arm.mechanics import static_equilibrium
from ident.arm.modes import modes
from ident.programs import jit, own_folder

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_compilation_cache_dir", sys.argv[1])
events: list[str] = []
jax.monitoring.register_event_duration_secs_listener(lambda event, _, **more: events.append(event))
chain = at_posture(lcd_arm(), np.array([0.1, -0.2, 0.1]))
before = len([event for event in events if "jaxpr_trace" in event])
statics = jit(static_equilibrium)
found = [statics(chain), statics(chain), jit(modes)(chain)]
jit(lambda x: 2 * x)(np.ones(2))
leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(found)]
folder = own_folder()
print(
    json.dumps(
        {
            "numbers": hashlib.sha256(b"".join(leaf.tobytes() for leaf in leaves)).hexdigest(),
            "trees": [str(jax.tree.structure(each)) for each in found],
            "traced": len([event for event in events if "jaxpr_trace" in event]) - before,
            "kept": sorted(path.name for path in folder.iterdir()) if folder else None,
        }
    )
)
