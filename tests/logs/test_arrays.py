"""Files of named arrays: which are the table, what its columns are called, what is refused."""

import zlib
from collections.abc import Callable
from pathlib import Path
from struct import pack
from typing import Any
from zipfile import ZIP_DEFLATED, ZIP_LZMA, ZipFile

import h5py
import numpy as np
import pytest
import scipy.io

from steelyard.base.errors import LogError
from steelyard.logs.formats import open_log
from steelyard.logs.named_arrays_and_numpy_files import ArraysLog

N = 40
T = 0.01 * np.arange(N)
Q = np.random.default_rng(1).normal(size=(N, 3))


def opened(path: Path) -> ArraysLog:
    log = open_log(path)
    assert isinstance(log, ArraysLog)
    return log


def table(log: ArraysLog, size: int = 7) -> dict[str, np.ndarray]:
    whole = np.concatenate(list(log.parts(log.columns, (0, None), size)))
    return dict(zip(log.columns, whole.T, strict=True))


def of_npz(path: Path, arrays: dict[str, Any]) -> Path:
    np.savez(path.with_suffix(".npz"), **arrays)
    return path.with_suffix(".npz")


def of_mat(path: Path, arrays: dict[str, Any]) -> Path:
    scipy.io.savemat(path.with_suffix(".mat"), arrays)
    return path.with_suffix(".mat")


def of_squeezed_mat(path: Path, arrays: dict[str, Any]) -> Path:
    scipy.io.savemat(path.with_suffix(".mat"), arrays, do_compression=True)
    return path.with_suffix(".mat")


def of_hdf5(path: Path, arrays: dict[str, Any]) -> Path:
    with h5py.File(path.with_suffix(".h5"), "w", track_order=True) as file:
        for name, values in arrays.items():
            file[name] = values
    return path.with_suffix(".h5")


def of_mat73(path: Path, arrays: dict[str, Any]) -> Path:
    """As MATLAB does it: text before HDF5, matrices transposed, classes as attributes."""
    target = path.with_suffix(".mat")
    classes = {"f8": "double", "f4": "single", "i2": "int16", "b1": "logical"}
    with h5py.File(target, "w", userblock_size=512, track_order=True) as file:
        for name, values in arrays.items():
            array = np.atleast_2d(values)
            array = array if array.dtype.kind != "b" else array.astype("u1")
            file[name] = array if np.ndim(values) == 1 else array.T
            kind = classes[np.asarray(values).dtype.str[1:]]
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)
        file["#refs#/a"] = T
    with target.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + pack("<H2s", 0x0200, b"IM"))
    return target


WRITERS = [of_npz, of_mat, of_squeezed_mat, of_hdf5, of_mat73]


@pytest.mark.parametrize("write", WRITERS)
def test_vectors_and_matrices_of_one_length_are_the_table(
    tmp_path: Path, write: Callable[[Path, dict[str, Any]], Path]
) -> None:
    flags = np.arange(N) % 3 == 0
    given = {"t": T, "q": Q, "tau": Q.T.astype("f4"), "raw": np.asfortranarray(Q + 1.0),
             "flag": flags, "mode": np.arange(N).astype("i2"), "gain": np.array(2.5),
             "limits": np.ones((6, 2)), "cube": np.ones((N, 2, 2))}  # fmt: skip
    if write is of_mat73:
        given["gain"] = np.array([2.5])
    log = opened(write(tmp_path / "run", given))
    found = table(log)
    joints = [f"{name}_{k}" for name in ("q", "tau", "raw") for k in (1, 2, 3)]
    assert list(log.columns) == ["t", *joints, "flag", "mode"]
    np.testing.assert_array_equal(found["t"], T)
    for k in range(3):
        np.testing.assert_array_equal(found[f"q_{k + 1}"], Q[:, k])
        np.testing.assert_array_equal(found[f"tau_{k + 1}"], Q[:, k].astype("f4"))
        np.testing.assert_array_equal(found[f"raw_{k + 1}"], Q[:, k] + 1.0)
    np.testing.assert_array_equal(found["flag"], flags)
    np.testing.assert_array_equal(found["mode"], np.arange(N))
    reasons = dict(log.left_out)
    assert reasons["gain"] == "one number"
    assert reasons["limits"] in ("its size is 6 x 2, where the table has 40 rows",
                                 "its size is 2 x 6, where the table has 40 rows")  # fmt: skip
    assert reasons["cube"] == "it has 3 axes"


