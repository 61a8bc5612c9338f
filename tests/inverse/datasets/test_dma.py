"""Reading DMA files: headers and units that are understood, and files that are refused in one clear line."""

import dataclasses

import numpy as np
import pytest

from arfjax.errors import InputError
from inverse.datasets.dma import DmaData, frequency_groups, group_sweeps, read_dma
from inverse.datasets.shipped import shipped, shipped_names
from tests.mutations import mutations

HEADER = "frequency_hz,temperature_c,storage_modulus_pa,loss_modulus_pa"
ROWS = "0.1,37,1200,100\n1,37.2,1500,200\n10,37.1,1900,250\n"
GOOD = f"{HEADER}\n{ROWS}"


def write(tmp_path, text):
    path = tmp_path / "data.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def two_rows(cells):
    """The cells of a row at 37 degC, and those of one at 38."""
    return f"{cells}\n{cells.replace('310.15', '311.15').replace('37', '38')}\n"


def test_canonical_file(tmp_path):
    data = read_dma(write(tmp_path, GOOD))
    np.testing.assert_array_equal(data.frequency_hz, [0.1, 1.0, 10.0])
    np.testing.assert_array_equal(data.temperature_c, [37.0, 37.2, 37.1])
    np.testing.assert_array_equal(data.storage_modulus, [1200.0, 1500.0, 1900.0])
    np.testing.assert_allclose(data.modulus_magnitude, np.hypot([1200, 1500, 1900], [100, 200, 250]))
    assert data.sample == () and data.ignored_columns == ()


@pytest.mark.parametrize(
    ("header", "cells"),
    [
        ("f,T,E_stor,E_loss\nHz,C,MPa,MPa", "1,37,0.0015,0.0002"),
        ("Frequency (Hz),Temperature (°C),E' (MPa),E'' (MPa)", "1,37,0.0015,0.0002"),
        ("Frequency [Hz];Temp [°C];G' [kPa];G\" [kPa]", "1;37;1.5;0.2"),
        ("Frequency, Hz;Temperature, C;Storage modulus, MPa;Loss modulus, MPa", "1;37;0.0015;0.0002"),
        ("Frequency, Hz;Temperature, C;Storage modulus, MPa;Loss modulus, MPa", "1,0;37,0;0,0015;0,0002"),
        ("Frequency, Hz\tTemperature, C\tStorage modulus, MPa\tLoss modulus, MPa", "1\t37\t0.0015\t0.0002"),
        ("omega_rad_s\ttemp_C\tEp_MPa\tEpp_MPa", "6.283185307179586\t37\t0.0015\t0.0002"),
        ("# exported\n\nfreq,temperature_k,storage modulus (Pa),loss modulus (Pa)", "1,310.15,1500,200"),
        ("frequency (rad/s),temp,E′ MPa,E″ MPa", "6.283185307179586,37,0.0015,0.0002"),
        ("Frequency (kHz),temp,E′ MPa,E″ MPa", "0.001,37,0.0015,0.0002"),
        ("﻿FREQUENCY_HZ,Temperature_C,Storage_Modulus_GPa,Loss_Modulus_kPa,note", "1,37,1.5e-6,0.2,x"),
    ],
)
def test_other_headers_and_units(tmp_path, header, cells):
    data = read_dma(write(tmp_path, f"{header}\n{two_rows(cells)}"))
    np.testing.assert_allclose(data.frequency_hz, 1.0)
    np.testing.assert_allclose(data.temperature_c, [37.0, 38.0])
    np.testing.assert_allclose(data.storage_modulus, 1500.0)
    np.testing.assert_allclose(data.loss_modulus, 200.0)


