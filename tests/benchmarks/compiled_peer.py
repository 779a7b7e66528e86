"""The same predictions by compiled C++: Pinocchio's headers and Eigen (`compiled_peer.cpp`), built here by the compiler
of this machine; needs `pip install cmeel-eigen`, as Pinocchio's wheel brings no Eigen.
"""

import ctypes
import importlib.util
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

import numpy as np
import pinocchio as pin
from engines import PinocchioArm

from ident.arm.arm import Arm

FLAGS = ("-O3", "-march=native", "-DNDEBUG", "-std=c++17", "-shared", "-fPIC", "-w", "-Wl,-Bsymbolic")
BOOST = ("-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "-DBOOST_MPL_LIMIT_LIST_SIZE=30")
"""Pinocchio has more kinds of joints than Boost lists by default."""
SOURCE = Path(__file__).with_suffix(".cpp")


def build() -> ctypes.CDLL | str:
    """Return the compiled library, or why there is none."""
    compiler = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    include = Path(importlib.util.find_spec("pinocchio").origin).parents[4] / "include"  # type: ignore[union-attr, arg-type]
    if compiler is None:
        return "no C++ compiler"
    if not (include / "eigen3").exists():
        return "no Eigen: pip install cmeel-eigen"
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "peer.so"
        headers = ("-I", str(include), "-isystem", str(include / "eigen3"))
        line = (compiler, *FLAGS, *BOOST, *headers, str(SOURCE), "-o", str(library))
        subprocess.run(line, check=True)
        return ctypes.CDLL(str(library))


def doubles(x: Any) -> Any:
    return np.ascontiguousarray(x, float).ctypes.data_as(ctypes.POINTER(ctypes.c_double))


class CompiledPeer:
    """A held arm of three joints in C++; one call takes all stiffness sets, one after the other on one thread."""

    def __init__(self, library: ctypes.CDLL, arm: Arm, posture: np.ndarray):
        engine = PinocchioArm(arm, posture)
        at, model = engine.data.oMi, engine.model
        # Pinned joints turn with the ball joint before them: their bodies and the end are moved into its frame.
        turning = [range(i, j) for i, j in zip(engine.shafts, [*engine.shafts[1:], model.njoints], strict=True)]
        steps = [at[i].actInv(at[j]) for i, j in zip([0, *engine.shafts], engine.shafts, strict=False)]
        inertias = [
            sum((at[r[0]].actInv(at[i]).act(model.inertias[i]) for i in r), pin.Inertia.Zero()) for r in turning
        ]
        places = [np.r_[step.rotation.ravel(), step.translation] for step in steps]
        bodies = [np.r_[y.mass, y.lever, y.inertia.ravel()] for y in inertias]
        end = at[engine.shafts[-1]].actInv(at[engine.end_joint].act(engine.end))
        library.held.restype = ctypes.c_void_p
        self.library = library
        self.arm = ctypes.c_void_p(
            library.held(doubles(places), doubles(bodies), doubles(model.gravity.linear), doubles(end))
        )

    def __call__(self, stiffness: np.ndarray, modes: int) -> np.ndarray:
        """Hertz and drop [m] (modes + 1, count) of the ball joints' stiffnesses (9, count)."""
        count = stiffness.shape[-1]
        out = np.empty((modes + 1, count))
        self.library.predict(self.arm, doubles(stiffness), count, modes, doubles(out))
        return out