@pytest.mark.parametrize("write", WRITERS)
def test_the_length_that_most_numbers_share_wins(
    tmp_path: Path, write: Callable[[Path, dict[str, Any]], Path]
) -> None:
    given = {"slow": np.arange(7.0), "t": T, "q": Q, "fast": np.arange(100.0)}
    log = opened(write(tmp_path / "run", given))
    assert log.n_rows == N and log.columns == ("t", "q_1", "q_2", "q_3")
    assert [name for name, _ in log.left_out] == ["slow", "fast"]
    with pytest.raises(LogError, match="'slow' is no column of the table: its size is") as caught:
        list(log.parts(("slow",)))
    assert "t, q_1, q_2, q_3" in caught.value.fix


@pytest.mark.parametrize("write", [of_npz, of_mat, of_hdf5])
def test_a_file_without_a_table_is_refused(
    tmp_path: Path, write: Callable[[Path, dict[str, Any]], Path]
) -> None:
    path = write(tmp_path / "run", {"gain": np.array(2.5)})
    with pytest.raises(LogError, match="no table of numbers .'gain': one number.") as caught:
        open_log(path)
    assert "one row per sample" in caught.value.fix


def test_python_objects_are_never_unpickled(tmp_path: Path) -> None:
    path = of_npz(tmp_path / "run", {"t": T, "meta": np.array([{"a": 1}], dtype=object)})
    assert dict(opened(path).left_out)["meta"].endswith("which are never unpickled")
    alone = of_npz(tmp_path / "alone", {"meta": np.array([{"a": 1}], dtype=object)})
    with pytest.raises(LogError, match="Python objects, which are never unpickled"):
        open_log(alone)
    np.save(tmp_path / "one.npy", np.array([{"a": 1}], dtype=object))
    with pytest.raises(LogError, match="Python objects, which are never unpickled"):
        open_log(tmp_path / "one.npy")


RECORDS = np.zeros(N, dtype=[("t", "f8"), ("q", "f4", (3,)), ("name", "U4")])
RECORDS["t"], RECORDS["q"] = T, Q


def test_records_have_their_fields_as_columns(tmp_path: Path) -> None:
    np.save(tmp_path / "run.npy", RECORDS)
    log = opened(tmp_path / "run.npy")
    assert log.columns == ("t", "q_1", "q_2", "q_3")
    np.testing.assert_array_equal(table(log)["q_2"], Q[:, 1].astype("f4"))
    both = opened(of_npz(tmp_path / "both", {"a": RECORDS, "b": RECORDS[["t"]]}))
    assert both.columns == ("a/t", "q_1", "q_2", "q_3", "b/t")
    plain = opened(of_hdf5(tmp_path / "run", {"run/log": RECORDS[["t", "q"]]}))
    assert plain.columns == ("run/log/t", "run/log/q_1", "run/log/q_2", "run/log/q_3")
    np.testing.assert_array_equal(table(plain)["run/log/q_3"], Q[:, 2].astype("f4"))


@pytest.mark.parametrize(
    ("array", "columns"),
    [(Q, ("column_1", "column_2", "column_3")), (T, ("column_1",)), (Q[:, :1], ("column_1",)),
     (Q[:, 1:].T, ("column_1", "column_2"))],
)  # fmt: skip
def test_a_lone_array_has_numbered_columns(
    tmp_path: Path, array: np.ndarray, columns: tuple[str, ...]
) -> None:
    np.save(tmp_path / "run.npy", array)
    log = opened(tmp_path / "run.npy")
    assert log.columns == columns and log.n_rows == N


def test_structs_of_matlab_are_paths(tmp_path: Path) -> None:
    given = {
        "data": {"Time": T, "Data": Q, "info": {"robot": "arm", "raw": Q[:, 0]}},
        "many": np.array([(T,), (2.0 * T,)], dtype=[("v", "O")]),
        "cells": np.array([T, "a"], dtype=object),
        "z": T + 1j,
    }
    log = opened(of_squeezed_mat(tmp_path / "run", given))
    assert log.columns == ("data.Time", "data.Data_1", "data.Data_2", "data.Data_3",
                           "data.info.raw", "many(1).v", "many(2).v")  # fmt: skip
    np.testing.assert_array_equal(table(log)["many(2).v"], 2.0 * T)
    np.testing.assert_array_equal(table(log)["data.Data_3"], Q[:, 2])
    assert dict(log.left_out) == {"data.info.robot": "it is text", "cells": "it is a cell array",
                                  "z": "it holds complex numbers"}  # fmt: skip


