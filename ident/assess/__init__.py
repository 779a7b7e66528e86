"""Identification and vibration together: what was simulated and on what it rests, the limit, remedies."""
