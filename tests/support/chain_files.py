"""Arm files of many joints."""

JOINT = """[[joint]]
name = "joint{n}"
offset = {{ value = [100, 0, 0], unit = "mm", origin = "assumed" }}
k_bend = {{ value = 1e6, unit = "N*m/rad", origin = "assumed" }}
k_tors = {{ value = 1e6, unit = "N*m/rad", origin = "assumed" }}
[[joint.link]]
name = "link{n}"
mass = {{ value = 2.0, unit = "kg", origin = "assumed" }}
com = {{ value = [50, 0, 0], unit = "mm", origin = "assumed" }}
shape = {{ kind = "box", unit = "mm", size = [100, 100, 100], origin = "assumed" }}
"""


def chain_file(joints):
    """Return the text of an arm of equal links."""
    return 'format = "ident-arm/1"\nname = "chain"\n' + "".join(JOINT.format(n=n) for n in range(1, joints + 1))