@pytest.mark.parametrize("name", ["testmatrix_7.4_GLNX86", "testdouble_6.1_SOL2", "big_endian",
                                  "miuint32_for_miint32", "testbool_8_WIN64"])  # fmt: skip
def test_files_that_matlab_wrote(name: str) -> None:
    path = Path(scipy.io.__file__).parent / "matlab" / "tests" / "data" / f"{name}.mat"
    if not path.exists():
        pytest.skip("SciPy came without the files of its tests")
    log = opened(path)
    wanted = {k: v for k, v in scipy.io.loadmat(path).items() if k[0] != "_" and v.dtype != object}
    for key, values in wanted.items():
        columns = [c for c in log.columns if c.rpartition("_")[0] == key or c == key]
        found = np.concatenate(list(log.parts(columns)))
        np.testing.assert_array_equal(found, values if values.shape[0] == log.n_rows else values.T)


def test_small_integers_stand_for_doubles_in_matlab(tmp_path: Path) -> None:
    """MATLAB stores a matrix of doubles in fewer bytes if they are whole, four of them in a tag."""
    head = b"MATLAB 5.0".ljust(116) + bytes(8) + pack("<H2s", 0x0100, b"IM")

    def variable(name: bytes, count: int, numbers: bytes) -> bytes:
        flags, shape = pack("<4I", 6, 8, 6, 0), pack("<2I2i", 5, 8, 1, count)
        body = flags + shape + pack("<2H", 1, len(name)) + name.ljust(4, b"\0") + numbers
        return pack("<2I", 14, len(body)) + body

    path = tmp_path / "run.mat"
    path.write_bytes(head + variable(b"t", 4, pack("<2H4B", 2, 4, 1, 2, 3, 250))
                     + variable(b"q", 4, pack("<2I8B", 2, 4, 9, 8, 7, 6, 0, 0, 0, 0)))  # fmt: skip
    found = table(opened(path))
    np.testing.assert_array_equal(found["t"], [1, 2, 3, 250])
    np.testing.assert_array_equal(found["q"], [9, 8, 7, 6])


def matlab(*variables: bytes) -> bytes:
    """A file of such variables."""
    head = b"MATLAB 5.0".ljust(116) + bytes(8) + pack("<H2s", 0x0100, b"IM")
    return head + b"".join(variables)


def start_of_matrix(klass: int, count: int, name: bytes, length: int) -> bytes:
    """The headers of a vector of a class, whose content has a length."""
    flags, shape = pack("<4I", 6, 8, klass, 0), pack("<2I2i", 5, 8, count, 1)
    body = flags + shape + pack("<2H4s", 1, len(name), name)
    return pack("<2I", 14, len(body) + length) + body


def test_structs_that_lie_too_deep_are_left_out(tmp_path: Path) -> None:
    """SciPy's `loadmat` crashes on these."""
    numbers = pack("<2I", 9, 8 * N) + T.tobytes()
    field = pack("<2H4s2I8s", 5, 4, pack("<i", 8), 1, 8, b"x")
    blocks = [start_of_matrix(6, N, b"", len(numbers)) + numbers]
    length = len(blocks[0])
    for depth in range(20_000):
        name = b"a" if depth == 19_999 else b""
        blocks.append(start_of_matrix(2, 1, name, len(field) + length) + field)
        length += len(blocks[-1])
    time = start_of_matrix(6, N, b"t", len(numbers)) + numbers
    path = tmp_path / "run.mat"
    path.write_bytes(matlab(time, *reversed(blocks)))
    log = opened(path)
    assert log.columns == ("t",)
    assert [why for _, why in log.left_out] == ["it lies more than 16 structs deep"]


@pytest.mark.parametrize(
    ("klass", "why"), [(1, "a cell array"), (2, "one of more than 1000 structs")]
)
def test_announced_elements_of_matlab_need_no_memory(
    tmp_path: Path, peak: Callable[[], float], klass: int, why: str
) -> None:
    """SciPy's `loadmat` takes 1.5 GiB for 200 bytes."""
    numbers = pack("<2I", 9, 8 * N) + T.tobytes()
    time = start_of_matrix(6, N, b"t", len(numbers)) + numbers
    path = tmp_path / "run.mat"
    path.write_bytes(matlab(time, start_of_matrix(klass, 200_000_000, b"c", 0)))
    log = opened(path)
    assert log.columns == ("t",) and why in dict(log.left_out)["c"]
    assert peak() < 16.0


