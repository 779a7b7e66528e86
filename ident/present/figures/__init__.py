"""Matplotlib figures, one file a capability."""
