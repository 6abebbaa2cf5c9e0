"""A model as an S-function for Simulink (level 2, C MEX), around the C code."""

from steelyard.export.code.c_folder_and_self_test import self_test
from steelyard.export.code.c_header_and_source import CCode, filled

LONGEST_NAME = 63  # characters of names in MATLAB


def simulink_files(code: CCode) -> dict[str, str]:
    """Contents by the names of the files, of a model in double precision."""
    block = f"{code.name[: LONGEST_NAME - len('make__sfun')]}_sfun"
    values = code.values | {"block": block}
    return {
        f"{code.name}.h": code.header(),
        f"{code.name}.c": code.source(),
        f"{code.name}_test.c": self_test(code),
        f"{block}.c": filled("simulink/s_function.c", values),
        f"make_{block}.m": f"% Compile the S-function {block}.\nmex {block}.c {code.name}.c\n",
        "README.md": filled("simulink/README.md", values),
    }
