"""Files of data acquisition as other libraries write them: asammdf's and npTDMS' writers, SciPy's savemat, and h5py."""

from __future__ import annotations

import h5py
import numpy as np
import scipy.io

COUNT, STEP = 400, 1e-3
T = STEP * np.arange(COUNT)
A = 100.0 * np.random.default_rng(3).normal(size=COUNT)
B = np.round(A).astype("i2")
HEAD = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  6 10:00:00 2025 HDF5 schema 1.00 ."


def mdf(path, *groups, version="4.10"):
    """groups: (acquisition name, [asammdf.Signal])."""
    from asammdf import MDF

    with MDF(version=version) as file:
        for name, signals in groups:
            file.append(signals, acq_name=name, common_timebase=True)
        file.save(path, overwrite=True)
    return path


def signal(name, values=A, time=T, unit="um/m", **more):
    from asammdf import Signal

    return Signal(values, time, name=name, unit=unit, **more)


def tdms(path, channels):
    """channels: "group/name" → values, properties."""
    from nptdms import ChannelObject, RootObject, TdmsWriter

    with TdmsWriter(path) as file:
        file.write_segment(
            [RootObject({}), *(ChannelObject(*name.split("/"), *channel) for name, channel in channels.items())]
        )
    return path


def waveform(values=A, unit="um/m", step=STEP, **more):
    return values, {"wf_increment": step, "wf_start_offset": 0.0, "wf_samples": 1, "unit_string": unit, **more}


def mat5(path, variables):
    scipy.io.savemat(path, variables, do_compression=True)
    return path


def mat73(path, variables):
    """As MATLAB writes it: HDF5 behind a text of 512 bytes, matrices transposed, text as numbers, structs as groups."""
    with h5py.File(path, "w", userblock_size=512) as file:
        put(file, variables)
    with path.open("r+b") as file:
        file.write(HEAD.ljust(124) + b"\x00\x02IM")
    return path


def put(group, variables):
    for name, value in variables.items():
        if isinstance(value, dict):
            put(group.create_group(name), value)
            group[name].attrs["MATLAB_class"] = np.bytes_("struct")
        elif isinstance(value, str):
            group[name] = np.array([[ord(sign)] for sign in value], "u2")
            group[name].attrs["MATLAB_class"] = np.bytes_("char")
        else:
            values = np.atleast_2d(np.asarray(value)).T
            group[name] = values
            group[name].attrs["MATLAB_class"] = np.bytes_(
                {"f8": "double", "i2": "int16"}.get(values.dtype.str[1:], "single")
            )
