"""An arm by itself: its picture, its numbers, what it predicts, and its description in other formats."""