def test_old_matlab_is_refused(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "run.mat", {"t": T}, format="4")
    with pytest.raises(LogError, match="no MATLAB file of version 5 or later") as caught:
        open_log(tmp_path / "run.mat")
    assert "'-v7.3'" in caught.value.fix


def test_classes_of_matlab_that_are_no_numbers_are_left_out(tmp_path: Path) -> None:
    path = of_mat73(tmp_path / "run", {"t": T, "label": Q[:, 0], "none": T, "s/q": Q})
    with h5py.File(path, "r+") as file:
        file["label"].attrs["MATLAB_class"] = np.bytes_("char")
        file["none"].attrs["MATLAB_empty"] = np.uint8(1)
    log = opened(path)
    assert log.columns == ("t", "s.q_1", "s.q_2", "s.q_3")
    np.testing.assert_array_equal(table(log)["s.q_2"], Q[:, 1])
    assert dict(log.left_out) == {"label": "it is of MATLAB's class char", "none": "it is empty"}


def test_hdf5_leads_to_no_other_file(tmp_path: Path) -> None:
    other = of_hdf5(tmp_path / "other", {"x": T})
    raw = tmp_path / "raw.bin"
    raw.write_bytes(T.tobytes())
    path = of_hdf5(tmp_path / "run", {"t": T})
    with h5py.File(path, "r+") as file:
        file["linked"] = h5py.ExternalLink(str(other), "/x")
        file["again"] = h5py.SoftLink("/t")
        file["note"] = "recorded at noon"
        layout = h5py.VirtualLayout((N,), "f8")
        layout[:] = h5py.VirtualSource(str(other), "x", (N,))
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("outside", (N,), "f8", external=[(str(raw), 0, 8 * N)])
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((8,))
        plist.set_filter(32015, h5py.h5z.FLAG_OPTIONAL)
        h5py.h5d.create(
            file.id, b"zstd", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((N,)), plist
        )
        file.create_dataset("wide", (1 << 23,), "f8", chunks=(1 << 23,))
        file.create_dataset("hollow", (1 << 40,), "f8", chunks=(1 << 10,))
    log = opened(path)
    assert log.columns == ("t",)
    reasons = dict(log.left_out)
    assert "link to another file" in reasons["linked"]
    assert reasons["note"] == "it holds no real numbers"
    assert "virtual dataset" in reasons["virtual"]
    assert "in another file" in reasons["outside"]
    assert "filter 32015" in reasons["zstd"]
    assert "larger than 32 MiB" in reasons["wide"] and "h5repack" in reasons["wide"]
    assert "much larger than its stored" in reasons["hollow"]
    assert "again" not in reasons


def test_groups_that_hold_each_other_end(tmp_path: Path) -> None:
    path = of_hdf5(tmp_path / "run", {"a/t": T})
    with h5py.File(path, "r+") as file:
        file["a/self"] = file["a"]
        file["twice"] = file["a/t"]
    assert len(opened(path).columns) == 1


def test_a_crash_of_the_hdf5_library_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = of_hdf5(tmp_path / "run", {"t": T})
    log = opened(path)
    code = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"
    monkeypatch.setattr("steelyard.logs.hdf5_matlab.CHILD", (*_python(), "-c", code))
    with pytest.raises(LogError, match="the HDF5 library crashed on it"):
        list(log.parts(("t",)))


def _python() -> tuple[str, ...]:
    from steelyard.logs.hdf5_matlab import CHILD

    return CHILD[:1]


def npy(header: bytes, data: bytes = b"", length: int | None = None) -> bytes:
    size = len(header) if length is None else length
    return b"\x93NUMPY\x02\x00" + pack("<I", size) + header + data


GOOD = b"{'descr': '<f8', 'fortran_order': False, 'shape': (%s), }\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"PK\x03\x04 not this", "the magic string is not correct"),
        (npy(GOOD % b"4,", bytes(24)), "larger than the file"),
        (npy(GOOD % b"1000000000000,", bytes(24)), "larger than the file"),
        (npy(GOOD % b"-4,", bytes(24)), "makes no sense"),
        (npy(GOOD % b"'a',", bytes(24)), "shape is not valid"),
        (npy(b"__import__('os').abort()\n"), "cannot be read"),
        (npy(b"(" * 500), "cannot be read"),
        (npy(b"{}\n"), "cannot be read"),
        (npy(b"", length=4_000_000_000), "cannot be read: it is 4000000000 bytes long"),
        (b"\x93NUMPY\x04\x00" + pack("<I", 60) + GOOD % b"3,", "header of an array cannot be read"),
    ],
)
def test_headers_of_numpy_that_make_no_sense(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "run.npy").write_bytes(content)
    with pytest.raises(LogError) as caught:
        open_log(tmp_path / "run.npy")
    assert words in caught.value.wrong and "copy it again" in caught.value.fix
    assert len(caught.value.wrong) < 250


