"""Diagnoses for tests of the views: an ordinary one, one full of hostile strings, and an empty one."""

import math
from dataclasses import replace

import numpy as np

from gateway.core.reasons import Reason
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import (
    AsRecorded,
    BlockError,
    Curves,
    Diagnosis,
    Finding,
    Fitted,
    HeldOut,
    Origin,
    RecordingOrigin,
    Scaling,
    ScalingStatus,
    Spectra,
    Trend,
    Unexplained,
    Verdict,
)

NAN = math.nan
NASTY = (
    "<script>document.title='taken'</script>\"'><img src=x onerror=alert(1)>&{{7*7}}${\x1b[2J\x1b]0;t\x07-->日\udcff"
)
WARMER = Reason(DiagnosisCode.RECORD_AGAIN, how="warmer", difference_k=20.0)
NOISE = np.array([0.5, 0.4, 0.6])


def _contact(theta: np.ndarray, half: float) -> np.ndarray:
    """A curve like a radial waveform over R omega^2: 1 outside, peaks at the edges, nearly 0 within the contact."""
    inside = 0.5 * (np.tanh((half - theta) / 0.03) + np.tanh((half + theta) / 0.03))
    edges = np.exp(-(((np.abs(theta) - half - 0.06) / 0.07) ** 2))
    return 1.0 - 1.03 * inside + 0.45 * edges * (1.0 - inside)


def curves(label: str, speed_kmh: float, *, lateral: bool = True, seed: int = 0) -> Curves:
    rng = np.random.default_rng(seed)
    n, orders = 512, 111
    theta = -np.pi + 2 * np.pi * np.arange(n) / n
    level = (speed_kmh / 3.6) ** 2 / 0.32
    radial = level * _contact(theta, 0.24)
    truth = np.stack([0.2 * np.gradient(radial, theta) * 0.1, 0.02 * radial * np.sin(theta), radial])
    after = truth.copy()
    before = truth - np.stack(
        [
            0.02 * level * np.sin(2 * theta),
            0.012 * level * np.cos(theta),
            0.03 * level * (_contact(theta, 0.27) - _contact(theta, 0.24)),
        ]
    )
    coefficients = rng.normal(size=(3, 2, orders - 1)) * NOISE[:, None, None] / math.sqrt(orders)
    n_theta = np.arange(1, orders)[:, None] * theta
    noise = coefficients[:, 0] @ np.cos(n_theta) + coefficients[:, 1] @ np.sin(n_theta)
    bump = 0.006 * level * np.exp(-(((theta - 1.5) / 0.05) ** 2))
    measured = truth + noise + np.stack([0 * bump, 0 * bump, bump])
    if not lateral:
        for item in (measured, before, after):
            item[1] = NAN
    order_noise = np.repeat((NOISE / math.sqrt(orders))[:, None], orders, axis=1)
    return Curves(label, theta, measured, before, after, NOISE.copy(), order_noise)


def spectra(label: str, *, seed: int = 0) -> Spectra:
    rng = np.random.default_rng(seed)
    frequency = np.linspace(2.0, 2000.0, 800)
    white = np.repeat(np.array([[0.002], [0.002], [0.002]]), frequency.size, axis=1)
    cavity = 0.05 / (1.0 + ((frequency - 222.0) / 4.0) ** 2)
    after = white + np.stack([cavity, 0.1 * cavity, 0.3 * cavity])
    measured = after * rng.gamma(20.0, 1 / 20.0, size=after.shape)
    measured[0] += 0.2 * np.exp(-(((frequency - 610.0) / 3.0) ** 2))
    return Spectra(label, frequency, measured, white, after)


def trends() -> tuple[Trend, ...]:
    kmh = np.array([40.0, 60.0, 80.0, 100.0])
    load = np.array([3000.0, 4000.0, 5000.0, 4000.0])
    results = []
    for axis, size in (("circumferential", 1.0), ("lateral", 0.4), ("radial", 1.6)):
        before = size * (kmh / 40.0) ** 2
        after = np.array([0.05, 0.1, 0.0, 0.2]) * size
        noise = np.full(4, 0.5)
        results.append(Trend(axis, "speed_kmh", kmh, before, after, noise))
        results.append(Trend(axis, "load_n", load, before, after, noise))
    return tuple(results)


