"""One run written in every format by that format's own reference library."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from struct import pack

import h5py
import numpy as np
import polars as pl
import scipy.io

from steelyard.base.arrays import Array

sys.path.append(str(Path(__file__).parents[2] / "tests"))

import bag_writers  # noqa: E402

TOPIC = "/joint_states"


@dataclass(frozen=True, eq=False)
class Table:
    """A run: time in whole nanoseconds, and signals `(N, n)`."""

    joints: tuple[str, ...]
    ns: np.ndarray
    q: Array
    dq: Array
    tau: Array

    @property
    def t(self) -> Array:
        """Seconds."""
        return np.array([int(k) / 1_000_000_000 for k in self.ns])

    @property
    def arrays(self) -> dict[str, Array]:
        """By the names that arrays have in files."""
        return {"t": self.t, "q": self.q, "dq": self.dq, "tau": self.tau}

    @property
    def columns(self) -> dict[str, Array]:
        """Single columns by name."""
        single = {"t": self.t}
        for name in ("q", "dq", "tau"):
            matrix = getattr(self, name)
            single |= {f"{name}_{k + 1}": matrix[:, k] for k in range(matrix.shape[1])}
        return single

    @property
    def notes(self) -> list[bag_writers.Note]:
        """As joint states."""
        rows = zip(self.ns.tolist(), self.q, self.dq, self.tau, strict=True)
        return [bag_writers.joint_state(ns, self.joints, *row, TOPIC) for ns, *row in rows]


def message_columns(table: Table) -> dict[str, str]:
    """What the columns of `Table.columns` are called in a log of messages."""
    names = {"t": f"{TOPIC}/stamp"}
    for short, field in (("q", "position"), ("dq", "velocity"), ("tau", "effort")):
        names |= {
            f"{short}_{k + 1}": f"{TOPIC}/{field}/{joint}" for k, joint in enumerate(table.joints)
        }
    return names


def write_tables(folder: Path, table: Table) -> dict[str, Path]:
    """The formats that hold tables, by label."""
    frame = pl.DataFrame(table.columns)
    files = {
        "CSV": folder / "run.csv",
        "Parquet": folder / "run.parquet",
        "Parquet folder": folder / "parts",
        "npz": folder / "run.npz",
        "npy": folder / "run.npy",
        "MATLAB 5": folder / "run5.mat",
        "MATLAB 7.3": folder / "run73.mat",
        "HDF5": folder / "run.h5",
    }
    frame.write_csv(files["CSV"])
    frame.write_parquet(files["Parquet"], row_group_size=1000)
    for number, start in enumerate(range(0, len(frame), 700)):
        part = files["Parquet folder"] / f"part-{number}.parquet"
        part.parent.mkdir(parents=True, exist_ok=True)
        frame.slice(start, 700).write_parquet(part)
    np.savez_compressed(files["npz"], **table.arrays)
    np.save(files["npy"], frame.to_numpy(structured=True))
    scipy.io.savemat(files["MATLAB 5"], table.arrays, do_compression=True)
    with h5py.File(files["HDF5"], "w") as file:
        for name, values in table.arrays.items():
            file.create_dataset(name, data=values, compression="gzip", shuffle=True)
    write_mat73(files["MATLAB 7.3"], table.arrays)
    return files


def write_mat73(path: Path, arrays: Mapping[str, Array]) -> None:
    """As MATLAB does it: text before HDF5, matrices transposed, classes as attributes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays.items():
            data = np.atleast_2d(values) if values.ndim == 1 else values.T
            file.create_dataset(name, data=data, compression="gzip")
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + pack("<H2s", 0x0200, b"IM"))


def write_messages(folder: Path, table: Table) -> dict[str, Path]:
    """The formats that hold messages, by label."""
    notes = table.notes
    return {
        "MCAP": bag_writers.write_mcap(folder / "run.mcap", notes),
        "ROS 2 bag, sqlite": bag_writers.write_bag2(folder / "bag_sqlite", notes),
        "ROS 2 bag, mcap": bag_writers.write_bag2(folder / "bag_mcap", notes, "mcap"),
        "ROS 2 bag, zstd": bag_writers.write_bag2(folder / "bag_zstd", notes, packed="file"),
        "ROS 1 bag": bag_writers.write_bag1(folder / "run.bag", notes),
    }
