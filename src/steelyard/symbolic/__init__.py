"""Expression programs, their derivatives and bounds, and machine code made of them."""
