"""The studies of ident: a study is a file in the folder of its step, next to the file of its report."""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType

STEPS = ("look", "measuring", "stiffness", "working", "cause", "cure")
"""The steps of a user's way. `tests/test_imports.py` lists which steps each may use."""
UNSAVED = ("explore", "export", "show")
"""Studies whose results cannot be loaded."""


def _found() -> dict[str, str]:
    """Return the module of each study, from file names alone: `motion.py` next to `motion_report.py`."""
    folder, modules = Path(__file__).parent, dict[str, str]()
    for step in STEPS:
        names = {module.name for module in iter_modules([str(folder / step)])}
        modules |= {name: f"{__name__}.{step}.{name}" for name in sorted(names) if f"{name}_report" in names}
    return modules


MODULES = _found()
STUDIES = tuple(name for name in MODULES if name not in UNSAVED)
"""Studies with a result; the format of a result file names its study, as in `ident-fit/3`."""


def options_of(study: str) -> type:
    """Return the class of the options of a study."""
    kind: type = getattr(module_of(study), f"{study.capitalize()}Options")
    return kind


def module_of(study: str, part: str = "") -> ModuleType:
    """Return the module of a study, or of a part of it: `_report`, `_figure`, `_plan`."""
    return import_module(MODULES[study] + part)