@pytest.mark.parametrize(
    ("header", "cells", "unused"),
    [
        ("f,T,E' (Pa),tan_delta", "1,37,1500,0.2", ()),
        ("f,T,E' (Pa),tan(delta)", "1,37,1500,0.2", ()),
        ("f,T,E' (Pa),tan δ", "1,37,1500,0.2", ()),
        ("f,T,|E*| (Pa),Loss factor", "1,37,1529.7058540778355,0.2", ()),
        ("f,T,E' (Pa),E'' (Pa),tan_delta", "1,37,1500,300,7", ("tan_delta",)),
        ("f,T,E'' (Pa),tan_delta", "1,37,300,0.2", ()),
        ("f,T,E'' (Pa),|E*| (Pa),tan_delta", "1,37,7,1529.7058540778355,0.2", ("E'' (Pa)",)),
        ("f,omega,T,E' (Pa),tan_delta", "1,6.3,37,1500,0.2", ("omega",)),
        ("f,T,|E*| (Pa),|E*| sd (Pa),tan_delta", "1,37,1529.7058540778355,9,0.2", ("|E*| sd (Pa)",)),
    ],
)
def test_loss_by_its_tangent(tmp_path, header, cells, unused):
    data = read_dma(write(tmp_path, f"{header}\n{two_rows(cells)}"))
    np.testing.assert_allclose(data.storage_modulus, 1500.0)
    np.testing.assert_allclose(data.loss_modulus, 300.0)
    assert data.ignored_columns == unused


def test_a_modulus_beside_the_magnitude_is_said_to_be_unused(tmp_path):
    data = read_dma(write(tmp_path, "f,T,E' (Pa),|E*| (Pa)\n1,37,1500,1529\n2,37,1500,1529\n"))
    assert not data.has_phase and data.ignored_columns == ("E' (Pa)",)


@pytest.mark.parametrize(
    ("stated", "deviation", "unused"),
    [
        ({"E'_sd_pa": 30, "E''_sd_pa": 40}, 50.0 / np.sqrt(2.0), ("|E*|",)),
        ({"E'_sd_pa": 30, "E''_sd_pa": 40, "|E*|_sd_pa": 7}, 7.0, ("|E*|", "E'_sd_pa", "E''_sd_pa")),
        ({"|E*|_sd_pa": 7}, 7.0, ("|E*|",)),
        ({}, None, ("|E*|",)),
    ],
)
def test_the_magnitude_alone_has_the_deviations_that_are_stated(tmp_path, stated, deviation, unused):
    """Those stated for it, or else sqrt((G' s')^2 + (G'' s'')^2) / |G*|; what is used then is not said to be unused."""
    header = ",".join(["f,T,E',E'',|E*|", *stated])
    rows = "".join(",".join([f"{f},37,3000,3000,4243", *map(str, stated.values())]) + "\n" for f in (1, 2))
    path = write(tmp_path, f"{header}\n{rows}")
    data = read_dma(path, magnitude_only=True)
    assert not data.has_phase and data.storage_modulus_sd is None and data.ignored_columns == unused
    np.testing.assert_array_equal(data.modulus_magnitude, read_dma(path).modulus_magnitude)
    if deviation is None:
        assert data.modulus_magnitude_sd is None
    else:
        np.testing.assert_allclose(data.modulus_magnitude_sd, deviation, rtol=1e-12)


def test_a_loss_tangent_of_0_gives_no_storage_modulus(tmp_path):
    with pytest.raises(InputError, match="line 3, column 'tan_delta': a loss tangent of 0 gives no storage modulus"):
        read_dma(write(tmp_path, "f,T,E'' (Pa),tan_delta\n1,37,300,0.2\n2,37,300,0\n"))


def test_semicolons_with_decimal_commas_and_rows_of_nothing(tmp_path):
    text = GOOD.replace(",", ";").replace("0.1;", "0,1;").replace("37.", "37,").replace("1900", "1,9e3")
    data = read_dma(write(tmp_path, f"{text};;;\n".replace("\n1;", "\n;;;\n1;")))
    np.testing.assert_array_equal(data.frequency_hz, [0.1, 1.0, 10.0])
    np.testing.assert_array_equal(data.temperature_c, [37.0, 37.2, 37.1])
    np.testing.assert_array_equal(data.storage_modulus, [1200.0, 1500.0, 1900.0])


