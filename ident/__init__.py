"""ident: joint stiffness of serial robot arms from natural frequencies and static deflection.

In the order of use; every study is one function that returns one frozen result. `print(result)` prints its report,
`result.figures()` draws it, `result.table()` gives rows, `result.save(path)` writes it and `load(path)` brings it back.

    read_arm        an arm from its file: TOML, or URDF or MJCF with a file of joint stiffness beside it
    read_urdf       an arm from a URDF file, completed with joint stiffness
    read_mjcf       an arm from an MJCF file, completed with joint stiffness
    read_campaign   natural frequencies, static deflections and damping ratios from a CSV file
    read_log        a joint path as a robot controller logs it
    read_trace      a measured vibration
    modal_test      modes with their covariance, and a campaign, from the files of a hammer test
    show            an arm drawn, and what looks odd about its numbers
    predict         natural frequencies, modes and static deflection at postures
    check           what a campaign can tell about each parameter, before any solving
    fit             joint stiffnesses from a campaign, and what the data support
    profile         profile likelihood: are the intervals of the fit right?
    sample          the posterior: how sure each stiffness is, and which combinations are known
    validate        how far a fitted arm may be trusted where it was not measured
    plan            what to measure next, by what it would tell for its cost
    compare         which joint stiffness has changed between two campaigns
    fleet           many robots of one design: how stiffnesses spread, and who stands out
    resonance       pulley frequencies against natural frequencies along a motion
    simulate        how far the end point vibrates while the arm carries out a motion
    spectrum        at which frequencies a trace vibrates
    sweep           how the vibration depends on numbers of the arm, or on its speed
    triage          what makes a measured vibration: a drive, a mode, a fixed line
    source          what excites the moving arm: imbalance and transmission error of each drive
    balance         which mass on which pulley balances the drives, and what is left of the vibration
    joint           stiffness, friction, backlash and delay of a joint from logs of its motor and link
    motion          how fast to go along the path so that the arm keeps a limit, no part changed
    design          what to change so that the arm vibrates least
    variants        up to eight arms, designs or fitted robots with one motion, side by side
    explore         a page with sliders: what the arm does when a number is changed
    diagnose        all of it, from a campaign to advice
    export          what was identified, in the robot's own description: MJCF, URDF, arm file, or JSON
    load            a result that was saved
    rerun           the same again, and whether the numbers are the same
    hand_over       a result as one page, in HTML or PDF
    bind            several saved results as one page, with a first page to sign

The first name that is used switches jax to double precision, for the whole process: the mechanics need it, and jax
has single precision otherwise. Arrays that the process has made before stay as they are.
"""

import sys

if (
    sys.argv[:1] == ["-m"]
    and sys.orig_argv[-len(sys.argv) :][:1] in (["ident"], ["-mident"])
    and not sys.flags.safe_path
):
    del sys.path[0]  # `python -m ident` looks for modules in the current folder first: nothing there is executed

import difflib
import importlib
from typing import TYPE_CHECKING, Any

from ident.errors import ConvergenceError, IdentError, InputError, ModelError
from ident.studies import MODULES

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile, read_arm
    from ident.description.mjcf import read_mjcf
    from ident.description.urdf import read_urdf
    from ident.measure import Campaign, Load, Log, Measurement, Trace, read_campaign, read_log, read_trace
    from ident.studies.bind import Bound, bind
    from ident.studies.cause.source import SourceOptions, SourceResult, source
    from ident.studies.cause.triage import TriageOptions, TriageResult, triage
    from ident.studies.cure.balance import BalanceOptions, BalanceResult, balance
    from ident.studies.cure.design import DesignOptions, DesignResult, design
    from ident.studies.cure.diagnose import DiagnoseOptions, DiagnoseResult, diagnose
    from ident.studies.cure.motion import MotionOptions, MotionResult, motion
    from ident.studies.cure.variants import VariantsOptions, VariantsResult, variants
    from ident.studies.handout import hand_over
    from ident.studies.look.explore import ExploreOptions, ExploreResult, explore
    from ident.studies.look.export import export
    from ident.studies.look.predict import PredictOptions, PredictResult, predict
    from ident.studies.look.show import ArmPicture, show
    from ident.studies.measuring.modal import ModalOptions, ModalResult, modal_test
    from ident.studies.rerun import Rerun, rerun
    from ident.studies.saved import Saved, load
    from ident.studies.stiffness.check import CheckOptions, CheckResult, check
    from ident.studies.stiffness.compare import CompareOptions, CompareResult, compare
    from ident.studies.stiffness.fit import FitOptions, FitResult, fit
    from ident.studies.stiffness.fleet import FleetOptions, FleetResult, fleet
    from ident.studies.stiffness.joint import JointOptions, JointResult, joint
    from ident.studies.stiffness.plan import PlanOptions, PlanResult, plan
    from ident.studies.stiffness.profile import ProfileOptions, ProfileResult, profile
    from ident.studies.stiffness.sample import SampleOptions, SampleResult, sample
    from ident.studies.stiffness.validate import ValidateOptions, ValidateResult, validate
    from ident.studies.working.resonance import ResonanceOptions, ResonanceResult, resonance
    from ident.studies.working.simulate import SimulateOptions, SimulateResult, simulate
    from ident.studies.working.spectrum import SpectrumOptions, SpectrumResult, spectrum
    from ident.studies.working.sweep import SweepOptions, SweepResult, sweep

__version__ = "0.1.0"

_ERRORS = ("ConvergenceError", "IdentError", "InputError", "ModelError")
_NAMES = {
    "ident.arm.arm": ("Arm",),
    "ident.description.file": ("ArmFile", "read_arm"),
    "ident.description.mjcf": ("read_mjcf",),
    "ident.description.urdf": ("read_urdf",),
    "ident.measure": ("Campaign", "Load", "Log", "Measurement", "Trace", "read_campaign", "read_log", "read_trace"),
    "ident.studies.bind": ("Bound", "bind"),
    "ident.studies.handout": ("hand_over",),
    "ident.studies.rerun": ("Rerun", "rerun"),
    "ident.studies.saved": ("Saved", "load"),
}
_NAMED_OTHERWISE = {
    "export": ("export",),
    "modal": ("ModalOptions", "ModalResult", "modal_test"),  # `ident.modal` is a room of the house
    "show": ("ArmPicture", "show"),
}
_NAMES |= {
    place: _NAMED_OTHERWISE.get(name, (f"{name.capitalize()}Options", f"{name.capitalize()}Result", name))
    for name, place in MODULES.items()
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
__all__ = sorted([*_ERRORS, *_MODULES])


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        near = difflib.get_close_matches(name, __all__, n=1)
        meant = f"; did you mean {near[0]}?" if near else ""
        raise AttributeError(f"module 'ident' has no attribute '{name}'{meant}")
    import jax

    jax.config.update("jax_enable_x64", True)
    value = getattr(importlib.import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
