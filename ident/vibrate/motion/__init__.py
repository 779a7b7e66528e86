"""The commanded motion: strokes, logged paths, joint limits."""
