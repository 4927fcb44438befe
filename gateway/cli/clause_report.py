"""Results of a check of a firmware: as lines, as JSON, and as JUnit XML for the firmware's own tests."""

from collections.abc import Iterator
from typing import Any, Final
from xml.etree import ElementTree

from gateway.session.bringup.clauses import CheckReport, Clause, ClauseResult, Finding, Verdict
from gateway.views.text import counted, escaped
from gateway.views.wording import as_json, text

PAGE: Final = "docs/reference/protocol.md"
_INDENT: Final = 15

CLAUSES: Final[dict[Clause, tuple[str, str]]] = {
    Clause.SYNC: ("Frame", "a frame starts with A5 5A"),
    Clause.CONTIGUOUS: ("Frame", "frames are back to back, with nothing between them"),
    Clause.LENGTH: ("Frame", "length is that of the payload"),
    Clause.CRC: ("Frame", "CRC-32 over all bytes before it"),
    Clause.VERSION: ("Frame", "the version byte is that of the layout"),
    Clause.TYPES: ("Frame", "types are defined, and those of a hub"),
    Clause.FLAGS: ("Frame", "flags are 0, except bit 0 of signed frames"),
    Clause.LAYOUT: ("Payloads", "payloads have the length of their layout"),
    Clause.RANGES: ("Payloads", "values are within their ranges"),
    Clause.SEQ: ("Counters and time", "seq counts the frames of every source, one by one"),
    Clause.START: ("Counters and time", "seq counts from 0 at every start"),
    Clause.DROPS: ("Counters and time", "a frame that could not be sent uses its number"),
    Clause.TICK: ("Counters and time", "tick_us counts us"),
    Clause.TICK_MONOTONIC: ("Counters and time", "tick_us advances and is never set"),
    Clause.TICK_FIRST: ("Counters and time", "tick_us of SAMPLES is that of the first sample"),
    Clause.JITTER: ("Counters and time", "tick_us of SAMPLES is even to 2 ms (recommended)"),
    Clause.HELLO_FIRST: ("HELLO and its values", "HELLO comes before the first SAMPLES"),
    Clause.HELLO_PERIOD: ("Counters and time", "HELLO every 2 s"),
    Clause.HELLO_VALUES: ("HELLO and its values", "scale and zero of present axes can be used"),
    Clause.HELLO_ABSENT: ("HELLO and its values", "values of absent axes are 0 (recommended)"),
    Clause.SCALE_RANGE: ("HELLO and its values", "range, scale and saturation agree within a factor of 2"),
    Clause.HELLO_COUPLING: ("HELLO and its values", "highpass_hz is 0 with DC coupling"),
    Clause.BOOT_COUNT: ("HELLO and its values", "boot_count is that of the hub, and higher after every start"),
    Clause.HELLO_SENSOR: ("HELLO and its values", "one sensor per wheel"),
    Clause.HUB_ITSELF: ("HELLO and its values", "no message of a wheel comes from wheel 255"),
    Clause.HUB_NUMBER: ("HELLO and its values", "the hub's number is not 255 (recommended)"),
    Clause.AXES: ("Sample numbers", "SAMPLES have the axes of HELLO"),
    Clause.NUMBERS: ("Sample numbers", "first_sample counts every sample, and does not jump"),
    Clause.RATE: ("Sample numbers", "clock, samples and rate_hz agree within 3 % over 2 s"),
    Clause.RATE_EXACT: ("Sample numbers", "clock, samples and rate_hz agree within 0.1 % (recommended)"),
    Clause.ONCE: ("Sample numbers", "a sample is sent once"),
    Clause.BYTE_ORDER: ("Payloads", "counts are little endian"),
    Clause.ROWS: ("Payloads", "rows of signed counts, the axes in their order, radial positive inward"),
    Clause.COUPLING: ("HELLO and its values", "AC coupling is stated of a signal without a steady value"),
    Clause.SCALE: ("Payloads", "the steady radial value is R Omega^2"),
    Clause.ENVIRONMENT_PERIOD: ("Counters and time", "ENVIRONMENT every second"),
    Clause.ENVIRONMENT_VALUES: ("Payloads", "pressure and temperature are possible"),
    Clause.STATUS_PERIOD: ("Counters and time", "HUB_STATUS every second"),
    Clause.STATUS_VALUES: ("Payloads", "uptime_s and frames_sent are those of the hub"),
    Clause.TIME_PERIOD: ("Counters and time", "TIME_SYNC every second"),
    Clause.TIME_VALUES: ("Sample numbers", "the low bits of hub_us are tick_us"),
    Clause.LOG: ("LOG_TEXT", "UTF-8, a defined level, at most 10 a second"),
    Clause.SIGNED_ALL: ("Signed frames", "a source signs all of its frames or none"),
    Clause.TAG: ("Signed frames", "tags are right under the key of their source"),
    Clause.COMMAND_ANSWER: ("Commands", "COMMAND_RESULT of the hub repeats seq and type"),
    Clause.COMMAND_CRC: ("Commands", "a command with a bad CRC is dropped without an answer"),
    Clause.COMMAND_UNKNOWN: ("Commands", "an unknown command has outcome 1"),
    Clause.COMMAND_VALUE: ("Commands", "a value out of range has outcome 2"),
    Clause.COMMAND_TIME: ("Commands", "TIME_SYNC repeats the time of SET_TIME"),
    Clause.COMMAND_STREAM: ("Commands", "SET_STREAM stops and starts the samples, and nothing else"),
    Clause.COMMAND_RATE: ("Commands", "HELLO follows SET_RATE at once"),
    Clause.COMMAND_REPEATED: ("Commands", "a repeated command is done again; signed, it has outcome 5"),
    Clause.COMMAND_VERIFIED: ("Signed commands", "a hub that signs refuses unsigned commands with outcome 4"),
    Clause.THROUGHPUT: ("Counters and time", "blocks are full, and the link carries them"),
    Clause.LOSS: ("Counters and time", "no frame and no sample is lost"),
}
"""Section of the page, and the clause in short."""

