"""What leaves less vibration: another motion, balanced drives, other numbers; from a campaign to advice."""
