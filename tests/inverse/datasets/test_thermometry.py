"""Reading thermometry files: columns and units that are understood, and files that are refused in one clear line."""

import numpy as np
import pytest

from arfjax.errors import InputError
from inverse.datasets.shipped import shipped
from inverse.datasets.thermometry import read_thermometry
from tests.mutations import mutations

HEADER = "time_s,temperature_c"
GOOD = f"{HEADER}\n0,37\n2.5,38.1\n5,39\n"


def write(tmp_path, text):
    path = tmp_path / "course.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_canonical_file(tmp_path):
    data = read_thermometry(write(tmp_path, GOOD))
    np.testing.assert_array_equal(data.time, [0.0, 2.5, 5.0])
    np.testing.assert_array_equal(data.temperature, [37.0, 38.1, 39.0])
    assert data.t10 is None and data.t90 is None and data.sd is None and data.ignored == ()
    assert len(data) == 3 and not data.occluded.any()


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("t_s,T_avg_C", ("0,37", "60,40")),
        ("Time (min);Temperature [K]", ("0;310.15", "1;313.15")),
        ("# exported\n\ntime_ms\tmean_temperature_c", ("0\t37", "60000\t40")),
        ("time_h,temperature_c", ("0,37", "0.016666666666666666,40")),
        ("t,T\ns,C", ("0,37", "60,40")),
        ("﻿TIME_MIN,temp,note", ("0,37,x", "1,40,y")),
    ],
)
def test_other_headers_and_units(tmp_path, header, cells):
    data = read_thermometry(write(tmp_path, "\n".join((header, *cells)) + "\n"))
    np.testing.assert_allclose(data.time, [0.0, 60.0])
    np.testing.assert_allclose(data.temperature, [37.0, 40.0])


def test_optional_columns(tmp_path):
    text = "t_s,T_avg_C,T10_C,T90_C,temperature_c_sd,occluded,frame\n0,37,37,37.2,0.1,1,a\n2,38,39,37.5,0.2,No,b\n"
    data = read_thermometry(write(tmp_path, text))
    np.testing.assert_array_equal(data.t10, [37.0, 39.0])
    np.testing.assert_array_equal(data.t90, [37.2, 37.5])
    np.testing.assert_array_equal(data.sd, [0.1, 0.2])
    np.testing.assert_array_equal(data.occluded, [True, False])
    assert data.ignored == ("frame",)


def test_the_shipped_set_is_whole_and_licensed():
    data = read_thermometry(shipped("mr_hifu_60s"))
    assert len(data) == 51 and np.flatnonzero(data.occluded).tolist() == [0, 1, 2] and data.ignored == ()
    assert data.time[-1] == 127.9 and data.temperature[25] == data.temperature.max() == 43.643
    assert np.all(data.t10[3:] > data.temperature[3:]) and np.all(data.temperature[3:] > data.t90[3:])
    for companion, holds in (("SOURCE.md", "digitised"), ("LICENSE.txt", "Copyright (c) 2022, mkassinopoulos")):
        assert holds in (shipped("mr_hifu_60s").parent / companion).read_text(encoding="utf-8")


TENTHS = "time_s,temperature_c,t10_c,t90_c\n"
BAD = {
    "empty": ("", "holds no data"),
    "header only": (HEADER + "\n", "no rows"),
    "no time": ("frame,temperature_c\n1,37\n2,38\n", "no column for time; expected a header such as 'time_s'"),
    "no temperature": ("time_s,signal\n1,37\n2,38\n", "no column for temperature"),
    "NaN": (GOOD + "7,nan\n", "line 5, column 'temperature_c': 'nan' is not finite"),
    "text": (GOOD + "7,warm\n", "'warm' is not a number"),
    "ragged": (GOOD + "7\n", "line 5: 1 cells where the header has 2"),
    "truncated": (GOOD[: GOOD.rindex(",")], "1 cells where the header has 2"),
    "one row": (f"{HEADER}\n0,37\n", "only one row"),
    "unsorted": (GOOD + "4,38\n", "line 5, column 'time_s': time 4 is not later than in the row before"),
    "repeated": (GOOD + "5,38\n", "is not later than in the row before"),
    "kelvin": (f"{HEADER}\n0,310\n2,311\n", "looks like kelvin"),
    "too hot": (f"{HEADER}\n0,37\n2,130\n", "line 3, column 'temperature_c': 130 degC is not a temperature of heated"),
    "minutes": (f"{HEADER}\n0,37\n0.04,38\n0.08,39\n", "looks like minutes ('time_min')"),
    "milliseconds": (f"{HEADER}\n0,37\n2500,38\n5000,39\n", "looks like milliseconds"),
    "unknown unit": ("time_s,Temp (F)\n0,99\n2,100\n", "the unit 'F' is not known"),
    "swapped": (f"{TENTHS}0,37,37,37\n2,38,37,39\n", "line 3, column 't10_c': T10, exceeded by a tenth"),
    "zero deviation": ("time_s,temperature_c,temperature_sd_c\n0,37,0.1\n2,38,0\n", "must be positive"),
    "flag": ("time_s,temperature_c,occluded\n0,37,0\n2,38,maybe\n", "'maybe' is not a flag; expected 0 or 1"),
    "binary": (b"\x00\x01\x02\xff\xfe,1\n", "not UTF-8 text"),
}


@pytest.mark.parametrize(("text", "cause"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_refused_in_one_line(tmp_path, text, cause):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as error:
        read_thermometry(path)
    message = str(error.value)
    assert cause in message and "\n" not in message and message.startswith(str(path))


@pytest.mark.parametrize("name", ["kelvin", "too hot", "minutes", "milliseconds"])
def test_trusted_units(tmp_path, name):
    assert len(read_thermometry(write(tmp_path, BAD[name][0]), trust_units=True)) >= 2


def test_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    content, refused = shipped("mr_hifu_60s").read_bytes(), 0
    for damaged in mutations(content, seed=1, count=200):
        path = write(tmp_path, damaged)
        try:
            read_thermometry(path)
        except InputError as error:
            refused += 1
            assert len(str(error).splitlines()) == 1 and str(path) in str(error)
    assert refused > 20