_MARKS: Final = {
    Verdict.PASSED: "passed",
    Verdict.ADVISED: "advised",
    Verdict.FAILED: "FAILED",
    Verdict.NOT_EXERCISED: "not exercised",
}


def report_lines(report: CheckReport) -> Iterator[str]:
    """Yield a report as lines, one per clause, findings and their bytes below it."""
    yield (
        f"{escaped(report.link)}: {counted(report.frames, 'frame')}, {counted(report.size_bytes, 'byte')}"
        f"{f' in {report.duration_s:.1f} s' if report.duration_s > 0.0 else ''}"
    )
    section = ""
    for result in sorted(report.clauses, key=lambda result: _SECTIONS.index(CLAUSES[result.clause][0])):
        if CLAUSES[result.clause][0] != section:
            section = CLAUSES[result.clause][0]
            yield f"{section} ({PAGE}#{anchor(section)})"
        yield f"  {_MARKS[result.verdict]:{_INDENT - 2}}  {CLAUSES[result.clause][1]} [{result.clause}]"
        for line in _details(result):
            yield f"{'':{_INDENT}}    {line}"
    yield ", ".join(f"{report.count(verdict)} {verdict}" for verdict in Verdict)


def _details(result: ClauseResult) -> Iterator[str]:
    if result.why is not None:
        yield text(result.why)
    for finding in result.findings:
        yield _said(finding)
        if finding.example:
            position = "" if finding.at_byte is None else f"at byte {finding.at_byte}: "
            yield f"{position}{hex_bytes(finding.example)}"


def _said(finding: Finding) -> str:
    said = text(finding.reason)
    said = f"{escaped(finding.subject)}: {said}" if finding.subject else said
    # Some reasons have a count of their own.
    has_count = finding.count == 1 or "count" in dict(finding.reason.values)
    return said if has_count else f"{said} ({finding.count} times)"


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
                "section": CLAUSES[result.clause][0],
                "text": CLAUSES[result.clause][1],
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
            section, clause = CLAUSES[result.clause]
            case = ElementTree.SubElement(suite, "testcase", classname=section, name=f"{result.clause}: {clause}")
            details = "\n".join(_details(result))
            if result.verdict is Verdict.FAILED:
                failure = ElementTree.SubElement(case, "failure", message=_said(result.findings[0]))
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


_SECTIONS: Final = list(dict.fromkeys(section for section, _ in CLAUSES.values()))