@pytest.mark.parametrize(("before", "behind"), [("", ","), ("", ",,,"), (",", "")])
def test_columns_of_which_nothing_is_written(tmp_path, before, behind):
    """As instruments and spreadsheets end each line with a comma."""
    lines = GOOD.strip().split("\n")
    data = read_dma(write(tmp_path, "".join(f"{before}{line}{behind}\n" for line in lines)))
    expected = read_dma(write(tmp_path, GOOD))
    np.testing.assert_array_equal(data.storage_modulus, expected.storage_modulus)
    np.testing.assert_array_equal(data.frequency_hz, expected.frequency_hz)
    assert data.ignored_columns == ()


def test_magnitude_deviations_samples_and_time(tmp_path):
    text = (
        "time_min,sample,frequency_hz,temperature_c,modulus_magnitude_kpa,modulus_magnitude_sd_pa\n"
        "0,a,1,37,1.5,20\n1,a,2,37,1.6,30\n0,b,1,37,1.7,40\n"
    )
    data = read_dma(write(tmp_path, text))
    np.testing.assert_allclose(data.modulus_magnitude, [1500.0, 1600.0, 1700.0])
    np.testing.assert_allclose(data.modulus_magnitude_sd, [20.0, 30.0, 40.0])
    np.testing.assert_allclose(data.time_s, [0.0, 60.0, 0.0])
    assert data.sample == ("a", "a", "b") and not data.has_phase


def test_deviations_with_the_unit_before_or_behind(tmp_path):
    header = f"{HEADER},storage_modulus_sd_kpa,loss_modulus_pa_sd"
    data = read_dma(write(tmp_path, f"{header}\n1,37,1500,200,0.01,5\n2,37,1500,200,0.02,6\n"))
    np.testing.assert_allclose(data.storage_modulus_sd, [10.0, 20.0])
    np.testing.assert_allclose(data.loss_modulus_sd, [5.0, 6.0])


