"""Confusion matrix as a reproducible figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from closure_rig.judge import Judgement
from closure_rig.score import confusion


def draw_confusion(judgements: Sequence[Judgement], path: Path) -> None:
    """Write the confusion matrix, truth against diagnosis, as SVG."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    truths, says, share = confusion(judgements)
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