def test_archives_that_are_not_numpys(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with ZipFile(path, "w", ZIP_LZMA) as archive:
        archive.writestr("t.npy", npy(GOOD % b"40,", T.tobytes()))
    with pytest.raises(LogError, match="its compression is not one that NumPy writes"):
        open_log(path)
    path.write_bytes(b"no archive")
    with pytest.raises(LogError, match="broken or cut off .File is not a zip file"):
        open_log(path)


def test_a_flipped_bit_in_an_archive_is_found(tmp_path: Path) -> None:
    path = of_npz(tmp_path / "run", {"t": T})
    raw = bytearray(path.read_bytes())
    raw[200] ^= 1
    path.write_bytes(raw)
    with pytest.raises(LogError, match="Bad CRC-32"):
        list(opened(path).parts(("t",)))


def test_a_damaged_array_leaves_the_others_of_an_archive_readable(tmp_path: Path) -> None:
    t = 0.01 * np.arange(2000)
    path = of_npz(tmp_path / "run", {"t": t, "q": np.sin(t)})
    path.write_bytes(path.read_bytes().replace(np.sin(t)[900:904].tobytes(), bytes(32)))
    log = opened(path)
    np.testing.assert_array_equal(np.concatenate(list(log.parts(("t",))))[:, 0], t)
    with pytest.raises(LogError, match="Bad CRC-32 for file 'q.npy'"):
        list(log.parts(("q",)))


@pytest.mark.slow
def test_bombs_are_read_in_constant_memory(tmp_path: Path, peak: Callable[[], float]) -> None:
    """Many megabytes of zeros in little: rows are handed out, nobody holds them all."""
    rows = 1 << 25
    path = tmp_path / "run.npz"
    with ZipFile(path, "w", ZIP_DEFLATED) as archive, archive.open("t.npy", "w") as member:
        member.write(npy(GOOD % b"%d," % rows))
        for _ in range(rows >> 17):
            member.write(bytes(1 << 20))
    log = opened(path)
    next(log.parts(("t",)))
    assert log.n_rows == rows and peak() < 64.0


def test_a_lying_stream_of_matlab_is_refused(tmp_path: Path) -> None:
    path = of_mat(tmp_path / "run", {"t": T})
    raw = path.read_bytes()
    body = raw[128:].replace(pack("<2i", 1, N), pack("<2i", 1, 1 << 30))
    squeezed = zlib.compress(body)
    path.write_bytes(raw[:128] + pack("<2I", 15, len(squeezed)) + squeezed)
    with pytest.raises(LogError, match="'t' has a wrong declared size"):
        open_log(path)


def test_an_array_of_too_many_columns_is_left_out(tmp_path: Path) -> None:
    path = of_npz(tmp_path / "run", {"t": np.arange(60_000.0), "w": np.ones((60_000, 1), "i1"),
                                     "wide": np.ones((5, 60_000), "i1")})  # fmt: skip
    assert opened(path).columns == ("t", "w", *(f"wide_{k}" for k in range(1, 6)))
    square = {"t": np.arange(5000.0), "image": np.ones((5000, 5000), "i1")}
    log = opened(of_npz(tmp_path / "square", square))
    assert log.columns == ("t",) and dict(log.left_out) == {"image": "more than 4096 columns"}


def test_members_of_one_name_and_arrays_without_columns_are_refused(tmp_path: Path) -> None:
    import io
    import warnings
    from zipfile import ZipFile

    content = io.BytesIO()
    np.save(content, np.arange(300.0))
    with warnings.catch_warnings(), ZipFile(tmp_path / "same.npz", "w") as archive:
        warnings.simplefilter("ignore")
        for _ in range(2):
            archive.writestr("t.npy", content.getvalue())
    log = open_log(tmp_path / "same.npz")
    with pytest.raises(LogError, match="2 columns that are called 't'"):
        list(log.parts(["t"]))
    assert list(log.parts([])) == []
    np.save(tmp_path / "empty.npy", np.empty((1000, 0)))
    with pytest.raises(LogError, match="no table of numbers"):
        open_log(tmp_path / "empty.npy")
