"""Knobs of a controller, as tables of an arm file."""

KNOBS = {
    "time": ("OVERRIDE", "%", "[1, 100]", 1),
    "speed": ("VEL", "%", "[1, 100]", 1),
    "ramp": ("ACC_T", "ms", "[32, 4000]", 4),
    "jerk time": ("JERK_T", "ms", "[4, 1000]", 4),
    "acceleration": ("ACC", "%", "[1, 100]", 1),
    "jerk": ("JERK", "deg/s^3", "[1, 5000]", 1),
}


def table(kind, **other):
    """The table of the knob that scales something, with other values."""
    name, unit, span, step = KNOBS[kind]
    said = {"name": f'"{name}"', "scales": f'"{kind}"', "unit": f'"{unit}"', "range": span, "step": step}
    said |= {"origin": '"assumed"'} | other
    return "\n[[controller.knob]]\n" + "".join(f"{key} = {value}\n" for key, value in said.items())
