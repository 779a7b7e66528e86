"""What `arm.toml` says of springs that are no straight lines: `[[spring]]` and `[[cubic_spring]]`."""

from typing import Literal

from ident.arm.fields import names_of
from ident.arm.springs import CubicSpring, Spring
from ident.description.quantities import CubicStiffness, Name, Ratio, Table, Torque


class SpringTable(Table):
    """A spring that is a broken line; the meaning of each key is that of `Spring`'s attribute."""

    name: Name
    joint: str
    direction: Literal["bending", "torsion"]
    ratio2: Ratio
    ratio3: Ratio
    torque1: Torque
    torque2: Torque

    def spring(self) -> Spring:
        """Return the spring as a value."""
        numbers = {field: getattr(self, field).number for field in names_of("Spring")}
        return Spring(self.name, self.joint, self.direction, **numbers)


class CubicSpringTable(Table):
    """A cubic spring; the meaning of each key is that of `CubicSpring`'s attribute."""

    name: Name
    joint: str
    direction: Literal["bending", "torsion"]
    cubic: CubicStiffness

    def spring(self) -> CubicSpring:
        """Return the spring as a value."""
        return CubicSpring(self.name, self.joint, self.direction, self.cubic.number)
