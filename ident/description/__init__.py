"""An arm as a file: TOML with the origin of every number, URDF, units, and one-line messages on its problems."""
