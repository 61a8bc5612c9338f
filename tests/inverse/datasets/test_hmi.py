"""Reading HMI files: columns and units that are understood, and files that are refused in one clear line."""

import numpy as np
import pytest

from arfjax.errors import InputError
from inverse.datasets.hmi import read_hmi
from inverse.datasets.shipped import shipped
from tests.mutations import mutations

HEADER = "sonication,temperature_c,displacement_percent"
GOOD = f"{HEADER}\na,37,100\na,50,98\nb,37,100\nb,70,90.5\n"
TIMES = "time_s,displacement_um\n0,2.5\n30,2.4\n60,2.0\n"


def write(tmp_path, text):
    path = tmp_path / "hmi.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_percent_by_temperature(tmp_path):
    data = read_hmi(write(tmp_path, GOOD))
    assert data.sonication == ("a", "a", "b", "b") and data.labels == ("a", "b") and data.rows_of("b") == [2, 3]
    np.testing.assert_array_equal(data.temperature, [37.0, 50.0, 37.0, 70.0])
    np.testing.assert_array_equal(data.displacement, [100.0, 98.0, 100.0, 90.5])
    assert data.in_percent and data.time is None and data.sd is None and data.ignored == ()


def test_micrometres_by_time(tmp_path):
    data = read_hmi(write(tmp_path, TIMES))
    np.testing.assert_array_equal(data.time, [0.0, 30.0, 60.0])
    np.testing.assert_allclose(data.displacement, [2.5e-6, 2.4e-6, 2.0e-6])
    assert not data.in_percent and data.temperature is None and data.labels == ("1",)


def test_time_starts_again_with_each_sonication_and_other_columns_are_named(tmp_path):
    text = "shot,time_min,temp,displacement_nm,note\n1,0,37,900,x\n1,1,60,800,y\n2,0,37,950,z\n2,0.5,50,940,\n"
    data = read_hmi(write(tmp_path, text))
    np.testing.assert_array_equal(data.time, [0.0, 60.0, 0.0, 30.0])
    np.testing.assert_array_equal(data.temperature, [37.0, 60.0, 37.0, 50.0])
    np.testing.assert_allclose(data.displacement, [9.0e-7, 8.0e-7, 9.5e-7, 9.4e-7])
    assert data.ignored == ("note",)


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("Exposure,Temperature (K),Displacement (µm)", "a,310.15,2.5"),
        ("run;Temp [°C];Displacement [μm]", "a;37;2.5"),
        ("# exported\n\nsonication\ttemperature_k\tdisplacement_nm", "a\t310.15\t2500"),
        ("﻿SONICATION,TEMPERATURE_C,Displacement_mm", "a,37,0.0025"),
        ("sonication,T,disp\n,C,um", "a,37,2.5"),
        ("sonication,T,displacement\n-,[K],[nm]", "a,310.15,2500"),
        ("temperature_c,displacement_m", "37,2.5e-6"),
    ],
)
def test_other_headers_and_units(tmp_path, header, cells):
    warmer = cells.replace("310.15", "311.15").replace("37", "38")
    data = read_hmi(write(tmp_path, f"{header}\n{cells}\n{warmer}\n"))
    np.testing.assert_allclose(data.temperature, [37.0, 38.0])
    np.testing.assert_allclose(data.displacement, 2.5e-6)
    assert not data.in_percent and data.ignored == ()


@pytest.mark.parametrize(
    "header",
    [
        "temperature_c,displacement_percent",
        "temperature_c,displacement_pct",
        "temperature_c,Displacement (%)",
        "temperature_c,Displacement [percent]",
        "temperature_c,Normalised displacement (%)",
        "temperature_c,normalized_displacement",
        "temperature_c,displacement\ndegC,%",
    ],
)
def test_percent_by_any_name(tmp_path, header):
    data = read_hmi(write(tmp_path, f"{header}\n37,100\n50,98\n"))
    assert data.in_percent
    np.testing.assert_array_equal(data.displacement, [100.0, 98.0])


