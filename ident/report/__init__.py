"""The frame of every screen, page, figure and file. Knows no command."""