BAD = {
    "empty": ("", "holds no data"),
    "only comments": ("# nothing\n", "holds no data"),
    "header only": (HEADER + "\n", "no rows"),
    "no delimiter": ("frequency_hz\n1\n", "no comma, semicolon or tab"),
    "no frequency": ("temperature_c,storage_modulus_pa,loss_modulus_pa\n37,1500,200\n", "no column for frequency"),
    "no temperature": ("frequency_hz,storage_modulus_pa,loss_modulus_pa\n1,1500,200\n", "'temperature_c'"),
    "no modulus": ("frequency_hz,temperature_c,force\n1,37,2\n", "no column for the modulus"),
    "no loss": ("frequency_hz,temperature_c,storage_modulus_pa\n1,37,1500\n", "no column for loss modulus"),
    "force is not frequency": ("F,T,E',E''\n1,37,1500,200\n", "no column for frequency"),
    "not a number": (GOOD + "20,37,NaN,100\n", "line 5, column 'storage_modulus_pa': 'NaN' is not finite"),
    "infinite": (GOOD + "inf,37,1500,100\n", "line 5, column 'frequency_hz'"),
    "text": (GOOD + "20,warm,1500,100\n", "line 5, column 'temperature_c': 'warm' is not a number"),
    "blank cell": (GOOD + "20,37,,100\n", "the cell is empty"),
    "decimal comma": (GOOD.replace(",", ";") + "20;37;1500,5;100\n", "write decimals with a point"),
    "too large": (GOOD + "20,37,1e300,100\n", "line 5, column 'storage_modulus_pa': '1e300' is too large"),
    "negative storage": (GOOD + "20,37,-1500,100\n", "storage modulus -1500 must be positive"),
    "negative loss": (GOOD + "20,37,1500,-1\n", "loss modulus -1 must be zero or positive; leave out the range"),
    "zero frequency": (GOOD + "0,37,1500,100\n", "frequency 0 is not positive"),
    "negative frequency": (GOOD + "-2,37,1500,100\n", "frequency -2 is not positive"),
    "ragged": (GOOD + "20,37,1500\n", "line 5: 3 cells where the header has 4"),
    "long row": (GOOD + "20,37,1500,3,4\n", "line 5: 5 cells where the header has 4"),
    "binary": (b"\x00\x01\x02\xff\xfe,1\n", "not UTF-8 text"),
    "null bytes": (b"a,b\0\n1,2\n", "null bytes"),
    "workbook": (b"PK\x03\x04rest", "spreadsheet"),
    "utf-16": (GOOD.encode("utf-16"), "UTF-16"),
    "latin-1": ("Temp (°C),f\n1,2\n".encode("latin-1"), "not UTF-8 text"),
    "one row": (f"{HEADER}\n1,37,1500,200\n", "only one row"),
    "duplicate header": (f"{HEADER},frequency_hz\n1,37,1500,200,1\n", "occurs twice"),
    "duplicate meaning": (f"{HEADER},freq\n1,37,1500,200,1\n", "means the same as column 'frequency_hz'"),
    "nameless column": (f"{HEADER},\n1,37,1500,200,\n2,37,1600,200,5\n", "column 5 has no name"),
    "nameless columns": (",,,\n,,,\n", "column 1 has no name"),
    "empty column of a ragged file": (f"{HEADER},\n1,37,1500,200,\n2,37,1600,200\n", "column 5 has no name"),
    "comma behind rows alone": (f"{HEADER}\n1,37,1500,200,\n", "line 2: 5 cells where the header has 4"),
    "empty column of a name": (f"{HEADER},time_s\n1,37,1500,200,\n2,37,1600,200,\n", "the cell is empty"),
    "unknown unit": ("frequency_hz,Temp (F),E' (Pa),E'' (Pa)\n1,99,1500,200\n", "the unit 'F' is not known"),
    "kelvin": (GOOD.replace("37", "310"), "looks like kelvin"),
    "below zero": (GOOD + "1,-300,1500,200\n", "above absolute zero"),
    "kilopascal": (f"{HEADER}\n1,37,1.5,0.2\n2,37,1.6,0.3\n", "looks like kPa or MPa"),
    "kilopascal of loss": (
        "f,T,E'' (Pa),tan_delta\n1,37,1.5,0.2\n2,37,1.6,0.3\n",
        "no modulus is above 7.6",
    ),
    "degrees": ("f,T,E' (Pa),tan_delta\n1,37,1500,9\n2,37,1600,12\n", "10.5, which looks like a phase in degrees"),
    "degrees of a loss": ("f,T,E'' (Pa),tan_delta\n1,37,1500,9\n2,37,1600,12\n", "looks like a phase in degrees"),
    "one row twice": (f"{HEADER}\n1,37,1500,200\n1,37,1500,200\n", "only one row that is written 2 times; expected"),
    "loss in another unit": (f"{HEADER}\n1,37,1500,0.2\n2,37,1600,0.3\n", "as if in another unit"),
    "too stiff": (f"{HEADER}\n1,37,1.5e13,2\n2,37,1.6e13,3\n", "stiffer than diamond"),
    "time": (f"{HEADER},time_s\n1,37,1500,200,5\n2,37,1600,200,4\n", "line 3, column 'time_s': time 4 is earlier"),
    "time of each sweep": (
        f"{HEADER},time_s\n1,37,1500,200,0\n2,37,1600,200,9\n1,45,1500,200,0\n",
        "line 4, column 'time_s': time 0 is earlier than in the row before; sort the rows by time, give time that runs",
    ),
    "time of each sweep, sorted": (
        f"{HEADER},time_s\n1,37,1500,200,0\n1,45,1500,200,0\n2,37,1600,200,9\n2,45,1600,200,9\n",
        "line 3, column 'time_s': the time is that of the row before, at 45 degC as at 37",
    ),
    "time that stands": (
        f"{HEADER},sample,time_s\n1,37,1500,200,a,5\n2,37,1600,200,a,5\n1,37,1500,200,b,1\n2,37,1600,200,b,2\n",
        "column 'time_s': the time is 5 s in every row of a; give time that runs on, or leave the column out",
    ),
    "negative tangent": ("f,T,E' (Pa),tan_delta\n1,37,1500,-1\n2,37,1500,1\n", "loss tangent -1 must be zero or"),
    "thousands": (GOOD + '20,37,"1,500.5",100\n', "write numbers without commas between thousands"),
    "millions": (GOOD + '20,37,"1,500,500",100\n', "write numbers without commas between thousands"),
    "thousands or decimals": (
        GOOD.replace(",", ";") + "20;37;12,500;100\n",
        "write 12500 if the comma is between thousands, 12.500 if it is before decimals",
    ),
    "decimals alone": (GOOD.replace(",", ";") + "20;37;0,125;100\n", "number; write decimals with a point"),
    "preamble": (f"Instrument: Q800\n{GOOD}", "line 1: no comma, semicolon or tab in the header; begin lines before"),
    "half the deviations": (f"{HEADER},storage_modulus_sd_pa\n1,37,1500,200,5\n2,37,1500,200,5\n", "go together"),
    "zero deviation": (
        f"{HEADER},storage_modulus_sd_pa,loss_modulus_sd_pa\n1,37,1500,200,0,5\n2,37,1500,200,5,5\n",
        "storage modulus sd 0 must be positive",
    ),
    "sample in its first row": (
        f"{HEADER},sample\n1,37,1500,200,a\n2,37,1600,200,\n1,37,1500,200,b\n",
        "line 3, column 'sample': the cell is empty; name the row's sample, in every row of it",
    ),
    "deviations without a unit beside moduli in kPa": (
        "frequency_hz,temperature_c,storage_modulus_kpa,loss_modulus_kpa,storage_modulus_sd,loss_modulus_sd\n"
        "1,20,10,1,0.5,0.05\n2,20,11,1.1,0.5,0.05\n",
        "column 'storage_modulus_sd': has no unit, where 'storage_modulus_kpa' is in kpa; name its unit in the header",
    ),
    "a loss without a unit beside kPa": (
        "frequency_hz,temperature_c,storage_modulus_kpa,loss_modulus\n1,20,10,15\n2,20,11,16\n",
        "column 'loss_modulus': has no unit",
    ),
    "open quotation": (f'{HEADER}\n1,37,"1500,200\n2,37,1500,200\n', "quotation mark"),
}