@pytest.mark.parametrize(
    ("displacement", "sd", "expected"),
    [
        ("displacement_um", "displacement_um_sd", 4e-6),
        ("displacement_um", "displacement_sd_um", 4e-6),
        ("displacement_um", "displacement_sd_nm", 4e-9),
        ("displacement_um", "Displacement SD (um)", 4e-6),
        ("displacement_percent", "displacement_percent_sd", 4.0),
        ("displacement_percent", "displacement_sd_percent", 4.0),
        ("displacement_percent", "Displacement SD (%)", 4.0),
    ],
)
def test_standard_deviation_by_any_name(tmp_path, displacement, sd, expected):
    data = read_hmi(write(tmp_path, f"temperature_c,{displacement},{sd}\n37,100,4\n50,98,4\n"))
    np.testing.assert_allclose(data.sd, expected)
    assert data.ignored == ()


def test_shipped_set():
    data = read_hmi(shipped("suomi2016_hmi"))
    assert len(data.displacement) == 11 and data.labels == ("1", "2", "3") and data.in_percent
    assert data.temperature.max() == 84.0
    assert (shipped("suomi2016_hmi").parent / "SOURCE.md").stat().st_size > 200


ONE_SD = "temperature_c,displacement_um,{}\n37,2,{}\n50,2,1\n"
BAD = {
    "empty": ("", "holds no data"),
    "only comments": ("# nothing\n", "holds no data"),
    "header only": (HEADER + "\n", "no rows"),
    "no delimiter": ("displacement_percent\n100\n", "no comma, semicolon or tab"),
    "neither time nor temperature": ("sonication,displacement_um\na,2\nb,3\n", "no column for time or temperature"),
    "no displacement": ("sonication,temperature_c\na,37\na,50\n", "no column for displacement"),
    "both displacements": (
        "temperature_c,displacement_um,displacement_percent\n37,2,100\n50,2,99\n",
        "both in percent and as a length",
    ),
    "no unit": ("temperature_c,displacement\n37,2\n50,2\n", "column 'displacement': the displacement has no unit"),
    "unknown unit": ("Temperature (F),displacement_um\n99,2\n120,2\n", "the unit 'F' is not known"),
    "not a number": (GOOD + "b,nan,90\n", "line 6, column 'temperature_c': 'nan' is not finite"),
    "infinite": (GOOD + "b,80,inf\n", "line 6, column 'displacement_percent': 'inf' is not finite"),
    "text": (GOOD + "b,warm,90\n", "'warm' is not a number"),
    "blank cell": (GOOD + "b,,90\n", "the cell is empty"),
    "blank sonication": (GOOD + ",80,90\n", "line 6, column 'sonication': the cell is empty"),
    "decimal comma": ("temperature_c;displacement_um\n37;2.5\n50;2,4\n", "write decimals with a point"),
    "zero displacement": (
        GOOD + "b,80,0\n",
        "line 6, column 'displacement_percent': the displacement must be positive",
    ),
    "negative displacement": (GOOD + "b,80,-3\n", "the displacement must be positive"),
    "ragged": (GOOD + "b,80\n", "line 6: 2 cells where the header has 3"),
    "long row": (GOOD + "b,80,90,1\n", "line 6: 4 cells where the header has 3"),
    "binary": (b"\x00\x01\x02\xff\xfe,1\n", "not UTF-8 text"),
    "null bytes": (b"a,b\0\n1,2\n", "null bytes"),
    "workbook": (b"PK\x03\x04rest", "spreadsheet"),
    "utf-16": (GOOD.encode("utf-16"), "UTF-16"),
    "one row": (f"{HEADER}\na,37,100\n", "only one row"),
    "one row twice": (f"{HEADER}\na,37,100\na,37,100\n", "only one row, written 2 times; a curve needs"),
    "same meaning twice": (f"{HEADER},temp\na,37,100,37\na,50,98,50\n", "means the same as column 'temperature_c'"),
    "kelvin": (f"{HEADER}\na,310.15,100\na,330,98\n", "look like kelvin"),
    "too hot": (GOOD + "b,121,90\n", "line 6, column 'temperature_c': 121 degC is not a temperature of tissue"),
    "too cold": (GOOD + "b,-1,90\n", "-1 degC is not a temperature of tissue"),
    "fraction": (f"{HEADER}\na,37,1\na,50,0.98\n", "look like fractions"),
    "length as percent": (f"{HEADER}\na,37,2500\na,50,2400\n", "is it a length?"),
    "metres as micrometres": ("temperature_c,displacement_um\n37,2e-6\n50,2e-6\n", "not one of HMI"),
    "micrometres as metres": ("temperature_c,displacement_m\n37,2.5\n50,2.4\n", "not one of HMI"),
    "negative time": ("time_s,displacement_um\n-1,2\n5,2\n", "line 2, column 'time_s': time must not be negative"),
    "negative time behind a copy": (
        "sonication,time_s,displacement_um\n1,1,5\n1,1,5\n1,2,6\n2,-1,5\n2,3,6\n",
        "line 5, column 'time_s': time must not be negative",
    ),
    "time runs back": (TIMES + "59,2\n", "line 5, column 'time_s': time does not increase within sonication 1"),
    "time stands still": (
        TIMES + "60,1.9\n",
        "line 5, column 'time_s': the time is that of the row before in sonication 1, of another reading; give time",
    ),
    "zero deviation": (ONE_SD.format("displacement_um_sd", 0), "line 2, column 'displacement_um_sd'"),
    "negative deviation": (ONE_SD.format("displacement_um_sd", -1), "a standard deviation must be positive"),
    "deviation in another unit": (ONE_SD.format("displacement_percent_sd", 1), "call the column 'displacement_um_sd'"),
    "deviation without unit": (ONE_SD.format("displacement_sd", 1), "call the column 'displacement_um_sd'"),
    "percent with bare deviation": (
        "temperature_c,displacement_percent,displacement_sd\n37,100,1\n50,98,1\n",
        "call the column 'displacement_percent_sd'",
    ),
    "too large": (GOOD + "b,80,1e200\n", "'1e200' is too large"),
    "open quotation": (f'{HEADER}\n"a,37,100\na,50,98\n', "quotation mark"),
}


