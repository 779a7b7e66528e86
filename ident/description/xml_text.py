"""XML as text that stays as it was written but for what is put in."""

from xml.parsers import expat


def with_comment(data: bytes, lines: list[str]) -> bytes:
    """Return an XML file, which is well formed, with a comment before its root element."""
    start = root_start(data)
    return data[:start] + comment(lines) + data[start:]


def root_start(data: bytes) -> int:
    """Return at which byte the root element of a well-formed XML file starts."""
    starts: list[int] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, attributes: starts.append(parser.CurrentByteIndex)
    parser.Parse(data, True)
    return starts[0]


def comment(lines: list[str]) -> bytes:
    """Return lines as a comment; two dashes, which no comment may have, are set apart."""
    text = "\n".join(f"  {line}".rstrip() for line in lines)
    while "--" in text:
        text = text.replace("--", "- -")
    return f"<!--\n{text}\n-->\n".encode()
