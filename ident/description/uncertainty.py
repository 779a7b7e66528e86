"""What an arm file says of how well its numbers are known."""

from typing import Any

from ident.arm.fields import field_named
from ident.description.schema import ArmDocument, named


def uncertain_numbers(document: ArmDocument) -> dict[str, str]:
    """Return the standard deviation, as it is written, of each number that has one, by path."""
    found: dict[str, str] = {}
    for _, table in named(document.model_dump()):
        for key, width in ((key, _relative_width(part)) for key, part in table.items()):
            if width:
                found |= {f"{table['name']}.{key}{end}": width for end in field_named(key).ends}
    return found


def _relative_width(part: Any) -> str:
    return part.get("uncertainty") or "" if isinstance(part, dict) else ""
