"""The paper's procedure as one: measured arm, resonance, vibration, verdict, remedies."""