@pytest.mark.parametrize(("text", "cause"), BAD.values(), ids=BAD.keys())
def test_bad_input_is_refused_in_one_line(tmp_path, text, cause):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as error:
        read_dma(path)
    message = str(error.value)
    assert cause in message
    assert "\n" not in message and message.startswith(str(path))


def test_missing_file_and_folder(tmp_path):
    for path, cause in ((tmp_path / "absent.csv", "no such file"), (tmp_path, "is a folder")):
        with pytest.raises(InputError, match=cause):
            read_dma(path)


def test_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    content = shipped("pyvisco_polymer").read_bytes()
    refused = 0
    for damaged in mutations(b"".join(content.splitlines(keepends=True)[:40]), seed=1, count=200):
        path = write(tmp_path, damaged)
        try:
            read_dma(path)
        except InputError as error:
            refused += 1
            assert len(str(error).splitlines()) == 1 and str(path) in str(error)
    assert refused > 20


@pytest.mark.parametrize("name", ["kelvin", "kilopascal", "too stiff", "kilopascal of loss", "degrees"])
def test_trusted_units(tmp_path, name):
    assert len(read_dma(write(tmp_path, BAD[name][0]), trust_units=True)) >= 2


def test_sweeps_are_split_at_a_kelvin_and_sorted():
    temperature = np.array([37.9, 50.0, 37.0, 36.2, 50.9, 38.8, 50.0])
    frequency = np.array([3.0, 1.0, 2.0, 1.0, 0.5, 4.0, 9.0])
    data = DmaData(frequency, temperature, np.full(7, 1e3), sample=("a",) * 6 + ("b",))
    sweeps = group_sweeps(data)
    assert [(sweep.sample, len(sweep.data)) for sweep in sweeps] == [("a", 4), ("a", 2), ("b", 1)]
    np.testing.assert_array_equal(sweeps[0].data.frequency_hz, [1.0, 2.0, 3.0, 4.0])
    assert sweeps[1].temperature_c == pytest.approx(50.45)


