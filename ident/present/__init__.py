"""Results for people: text, figures, files, pages. Computes nothing."""
