"""Results of a check of a firmware: as lines, as JSON, and as JUnit XML for the firmware's own tests."""

from collections.abc import Iterator
from typing import Any, Final
from xml.etree import ElementTree

from gateway.core.text.text import counted, escaped
from gateway.core.text.wording import as_json, text
from gateway.makers.check.clauses import CheckReport, Clause, ClauseResult, Finding, Verdict

PAGE: Final = "docs/reference/protocol.md"
_INDENT: Final = 15
_SECTIONS: Final = list(dict.fromkeys(clause.section for clause in Clause))


def report_lines(report: CheckReport) -> Iterator[str]:
    """Yield a report as lines, one per clause, findings and their bytes below it."""
    yield (
        f"{escaped(report.link)}: {counted(report.frames, 'frame')}, {counted(report.size_bytes, 'byte')}"
        f"{f' in {report.duration_s:.1f} s' if report.duration_s > 0.0 else ''}"
    )
    section = ""
    for result in sorted(report.clauses, key=lambda result: _SECTIONS.index(result.clause.section)):
        if result.clause.section != section:
            section = result.clause.section
            yield f"{section} ({PAGE}#{anchor(section)})"
        mark = "FAILED" if result.verdict is Verdict.FAILED else result.verdict
        yield f"  {mark:{_INDENT - 2}}  {result.clause.words} [{result.clause}]"
        for line in _details(result):
            yield f"{'':{_INDENT}}    {line}"
    yield ", ".join(f"{report.count(verdict)} {verdict}" for verdict in Verdict)


def _details(result: ClauseResult) -> Iterator[str]:
    if result.why is not None:
        yield text(result.why)
    for finding in result.findings:
        yield _finding_text(finding)
        if finding.example:
            position = "" if finding.at_byte is None else f"at byte {finding.at_byte}: "
            yield f"{position}{hex_bytes(finding.example)}"


def _finding_text(finding: Finding) -> str:
    message = text(finding.reason)
    message = f"{escaped(finding.subject)}: {message}" if finding.subject else message
    # Some reasons have a count of their own.
    has_count = finding.count == 1 or "count" in dict(finding.reason.values)
    return message if has_count else f"{message} ({finding.count} times)"


def report_json(report: CheckReport) -> dict[str, Any]:
    """Return a report as JSON."""
    return {
        "link": report.link,
        "duration_s": report.duration_s,
        "bytes": report.size_bytes,
        "frames": report.frames,
        "clauses": [
            {
                "clause": str(result.clause),
                "section": result.clause.section,
                "text": result.clause.words,
                "verdict": str(result.verdict),
                "checked": result.checked,
                "why": None if result.why is None else as_json(result.why),
                "findings": [
                    {
                        "subject": finding.subject,
                        "reason": as_json(finding.reason),
                        "count": finding.count,
                        "at_byte": finding.at_byte,
                        "bytes": finding.example.hex(),
                    }
                    for finding in result.findings
                ],
            }
            for result in report.clauses
        ],
    }


def junit_xml(reports: list[CheckReport]) -> str:
    """Return reports as JUnit XML: a suite per link, a case per clause; what is only recommended does not fail."""
    root = ElementTree.Element("testsuites")
    for report in reports:
        suite = ElementTree.SubElement(
            root,
            "testsuite",
            name=f"treadlink protocol check {escaped(report.link)}",
            tests=str(len(report.clauses)),
            failures=str(report.count(Verdict.FAILED)),
            errors="0",
            skipped=str(report.count(Verdict.NOT_EXERCISED)),
            time=f"{report.duration_s:.3f}",
        )
        for result in report.clauses:
            name = f"{result.clause}: {result.clause.words}"
            case = ElementTree.SubElement(suite, "testcase", classname=result.clause.section, name=name)
            details = "\n".join(_details(result))
            if result.verdict is Verdict.FAILED:
                failure = ElementTree.SubElement(case, "failure", message=_finding_text(result.findings[0]))
                failure.text = details
            elif result.verdict is Verdict.NOT_EXERCISED:
                ElementTree.SubElement(case, "skipped", message=details)
            elif details:
                ElementTree.SubElement(case, "system-out").text = details
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def hex_bytes(data: bytes) -> str:
    """Return bytes as pairs of hexadecimal digits, with blanks between them."""
    return data.hex(" ").upper()


def anchor(section: str) -> str:
    """Return the anchor of a section's heading."""
    return section.lower().replace(" ", "-")
