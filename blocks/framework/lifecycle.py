"""What a Python block may do around a run: begin, end, and hand over what it hides."""

from __future__ import annotations

from typing import Any

from trussflow.blocks.framework.declarations import Signals


class Lifecycle:
    """Hooks of Python blocks that keep something besides their declared states.

    A block whose memory is all in declared states needs none of them: these are restored, and
    set to their initial values, by themselves. A block that holds more (a library's solver, an
    open file, a model that steps itself in `update`) overrides

    * `on_start`, to go back to the beginning: a second run must not continue the first;
    * `on_stop`, to release what `on_start` took;
    * `on_save` and `on_restore`, so that a session can go back to an earlier time.

    What is hidden should change in `update` only, which is called once per instant.
    """

    def on_start(self, p: Signals) -> None:
        """Go back to the beginning; called when a run starts, before anything else.

        Parameters
        ----------
        p : Signals
            Parameters by name [units as declared].
        """

    def on_stop(self) -> None:
        """Release everything; called when a run ends, whatever ended it."""

    def on_save(self) -> Any:
        """Return a copy of what the block hides, for `on_restore` of this or an equal block.

        Numbers, strings, bytes, NumPy arrays of numbers, and lists, tuples and dicts of such
        can be written to files too.
        """
        return None

    def on_restore(self, saved: Any) -> None:
        """Take back what `on_save` returned; it may be restored again, so it must not change."""

    @property
    def hides(self) -> bool:
        """Whether the block says, by overriding a hook, that it keeps something undeclared."""
        own = type(self)
        return any(getattr(own, hook) is not getattr(Lifecycle, hook) for hook in _HOOKS)

    @property
    def restorable(self) -> bool:
        """Whether saving covers the block: it hides nothing, or overrides `on_save`."""
        return not self.hides or type(self).on_save is not Lifecycle.on_save

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy gets: everything but who is running the block."""
        return {name: value for name, value in self.__dict__.items() if name != "_running"}


_HOOKS = ("on_start", "on_stop", "on_save", "on_restore")
