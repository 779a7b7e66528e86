"""Result files, one file a capability: what writes a format and what reads it."""
