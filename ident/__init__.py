"""ident: joint stiffness of serial robot arms from natural frequencies and static deflection."""

__version__ = "0.1.0"
