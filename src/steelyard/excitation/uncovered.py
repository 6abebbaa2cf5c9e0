"""Notes that say what a certificate does not cover."""


class Gap(str):
    """A note on something that was not looked at, though it may matter."""

    __slots__ = ()


class Declined(Gap):
    """A note on something that was not checked at the user's request."""

    __slots__ = ()
