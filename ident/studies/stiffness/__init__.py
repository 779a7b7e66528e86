"""From a campaign to joint stiffnesses: how certain they are, what to measure next, what has changed."""
