"""Whether a sampler killed at any moment comes to the same chain: `python tests/benchmarks/killed.py [--kills 20]`."""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "support"))

from kills import killed_and_alone

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20, help="so many moments")
    parser.add_argument("--seed", type=int, default=4, help="of the moments")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        killed, alone = killed_and_alone(Path(folder), options.kills, options.seed)
    same = "the same to the bit" if np.array_equal(killed, alone) else "NOT the same"
    print(f"killed {options.kills} times, {len(killed)} steps: {same}")
