"""Logs: rows of numbers that are collected in memory during a run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.errors import (
    DivergenceError,
    RunEndedError,
    RunStoppedError,
    SimulationInterrupted,
    TimeLimitError,
    TrussflowError,
)
from trussflow.blocks.results.channels import Channel
from trussflow.blocks.results.dataset import dataset
from trussflow.blocks.support.call_site import warn
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import one_of

if TYPE_CHECKING:
    import xarray as xr


NAN_POLICIES = "stop", "warn", "ignore"
"""Reactions to logged signals that are not finite."""

BUFFER_ROWS = 1024
"""Number of rows of a new buffer, unless the rows are wide [-]."""

BUFFER_NUMBERS = 500_000
"""Maximum number of numbers in a new buffer; 4 MB."""

Messages = Mapping[str, Sequence[str]]
"""Messages of a run, keyed by block or subsystem."""


STATUS_BY_ERROR: dict[type[BaseException], str] = {
    KeyboardInterrupt: "interrupted",
    DivergenceError: "diverged",
    RunEndedError: "ended",
    TimeLimitError: "timeout",
}
"""Status of a run, by the exception that ended it; "failed" for all other errors."""


def status_of(error: BaseException) -> str:
    """Return the status of a run that an `error` ended."""
    kinds = (s for kind, s in STATUS_BY_ERROR.items() if isinstance(error, kind))
    return next(kinds, "failed")


class Log:
    """Rows collected in memory.

    Parameters
    ----------
    channels : sequence of Channel
        Channels of a row.
    attributes : mapping
        Status of the run in the result.
    not_finite : str
        Reaction to the first row with a number that is not finite: ``"stop"``, ``"warn"`` when
        the run is complete, or ``"ignore"``.

    Attributes
    ----------
    width : int
        Numbers in a row [-].
    last : float
        Time of the last row [s].
    resumed : Any
        Argument of `checkpoint` in the stopped run that is resumed here, if there is one.
    finished : bool
        Whether the result exists already, from this run or from an equal earlier one.
    """

    resumed: Any = None
    finished = False

    def __init__(
        self,
        channels: Sequence[Channel],
        attributes: Mapping[str, Any],
        not_finite: str = "ignore",
    ) -> None:
        one_of("policy for values that are not finite", not_finite, NAN_POLICIES)
        self.channels, self._policy, self._fault = channels, not_finite, ""
        self.attributes = dict(attributes)
        self.width = channels[-1].columns.stop if channels else 0
        # Times and rows by the number of their first row: rows that are kept twice because of
        # Ctrl-C count once.
        self._kept: dict[int, tuple[Vector, Vector]] = {}
        self._buffer = np.empty(0), np.empty((0, self.width))
        self._first = self._used = 0
        self.last = 0.0
        # The number of rows of a new buffer: at least one, even if a row is very wide.
        self._usual = max(1, min(BUFFER_ROWS, BUFFER_NUMBERS // (1 + self.width)))

    def reserve(self, number: int) -> Vector:
        """Return memory for a `number` of rows [-]; the caller fills it, and then calls `keep`."""
        if self._used + number > len(self._buffer[0]):
            # The kept rows are views of the old buffer, so a new one is
            # made instead of a copy.
            self._put_aside()
            size = max(number, self._usual)
            self._buffer = np.empty(size), np.empty((size, self.width))
        return self._buffer[1][self._used : self._used + number]

    def keep(self, times: Vector | float, number: int = 1) -> None:
        """Keep the first rows of those reserved last.

        Parameters
        ----------
        times : Vector or float
            Their times [s].
        number : int
            Number of rows [-].
        """
        stop = self._used + number
        self._buffer[0][self._used : stop] = times
        self.last, self._used = float(self._buffer[0][stop - 1]), stop

    def _put_aside(self) -> None:
        """Move the rows of the buffer to the kept rows, so that they are not written any more."""
        times, rows = self._buffer
        first = self._first
        if not self._used:
            return
        self._kept[first] = times[: self._used], rows[: self._used]
        # One statement without a call, which Ctrl-C cannot interrupt.
        self._first, self._used, self._buffer = (
            first + self._used,
            0,
            (times[:0], rows[:0]),
        )
        # Once a fault is known, further rows need no test.
        if self._policy != "ignore" and not self._fault:
            self._look(first)

    def _look(self, first: int) -> None:
        """Record the first row that is not finite among those kept under the number `first`.

        Raises
        ------
        DivergenceError
            If the policy is ``"stop"``; the rows from there on are dropped.
        """
        times, rows = self._kept[first]
        with np.errstate(all="ignore"):
            if np.isfinite(rows.sum()):
                # The sum is finite only if all numbers are, and takes a third of the time
                # of a test of each. It may overflow; then each is tested.
                return
        bad = ~np.isfinite(rows)
        for channel in self.channels:
            if channel.is_mode:
                columns = channel.columns
                # A mode may be the infinite time of an event that never occurs.
                bad[:, columns] = np.isnan(rows[:, columns])
        if not bad.any():
            return
        row = int(np.argmax(bad.any(axis=1)))
        names = [
            c.port.path for c in self.channels if c.values(bad[row : row + 1]).any()
        ]
        others = f", and {len(names) - 1} others" if len(names) > 1 else ""
        self._fault = (
            f"'{names[0]}'{others} stopped being finite at t = {times[row]:g} s"
        )
        if self._policy == "stop":
            self._kept[first] = times[:row], rows[:row]
            raise DivergenceError(f"{self._fault}; the log up to there is kept")

    def checkpoint(self, state: Any, of: Mapping[str, Any]) -> None:
        """Write all rows, and the `state` of a run with the identity `of`, to the disk."""
        raise NotImplementedError

    def _collected(self) -> xr.Dataset:
        """Return the kept rows."""
        times, rows = zip(
            # Empty arrays first, as np.concatenate() needs at least one.
            (np.zeros(0), np.zeros((0, self.width))),
            *self._kept.values(),
            strict=True,
        )
        return dataset(self.channels, np.concatenate(times), rows, self.attributes)

    def complete(self, messages: Messages, **attributes: Any) -> xr.Dataset:
        """Return the logged data of a complete run; `messages` and others as for `finish`.

        Raises
        ------
        DivergenceError
            If a logged number is not finite, and the policy is ``"stop"``.
        """
        self._put_aside()
        if self._fault:
            attributes["not_finite"] = self._fault
        result = self.finish(messages, status="complete", **attributes)
        if self._fault:
            warn(
                f"{self._fault}; the states of '{self.attributes['diagram']}' stayed finite, so the run went "
                'on. Look for a division by zero there; not_finite="stop" ends a run there, and "ignore" '
                "gives no warning"
            )
        return result

    def finish(self, messages: Messages, **attributes: Any) -> xr.Dataset:
        """Return the logged data as a dataset, with the `messages` of the run."""
        self.attributes |= attributes
        if messages:
            self.attributes["messages"] = json.dumps(messages)
        return self._dataset()

    def _dataset(self) -> xr.Dataset:
        self._put_aside()
        return self._collected()

    def abandon(
        self, error: BaseException, t: float, messages: Messages, **attributes: Any
    ) -> xr.Dataset:
        """Finish after an error, and raise it; the `result` of a `TrussflowError` is the logged data.

        If a block ended the run, nothing is raised, and the logged data are returned.

        Parameters
        ----------
        error : BaseException
            Exception that ended the run.
        t : float
            Time reached [s].
        messages : mapping of str to sequence of str
            Messages of the run, keyed by block or subsystem.
        **attributes
            As for `finish`; the status is added.

        Raises
        ------
        BaseException
            The error.
        SimulationInterrupted
            Instead of a KeyboardInterrupt; it has a `result`.
        DivergenceError
            Instead of a `TrussflowError`, if a row before it is not finite and the policy is ``"stop"``.
        """
        if isinstance(error, RunStoppedError):
            return self.finish(messages, status="ended", ended=str(error), **attributes)
        if isinstance(error, SimulationInterrupted) and error.result is None:
            raise error  # Ctrl-C while the log was being finished
        try:
            # Before `finish`, which must not raise because of a row that is not finite.
            Log._put_aside(self)
        except DivergenceError as earlier:
            if isinstance(error, TrussflowError):
                # The row that is not finite came first, so it is the likely
                # cause of this error.
                earlier.__cause__ = error
                return self.abandon(earlier, t, messages, **attributes)
        result = self.finish(messages, status=status_of(error), **attributes)
        if isinstance(error, KeyboardInterrupt):
            raise SimulationInterrupted(
                # Rows may be later than t, if Ctrl-C came before the run
                # updated its time.
                f"stopped at t = {max(t, self.last):g} s; the result of this exception holds the log",
                result,
            ) from None
        if isinstance(error, TrussflowError):
            error.result = result
        raise error
