"""Results for people: report, figures, and the result file."""