@pytest.mark.parametrize(("text", "cause"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_refused_in_one_line(tmp_path, text, cause):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as error:
        read_hmi(path)
    message = str(error.value)
    assert cause in message
    assert len(message.splitlines()) == 1 and message.startswith(str(path))


def test_missing_file_and_folder(tmp_path):
    (tmp_path / "file").write_text("")
    for path, cause in (
        (tmp_path / "absent.csv", "no such file"),
        (tmp_path, "is a folder"),
        (tmp_path / "file" / "below.csv", "cannot be read"),
    ):
        with pytest.raises(InputError, match=cause):
            read_hmi(path)


def test_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    refused = 0
    for text in (GOOD, TIMES + "70,1.9\n"):
        for damaged in mutations(text.encode(), seed=2, count=200):
            path = write(tmp_path, damaged)
            try:
                data = read_hmi(path)
            except InputError as error:
                refused += 1
                assert len(str(error).splitlines()) == 1 and str(path) in str(error)
            else:
                assert np.all(np.isfinite(data.displacement)) and len(data.displacement) > 1
    assert refused > 100


def test_a_row_that_is_written_twice_is_one_with_times_as_without(tmp_path):
    """Times that stand still are of another reading; a copy is none, wherever it stands."""
    path = tmp_path / "hmi.csv"
    path.write_text("time_s,displacement_um\n0,10\n5,9\n5,9\n10,8\n0,10\n")
    data = read_hmi(path)
    np.testing.assert_array_equal(data.time, [0.0, 5.0, 10.0])
    assert data.n_copies == 2 and data.lines == (2, 3, 5)
    path.write_text("time_s,displacement_um\n0,10\n5,9\n5,9\n10,8\n9,7\n")
    with pytest.raises(InputError, match=r"line 6, column 'time_s': time does not increase within sonication 1"):
        read_hmi(path)