def ordinary(groups: int = 4) -> Diagnosis:
    labels = [f"drum-{40 + 20 * i}kmh.mcap, {40 + 20 * i} km/h, 4.0 kN, 230 kPa" for i in range(groups)]
    before = {
        "Bs": Fitted(2.61e-3, 1.1e-5),
        "Cw": Fitted(0.1813, 0.0011),
        "Rs": Fitted(3.11, 0.016),
        "Ts": Fitted(2.95, 0.12),
        "contact_half_angle_rad": Fitted(0.2402, 0.0004, "rad"),
    }
    after = {
        "Bs": Fitted(2.834e-3, 7e-6),
        "Cw": Fitted(0.1950, 0.0013),
        "Rs": Fitted(2.854, 0.017),
        "Ts": Fitted(2.41, 0.9),
        "contact_half_angle_rad": Fitted(0.2393, 0.0003, "rad"),
    }
    middle = {**before, "Bs": Fitted(2.80e-3, 9e-6), "Cw": Fitted(0.1931, 0.0012)}
    return Diagnosis(
        model="exact",
        wheel="FL",
        recordings=tuple(f"drum-{40 + 20 * i}kmh.mcap" for i in range(groups)),
        assumed=("load 4000 N in drum-40kmh.mcap (not stated)",),
        revolutions=1240,
        rejected=12,
        noise_floor_mps2=2.05,
        held_out=HeldOut(
            12.31,
            2.10,
            1240,
            8,
            std_before_mps2=0.31,
            std_after_mps2=0.04,
            std_ratio=0.006,
            blocks=(BlockError("drum-40kmh.mcap: 40.0 km/h", 155, 12.0, 12.4, 2.11),),
            as_recorded=AsRecorded(12.52, 3.15, 310, 1240),
        ),
        origin=Origin(
            (RecordingOrigin("drum-40kmh.mcap", "0123456789abcdef" * 4, 1.76e9, 1.76e9 + 61.0),),
            0xC0FFEE,
            "drum 3",
            "205/55R16",
            "treadlink diagnose drum-40kmh.mcap --html report.html",
        ),
        findings=(
            Finding(
                name="mounting offset",
                verdict=Verdict.NAMED,
                parameters={"offset_m": Fitted(5.02, 0.11, "mm")},
                chi2=41230.0,
                rms_mps2=11.2,
                rms_before_mps2=12.31,
                rms_after_mps2=4.02,
                estimates={name: (before[name], middle[name]) for name in before},
                summary="The sensor sits below the belt's neutral layer and sees a larger curvature.",
                equation="s_e = s - e (s'' + s)/R, first order in the offset e",
                probability=0.9999,
                log_odds=42.0,
            ),
            Finding(
                name="structural damping",
                verdict=Verdict.NAMED,
                parameters={"damping_time_s": Fitted(12.1, 0.8, "µs"), "loss_angle_rad": Fitted(0.4, 0.02, "deg")},
                chi2=3120.0,
                rms_mps2=3.4,
                rms_before_mps2=4.02,
                rms_after_mps2=2.10,
                estimates={name: (middle[name], after[name]) for name in before},
                summary="The sidewall loses energy as it is deformed.",
                equation="c dw/dt beside kw w in the equation of motion",
                probability=0.995,
                log_odds=5.3,
            ),
            Finding(
                name="cavity resonance",
                verdict=Verdict.NAMED,
                parameters={"frequency_hz": Fitted(222.3, 0.4, "Hz"), "size_mps2": Fitted(4.8, 0.2, "m/s²")},
                chi2=880.0,
                rms_mps2=4.8,
                summary="The air in the tire resonates.",
                equation="S(f) = S0 / (1 + ((f - f0) / w)^2)",
                lock="time",
            ),
            Finding(
                name="gain drift",
                verdict=Verdict.INDISTINGUISHABLE,
                parameters={"gain_per_degc": Fitted(0.021, 0.004, "%/K")},
                chi2=31.0,
                rms_mps2=0.4,
                rivals=("run-out",),
                decide_with=WARMER,
            ),
            Finding(
                name="run-out",
                verdict=Verdict.INDISTINGUISHABLE,
                parameters={"radius_change_m": Fitted(0.31, 0.06, "mm")},
                chi2=30.0,
                rms_mps2=0.4,
                rivals=("gain drift",),
                decide_with=WARMER,
            ),
            Finding(
                name="clipping",
                verdict=Verdict.REFUSED,
                parameters={"limit_mps2": Fitted(9000.0, 4.0, "m/s²")},
                chi2=14.0,
                rms_mps2=0.2,
                reason=Reason(
                    DiagnosisCode.IMPLAUSIBLE_PARAMETER,
                    parameter="limit_mps2",
                    value=9000.0,
                    low=0.0,
                    high=2000.0,
                    unit="m/s^2",
                ),
            ),
        ),
        unexplained=(
            Unexplained(
                "circumferential", "time", None, (606.0, 614.5), None, Scaling(ScalingStatus.KNOWN, 0.0), 1.21, 0.06,
                narrow=True, centre_hz=610.2, speeds=(4, 4), other_axes=(("radial", 0.3),),
            ),
            Unexplained(
                "radial", "angle", (18, 60), None, (1.42, 1.58), Scaling(ScalingStatus.KNOWN, 2.0), 0.84, 0.05,
            ),
        ),
        estimates_before=before,
        estimates_after=after,
        determined={"Ts": False},
        curves=tuple(curves(label, 40.0 + 20.0 * i, seed=i) for i, label in enumerate(labels)),
        spectra=tuple(spectra(label, seed=i) for i, label in enumerate(labels)),
        trends=trends(),
        empirical_rms_mps2=1.95,
        notes=(
            Reason(DiagnosisCode.REVOLUTIONS_LEFT_OUT, revolutions=12, reason="the speed changed by more than 3 %"),
        ),
        load_known=False,
    )  # fmt: skip


