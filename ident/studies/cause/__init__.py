"""The cause of a measured vibration: triage, and the sources of each drive."""
