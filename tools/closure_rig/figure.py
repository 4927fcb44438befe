"""Reliability curve and confusion matrix as reproducible figures."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from closure_rig.score import Line, Versions, confusion, reliability


def draw_reliability(versions: Versions, path: Path) -> None:
    """Write the probability given against the share that is there, with 95 % intervals, as SVG.

    Both axes are logistic, so that 0.01 and 0.99 have room. Versions without probabilities are left out.
    """
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    with pyplot.rc_context({"svg.hashsalt": "closure", "svg.fonttype": "none", "font.size": 8}):
        figure, axes = pyplot.subplots(figsize=(4.2, 4.0))
        axes.set_xscale("logit")
        axes.set_yscale("logit")
        line = np.array([_LEAST, 1.0 - _LEAST])
        axes.plot(line, line, color="0.6", linewidth=0.8, label="as it should be")
        for name, lines in versions.items():
            bins = [entry for entry in reliability(lines) if entry.share.trials]
            if not bins:
                continue
            mean = np.clip([entry.mean for entry in bins], _LEAST, 1.0 - _LEAST)
            share = np.clip([entry.share.value for entry in bins], _LEAST, 1.0 - _LEAST)
            low, high = np.clip(np.array([entry.share.interval for entry in bins]).T, _LEAST, 1.0 - _LEAST)
            bars = np.maximum([share - low, high - share], 0.0)
            axes.errorbar(mean, share, bars, fmt="o", markersize=3.5, capsize=2, label=f"{name}, 95 %")
            for x, y, entry in zip(mean, share, bins, strict=True):
                axes.annotate(str(entry.share.trials), (x, y), (4, -8), textcoords="offset points", fontsize=6)
        axes.set_xlim(_LEAST, 1.0 - _LEAST)
        axes.set_ylim(_LEAST, 1.0 - _LEAST)
        axes.set_xlabel("probability given")
        axes.set_ylabel("share that is there")
        axes.legend(loc="upper left")
        figure.tight_layout()
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})
        pyplot.close(figure)


# Probabilities and shares beyond are drawn at the edge.
_LEAST: Final = 1e-3


def draw_confusion(lines: Sequence[Line], path: Path) -> None:
    """Write the confusion matrix, truth against diagnosis, as SVG."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    truths, says, share = confusion(lines)
    met = np.flatnonzero(share.any(axis=1))
    used = [column for column in range(len(says)) if share[:, column].any() or says[column] in truths]
    share, truths, says = share[np.ix_(met, used)], [truths[i] for i in met], [says[i] for i in used]
    # The same numbers give the same bytes: no random ids, no date.
    with pyplot.rc_context({"svg.hashsalt": "closure", "svg.fonttype": "none", "font.size": 7}):
        figure, axes = pyplot.subplots(figsize=(0.21 * len(says) + 2.6, 0.19 * len(truths) + 2.4))
        axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        axes.set_xticks(range(len(says)), says, rotation=90)
        axes.set_yticks(range(len(truths)), truths)
        axes.set_xlabel("said")
        axes.set_ylabel("true")
        axes.xaxis.set_label_position("top")
        for row, column in np.argwhere(share >= 0.005).tolist():
            value = share[row, column]
            axes.text(
                column, row, f"{100 * value:.0f}", ha="center", va="center", color="white" if value > 0.6 else "black"
            )
        axes.set_xticks(np.arange(-0.5, len(says)), minor=True)
        axes.set_yticks(np.arange(-0.5, len(truths)), minor=True)
        axes.grid(which="minor", color="0.85", linewidth=0.4)
        axes.tick_params(which="minor", length=0)
        figure.tight_layout()
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, format="svg", metadata={"Date": None, "Creator": None})
        pyplot.close(figure)
