"""The run-time type checker of the tests: beartype, to which an int is a float as well (PEP 484)."""

from collections import Counter
from functools import wraps
from inspect import isclass

import jaxtyping
from beartype import BeartypeConf, beartype

ROOMS = ("arm", "description", "identify", "inference", "measure", "modal", "vibrate")
COMPUTING = tuple(
    f"studies.{name}"
    for name in (
        *("scenario", "look.exploration", "look.prediction", "look.arm_view", "look.arm_names", "look.example"),
        *("measuring.modal_campaign", "working.simulation", "working.spectra", "cause.trials"),
        *("cause.run_problem", "cause.source_study"),
        *(
            "cause.source_plan",
            "cause.trials",
            "cure.balance_study",
            "cure.cures",
            "cure.design_study",
            "cure.diagnosis",
        ),
        *("cure.motion_study", "cure.remedies"),
    )
)
"""What is checked: no report, figure or page, which import the values that they show for type checkers alone."""
CALLS = 300
"""Of a function, and constructions of a class, that are checked in each process."""
MADE = 30
"""Functions made by one and the same function that are checked."""

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))


def sparingly():
    """Have the first calls of each function checked, not the thousands that follow: a third of a fit's time went there.

    Which calls are the first depends on what ran before in the process. What `jaxtyping.install_import_hook` writes
    into the modules is `jaxtyping.jaxtyped(typechecker=...)`.
    """
    jaxtyped, made = jaxtyping.jaxtyped, Counter()

    def decorator(*, typechecker):
        check = jaxtyped(typechecker=typechecker)

        def decorate(target):
            if isclass(target):
                plain = target.__init__
                target = check(target)
                if target.__init__ is not plain:
                    checking = target.__init__
                    target.__init__ = _first(lambda: checking, plain)
                return target
            made[target.__code__] += 1
            return target if made[target.__code__] > MADE else _first(lambda: check(target), target)

        return decorate

    jaxtyping.jaxtyped = decorator


def _first(checked, plain):
    """Return a function that checks the first calls, by a function that is made for the first of them."""
    left, checking = CALLS, None

    @wraps(plain)
    def call(*args, **kwargs):
        nonlocal left, checking
        if left > 0:
            left -= 1
            checking = checking or checked()
            return checking(*args, **kwargs)
        return plain(*args, **kwargs)

    return call
