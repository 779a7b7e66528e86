"""What is the arm's own in an identification: the observation operator, mode labels, data checks, experiments."""
