"""Reference of reasons, generated from the codes and their templates."""

import inspect
import re
import string
from collections.abc import Iterator

from gateway.core.reasons import Code, Codes
from gateway.core.text.wording import fields
from tools.docs_site.markdown import code, escaped, table
from tools.reason_codes import rooms_of_codes

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
    """Return the reference of every reason code, by room and section."""
    lines = [_INTRODUCTION]
    for codes in rooms_of_codes():
        lines += [f"## {inspect.cleandoc(codes.__doc__ or '').splitlines()[0].rstrip('.')}", ""]
        for title, members in _sections(codes):
            lines += [f"### {title}", ""] if title else []
            lines += table(
                ("Code", "Values", "Text"),
                (
                    (
                        code(str(item)),
                        ", ".join(code(name) for name in sorted(fields(item))),
                        "; ".join((_readable(item.text_template), *_kinds(item))),
                    )
                    for item in members
                ),
            )
    return "\n".join(lines).rstrip() + "\n"


def _sections(codes: type[Codes]) -> Iterator[tuple[str, list[Code]]]:
    """Yield the section comments of a room's codes with those that follow each."""
    title, members = "", list[Code]()
    for line in inspect.getsource(codes).splitlines():
        if comment := re.fullmatch(r" {4}# (.+)", line):
            if members:
                yield title, members
            title, members = comment[1], []
        elif member := re.match(r" {4}([A-Z][A-Z0-9_]*) = ", line):
            members.append(getattr(codes, member[1]))
    if members:
        yield title, members


def _kinds(item: Code) -> Iterator[str]:
    """Yield the texts of the values that are one of a few kinds."""
    for name, kinds in item.words.items():
        texts = ", ".join(f"{code(kind)} {_readable(template)}" for kind, template in kinds.items())
        yield f"*{name}*: {texts}"


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
