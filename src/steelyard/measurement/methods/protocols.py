"""How positions become motion: the protocols that every method of `[processing] motion` meets.

A method is a frozen dataclass of settings with a name; `designed` makes of it, for a cut-off and a
rate, a pure function from measured channels to motion. A local one says its halo, and any split of
a segment into parts gives the same; one without a halo is given the whole segment at once.
"""

from typing import ClassVar, Protocol, runtime_checkable

from steelyard.arrays import Array


class Designed(Protocol):
    """A method made for one cut-off and rate."""

    @property
    def halo(self) -> int | None:
        """Samples of context on each side; `None`: the whole segment at once."""
        ...

    def __call__(self, q: Array, dq: Array | None) -> Array:
        """Motion of uniformly sampled channels.

        Args:
            q: Positions with context, shape `(n, N + 2 halo)` [rad; m].
            dq: Logged velocities, the same shape [rad/s; m/s]; `None`: positions are
                differentiated.

        Returns:
            `q, dq, ddq`, shape `(3, n, N)`.
        """
        ...


class Smooth(Protocol):
    """A smoother made for one cut-off and rate."""

    @property
    def halo(self) -> int | None:
        """Samples of context on each side; `None`: the whole segment at once."""
        ...

    def __call__(self, extended: Array) -> Array:
        """Channels with context, shape `(C, N + 2 halo)`, to smoothed ones, shape `(C, N)`."""
        ...


@runtime_checkable
class Method(Protocol):
    """A way from positions to motion: `motion = ...` under `[processing]`; frozen dataclass."""

    name: ClassVar[str]

    def designed(self, cutoff: float, rate: float) -> Designed:
        """The method for a cut-off and a rate.

        Args:
            cutoff: Frequency up to which motion is kept [Hz], below half the rate.
            rate: Of the uniform clock [Hz].
        """
        ...


@runtime_checkable
class Choosing(Method, Protocol):
    """A method some settings of which come from the log: `prepare` calls it once per log."""

    def chosen(
        self, q: Array, dq: Array | None, rate: float, band: float, *, whole: bool
    ) -> Method:
        """The method with what is not given found in a log.

        Args:
            q: Positions of a stretch of the log, uniformly sampled, shape `(n, N)`.
            dq: Logged velocities, the same shape, if there are any.
            rate: [Hz].
            band: Frequency below which the motion lives [Hz].
            whole: Whether the log may be worked on as a whole.
        """
        ...


@runtime_checkable
class Causal(Method, Protocol):
    """A method that looks at no later sample: its motion is late."""

    def lateness(self, cutoff: float) -> float:
        """How late slow accelerations are at most [s].

        Args:
            cutoff: Of the motion [Hz].
        """
        ...


@runtime_checkable
class Smoother(Protocol):
    """A way to smooth efforts: `effort = ...` under `[processing]`; frozen dataclass."""

    name: ClassVar[str]

    def smooth(self, cutoff: float, rate: float) -> Smooth:
        """The smoother for a cut-off and a rate.

        Args:
            cutoff: [Hz], below half the rate.
            rate: Of the uniform clock [Hz].
        """
        ...
