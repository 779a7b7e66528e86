"""From data to parameters, for any differentiable model: fit, profile, sample, optimal design. Knows no arm."""
