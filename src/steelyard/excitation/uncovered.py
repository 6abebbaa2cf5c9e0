"""Notes that say what a certificate does not cover."""


class Gap(str):
    """A note on something that was not looked at, though it may matter."""

    __slots__ = ()


class Declined(Gap):
    """A note on something that was not looked at because the user asked for it."""

    __slots__ = ()
