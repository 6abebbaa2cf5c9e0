"""Identified models as code for controllers: C99, Python with NumPy alone, FMU."""
