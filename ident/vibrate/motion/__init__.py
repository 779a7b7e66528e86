"""What the motors are told: strokes, logged paths, joint limits."""
