"""The layout of every screen, page, figure and file. Knows no command."""
