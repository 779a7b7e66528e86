"""An arm as a file: TOML with the origin of every number, URDF, units, and what is wrong with a file in one line."""
