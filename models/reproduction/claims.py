"""What the source says of its results, sentence by sentence, and how each came out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from trussflow.models.reproduction.ledger import Ledger
from trussflow.models.reproduction.results import Results

REPRODUCED, DIFFERS, OPEN = "reproduced", "differs", "cannot be judged"

SMALL = 1e-3
"""An error counts as small below this part of the commanded motion, an angle below it in rad,
an elastic displacement below it in units of the commanded motion."""

NOTABLE = 2.0
"""What is "remarkable", "notable", "significant" or "superior" is so by at least this factor."""

NEARLY_NOTHING, MOST = 0.05, 0.5
"""Shares in the sum of the robots' peak forces."""

SMOOTH = 0.02
"""A force counts as continuous and smooth if it changes by less than this part of its peak from
one logged instant to the next."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """How a claim came out.

    Attributes
    ----------
    ours : str
        Our numbers, as printed.
    verdict : str
        One of `REPRODUCED`, `DIFFERS`, `OPEN`.
    why : str
        Reason, and what the verdict leaves out.
    """

    ours: str
    verdict: str
    why: str


@dataclass(frozen=True, slots=True)
class Claim:
    """One statement of the source.

    Attributes
    ----------
    section : str
        Where it stands.
    figures : str
        Figures it is about.
    quote : str
        The source's words.
    runs : tuple of str
        The runs it is judged by.
    judge : callable
        Returns the judgement.
    """

    section: str
    figures: str
    quote: str
    runs: tuple[str, ...]
    judge: Callable[[Results, Ledger], Judgement]

    def judged(self, results: Results, ledger: Ledger) -> Judgement:
        """Judge it; what was not run to its end cannot be judged.

        Parameters
        ----------
        results : Results
            Finished runs.
        ledger : Ledger
            Takes down the numbers.
        """
        judgement = self.judge(results, ledger)
        if all(results.is_whole(name) for name in self.runs):
            return judgement
        return Judgement(judgement.ours, OPEN, "the runs do not last to the end of the mission")


def verdict(came_out: bool) -> str:
    """Return the word for a claim that came out, or did not."""
    return REPRODUCED if came_out else DIFFERS
