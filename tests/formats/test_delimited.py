from pathlib import Path

import numpy as np
import pytest

from steelyard.errors import LogError
from steelyard.formats import delimited as delimited_module
from steelyard.formats import open_log

NAN = np.nan


def read(
    path: Path, content: str | bytes, columns: tuple[str, ...] = ("t", "a", "b")
) -> np.ndarray:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return np.concatenate(list(open_log(path).parts(columns)))


@pytest.mark.parametrize(
    "content",
    [
        "t,a,b\n0,1.5,-2e-1\n1,2.5,3\n",
        "t;a;b\n0;1.5;-2e-1\n1;2.5;3\n",
        "t;a;b\n0;1,5;-0,2\n1;2,5;3\n",
        "t\ta\tb\r\n0\t1.5\t-0.2\r\n1\t2.5\t3\r\n",
        "t a b\n0 1.5 -0.2\n1 2.5 3",
        "   t    a     b\n   0  1.5  -0.2 \n   1  2.5   3\n",
        '"t","a","b"\n"0","1.5","-0.2"\n1,2.5,3\n\n\n',
        "# t, a, b\n0, 1.5, -0.2\n1, 2.5, 3\n",
        "%t,a,b\n0,1.5,-0.2\n1,2.5,3\n",
        "\n\nt,a,b\n0,1.5,-0.2\n1,2.5,3\n",
        b"\xef\xbb\xbft,a,b\n0,1.5,-0.2\n1,2.5,3\n",
    ],
)
def test_dialects(tmp_path: Path, content: str | bytes) -> None:
    np.testing.assert_array_equal(
        read(tmp_path / "run.csv", content), [[0.0, 1.5, -0.2], [1.0, 2.5, 3.0]]
    )


def test_broken_cells_are_nan_and_no_row_is_lost(tmp_path: Path) -> None:
    content = (
        b"t,a,b\n0,1,2\n1,oops,2\n2,,2\n3,1e293,inf\n4,1\n5,1,2,9,9\n\n"
        b'7,"1,2\n8,\xff\xfe,2\n9,\x001,2\n10,"x,y",2\n11,1'
    )
    np.testing.assert_array_equal(
        read(tmp_path / "run.csv", content),
        [
            [0, 1, 2],
            [1, NAN, 2],
            [2, NAN, 2],
            [3, 1e293, np.inf],
            [4, 1, NAN],
            [5, 1, 2],
            [NAN, NAN, NAN],
            [7, 1, 2],
            [8, NAN, 2],
            [9, NAN, 2],
            [10, NAN, 2],
            [11, 1, NAN],
        ],
    )


def test_a_first_row_that_is_cut_does_not_cut_the_table(tmp_path: Path) -> None:
    np.testing.assert_array_equal(
        read(tmp_path / "run.csv", "t,a,b\n0\n1,2,3\n"), [[0, NAN, NAN], [1, 2, 3]]
    )


def test_chunks_do_not_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = np.arange(300.0).reshape(100, 3)
    text = "t,a,b\n" + "".join(f"{a},{b},{c}\n" for a, b, c in table)
    whole = read(tmp_path / "run.csv", text)
    monkeypatch.setattr(delimited_module, "CHUNK", 7 * 11)
    np.testing.assert_array_equal(read(tmp_path / "run.csv", text), whole)
    np.testing.assert_array_equal(whole, table)
    parts = open_log(tmp_path / "run.csv").parts(("t", "a", "b"), (13, 57), 4)
    np.testing.assert_array_equal(np.concatenate(list(parts)), table[13:57])


def test_a_table_without_header_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="names no columns") as caught:
        read(tmp_path / "run.csv", "0.01,1.5,2\n0.02,1.5,2\n")
    assert "line 1" in caught.value.where and "header" in caught.value.mend


@pytest.mark.parametrize("content", [b"\n\n", b" \n"])
def test_a_blank_file_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(LogError, match="holds no table"):
        read(tmp_path / "run.csv", content)


@pytest.mark.parametrize("content", ["t,a\n0,1\n".encode("utf-16"), b"PAR1\x00\x15,\x00\n"])
def test_what_is_no_text_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(LogError, match="not a text table") as caught:
        read(tmp_path / "run.csv", content)
    assert ".parquet" in caught.value.mend


def test_a_name_given_twice_is_ambiguous(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="2 columns that are called 'a'"):
        read(tmp_path / "run.csv", "t,a,a\n0,1,2\n", ("t", "a"))
