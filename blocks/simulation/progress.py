"""The progress bar, with the real-time factor."""

from __future__ import annotations

from typing import Any

from tqdm import tqdm


class ProgressBar(tqdm):  # type: ignore[type-arg]
    """A bar in simulated seconds; it shows itself only in runs of more than a second.

    Parameters
    ----------
    name : str
        What is running.
    duration : float
        Simulated time of the whole run [s].
    shown : bool
        Whether to show it at all.
    """

    def __init__(self, name: str, duration: float, shown: bool) -> None:
        super().__init__(
            total=duration,
            desc=name,
            delay=1.0,
            disable=not shown,
            leave=False,
            bar_format="{desc} {percentage:3.0f} %|{bar}| {n:.1f}/{total:.1f} s, "
            "{factor} x real time, {remaining} left",
        )

    @property
    def format_dict(self) -> dict[str, Any]:
        """Return what the bar can print, the real-time factor included."""
        found = dict(super().format_dict)
        elapsed = found["elapsed"]
        found["n"] = min(found["n"], found["total"])  # round-off of the sum of steps
        return found | {"factor": f"{found['n'] / elapsed:.1f}" if elapsed else "?"}