def test_sweeps_that_no_gap_divides_are_refused():
    frequency, temperature = np.tile([1.0, 2.0, 4.0], 8), np.repeat(20.0 + np.arange(8.0), 3)
    data = DmaData(frequency, temperature, np.full(24, 1e3))
    with pytest.raises(InputError, match=r"^sweeps from 20 to 27 degC cannot be told apart.*'sample'"):
        group_sweeps(data)
    named = dataclasses.replace(data, sample=("a",) * 24)
    with pytest.raises(InputError, match=r"^sample a: sweeps from 20"):
        group_sweeps(named)
    assert len(group_sweeps(dataclasses.replace(data, sample=tuple(str(t) for t in temperature)))) == 8
    # A single sweep may warm up, and repeats scatter.
    assert len(group_sweeps(DmaData(np.geomspace(1.0, 9.0, 8), 20.0 + np.arange(8.0), np.full(8, 1e3)))) == 1
    assert len(group_sweeps(DmaData(np.ones(3), np.array([37.0, 37.9, 38.8]), np.full(3, 1e3)))) == 1


def test_frequencies_within_a_thousandth_are_the_same():
    frequency = np.array([10.0, 1.0, 1.0004, 5.0, 0.9999, 10.0, 5.02])
    np.testing.assert_array_equal(frequency_groups(frequency), [3, 0, 0, 1, 0, 3, 2])
    assert frequency_groups(np.zeros(0)).size == 0


def test_shipped_sets_are_whole_and_licensed():
    rows = {"pyvisco_polymer": (210, 21, 10), "nist_foam": (995, 68, 1)}
    assert set(shipped_names()) == {*rows, "mr_hifu_60s", "suomi2016_hmi", "suomi2016_experiment"}
    for name, (count, n_sweeps, n_frequencies) in rows.items():
        data = read_dma(shipped(name))
        sweeps = group_sweeps(data)
        assert (len(data), len(sweeps)) == (count, n_sweeps)
        assert {sweep.data.distinct_frequencies for sweep in sweeps} == {n_frequencies}
        for companion in ("SOURCE.md", "LICENSE.txt"):
            assert (shipped(name).parent / companion).stat().st_size > 200
    first = read_dma(shipped("pyvisco_polymer"))
    assert first.storage_modulus[0] == pytest.approx(8097.175545e6)
    with pytest.raises(InputError, match="no shipped data set"):
        shipped("liver")


def test_moduli_without_any_unit_are_in_pascals(tmp_path):
    """As are those without one beside others in pascals."""
    for loss in ("loss_modulus", "loss_modulus_pa"):
        data = read_dma(
            write(tmp_path, f"frequency_hz,temperature_c,storage_modulus,{loss}\n1,20,1e4,15\n2,20,1e4,16\n")
        )
        np.testing.assert_array_equal(data.loss_modulus, [15.0, 16.0])