def undrawn() -> Diagnosis:
    """Return the ordinary diagnosis without figures, which take most of the time of a page."""
    return replace(ordinary(1), curves=(), spectra=(), trends=())


def nasty() -> Diagnosis:
    """Return a diagnosis whose strings are hostile, with unknown numbers and an absent axis."""
    plain = ordinary(2)
    bad = Fitted(NAN, math.inf, NASTY)
    finding = replace(
        plain.findings[0],
        name=NASTY,
        parameters={NASTY: bad, "_legend": bad},
        chi2=math.inf,
        estimates={NASTY: (bad, bad)},
        rivals=(NASTY,),
        decide_with=Reason(DiagnosisCode.DECIDES_AGAINST, effect=NASTY, recording=WARMER),
        reason=Reason(DiagnosisCode.SIZE_DIFFERS_BETWEEN_RECORDINGS, recording=NASTY),
        summary=NASTY,
        equation=NASTY,
        lock=NASTY,
    )
    unknown = Scaling(ScalingStatus.TOO_WEAK)
    remainder = Unexplained(NASTY, NASTY, (3, 3), (NAN, 5.0), (0.1, 0.2), unknown, NAN, NAN)
    return replace(
        plain,
        model=NASTY,
        wheel=NASTY,
        recordings=(NASTY, NASTY),
        assumed=(NASTY,),
        noise_floor_mps2=NAN,
        held_out=HeldOut(NAN, NAN, 0, 0),
        findings=(
            finding,
            replace(finding, verdict=Verdict.INDISTINGUISHABLE),
            replace(finding, verdict=Verdict.REFUSED),
        ),
        unexplained=(remainder,),
        estimates_before={NASTY: bad},
        estimates_after={NASTY: bad, "Bs": bad},
        determined={NASTY: False},
        curves=tuple(replace(curves(NASTY, 50.0, lateral=False, seed=i)) for i in range(2)),
        spectra=tuple(replace(item, label=NASTY) for item in plain.spectra),
        trends=tuple(replace(item, axis=NASTY, against=NASTY) for item in plain.trends[:1]),
        empirical_rms_mps2=NAN,
        notes=(NASTY,),
        folds_of=NASTY,
    )


def empty() -> Diagnosis:
    """Return a diagnosis without findings and figures."""
    return replace(
        ordinary(1),
        findings=(), unexplained=(), estimates_before={}, estimates_after={}, determined={}, curves=(), spectra=(),
        trends=(), notes=(), assumed=(), load_known=True, empirical_rms_mps2=None, rejected=0,
        held_out=HeldOut(2.05, 2.05, 40, 4),
    )  # fmt: skip
