"""What the source says of its results, sentence by sentence, and how each came out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from study_tools.ledger import Ledger

from reproduction.results import Results

REPRODUCED, COARSE, DIFFERS, OPEN = (
    "reproduced",
    "reproduced with the source's step only",
    "differs",
    "cannot be judged",
)

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
        One of `REPRODUCED`, `COARSE`, `DIFFERS`, `OPEN`.
    why : str
        Reason, and what the verdict leaves out.
    """

    ours: str
    verdict: str
    why: str


@dataclass(frozen=True, slots=True)
class Judge:
    """A way to judge a claim.

    Attributes
    ----------
    runs : tuple of str
        The runs that it looks at.
    judgement : callable
        Returns the judgement, and takes down its numbers.
    """

    runs: tuple[str, ...]
    judgement: Callable[[Results, Ledger], Judgement]


def judge_by(*runs: str) -> Callable[[Callable[[Results, Ledger], Judgement]], Judge]:
    """Make a function the judge that looks at these runs."""
    return lambda judgement: Judge(runs, judgement)


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
    judge : Judge
        Returns the judgement.
    """

    section: str
    figures: str
    quote: str
    judge: Judge

    def judged(self, results: Results, ledger: Ledger) -> Judgement:
        """Judge it; what was not run to its end cannot be judged.

        Parameters
        ----------
        results : Results
            Finished runs.
        ledger : Ledger
            Takes down the numbers.
        """
        judgement = self.judge.judgement(results, ledger)
        if all(results.is_whole(name) for name in self.judge.runs):
            return judgement
        return Judgement(judgement.ours, OPEN, "the runs do not last to the end of the mission")


def verdict(came_out: bool) -> str:
    """Return the word for a claim that came out, or did not."""
    return REPRODUCED if came_out else DIFFERS
