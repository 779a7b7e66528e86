"""Texts that say the same, but for the rounding of their numbers."""

import re

NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def same_text(text: str, other: str, relative: float = 0.02) -> bool:
    """Whether words are equal and numbers within so much of each other; blanks count nothing."""
    words, numbers = parted(text)
    other_words, other_numbers = parted(other)
    if words != other_words:
        return False
    largest = [max(abs(a), abs(b)) for a, b in zip(numbers, other_numbers, strict=True)]
    return all(abs(a - b) <= relative * size + 0.01 for a, b, size in zip(numbers, other_numbers, largest, strict=True))


def parted(text: str) -> tuple[list[str], list[float]]:
    """Return the words of a text, each number a #, and the numbers."""
    return NUMBER.sub(" # ", text).split(), [float(match) for match in NUMBER.findall(text)]
