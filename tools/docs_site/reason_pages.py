"""Reference of reasons, generated from the codes and their templates."""

import inspect
import re
import string
from collections.abc import Iterator

from gateway.core.reasons import Code
from gateway.core.text.wording import fields
from tools.docs_site.markdown import code, escaped, table

_INTRODUCTION = """\
# Reasons

A reason states why an estimate is provisional or invalid, why an alarm is raised, or why an effect was rejected. In
JSON each reason has three parts: `code`, which programs compare; `values`, numbers in SI units with the unit in the
name; and `text`, the sentence shown to a user. Codes are stable: a code may be added, but is not renamed without an
entry in the [changelog](../changelog.md). The text may change at any time.

```json
{"code": "samples_lost", "values": {}, "text": "samples were lost on the link"}
```

In the texts below, a word in *italics* is replaced by a value.
"""


def reasons_markdown() -> str:
    """Return the reference of every reason code, by section."""
    lines = [_INTRODUCTION]
    for title, codes in _sections():
        lines += [f"## {title}", ""]
        lines += table(
            ("Code", "Values", "Text"),
            (
                (code(str(item)), ", ".join(code(name) for name in sorted(fields(item))), _readable(item.text_template))
                for item in codes
            ),
        )
    return "\n".join(lines).rstrip() + "\n"


def _sections() -> Iterator[tuple[str, list[Code]]]:
    """Yield the section comments of `Code` with the codes that follow each.

    A comment that begins with a dash continues the section before it. Sections without codes are left out.
    """
    section, title, codes = "", "Reasons", list[Code]()
    for line in inspect.getsource(Code).splitlines():
        if comment := re.fullmatch(r" {4}# (.+)", line):
            if codes:
                yield title, codes
            part = comment[1].removeprefix("- ")
            section = section if comment[1].startswith("- ") else part
            title, codes = part if part == section else f"{section} {part}", []
        elif member := re.match(r" {4}([A-Z][A-Z0-9_]*) = ", line):
            codes.append(Code[member[1]])
    if codes:
        yield title, codes


def _readable(template: str) -> str:
    """Return a template with each value as its name in italics and the unit in which it is shown."""
    parts = []
    for literal, name, spec, _ in string.Formatter().parse(template):
        parts.append(escaped(literal) if literal.strip() else literal)
        if literal != literal.rstrip() and literal.strip():
            parts.append(" ")
        if literal != literal.lstrip() and literal.strip():
            parts.insert(-1 if parts[-1] != " " else -2, " ")
        if name:
            unit = (spec or "").partition(" ")[2]
            words = name.rsplit("_", 1)[0] if unit else name
            parts.append(f"*{words.replace('_', ' ')}*" + (f" {unit}" if unit else ""))
    return "".join(parts)
