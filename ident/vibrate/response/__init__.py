"""How the arm vibrates while it carries out a motion: exact and fast, and what follows from it."""
