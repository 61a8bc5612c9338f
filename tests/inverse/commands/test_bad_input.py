"""Every kind of bad input to every command: one line, exit status 2, no file left behind, earlier results kept."""

import contextlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from inverse.commands.main import run
from inverse.output import output_directory

ROOT = Path(__file__).parents[3]
EXAMPLE = (ROOT / "examples" / "suomi2016.toml").read_text(encoding="utf-8")
DMA = "frequency_hz,temperature_c,storage_modulus_pa,loss_modulus_pa\n0.1,37,1200,100\n1,37,1500,200\n10,37,1900,250\n"
SWEEP = DMA + "20,37,2300,300\n50,37,2700,350\n90,37,3000,400\n"
"""Enough for a diagnosis."""
HMI = "sonication,temperature_c,displacement_percent\na,37,100\na,50,98\n"
TIMES = "time_s,displacement_percent\n0,100\n60,98\n"

ABSENT, FOLDER = object(), object()

ANY_TABLE = {
    "no such file": ABSENT,
    "a folder": FOLDER,
    "empty": "",
    "binary": b"\x89PNG\r\n\x1a\n\x00\x00\xff",
    "null bytes": b"a,b\x00\n1,2\n",
    "workbook": b"PK\x03\x04rest",
}
BAD_DMA = ANY_TABLE | {
    "header only": DMA.splitlines()[0] + "\n",
    "missing column": "frequency_hz,temperature_c,storage_modulus_pa\n1,37,1200\n2,37,1300\n",
    "NaN": DMA + "20,37,nan,100\n",
    "text": DMA + "20,37,soft,100\n",
    "negative modulus": DMA + "20,37,-1900,100\n",
    "zero frequency": DMA + "0,37,1900,100\n",
    "ragged row": DMA + "20,37,1900\n",
    "one row": "".join(DMA.splitlines(keepends=True)[:2]),
    "kelvin": DMA.replace("37", "310"),
    "kilopascal": DMA.splitlines()[0] + "\n1,37,1.5,0.2\n2,37,1.6,0.3\n",
    "truncated": DMA[: DMA.rindex(",")],
}
BAD_HMI = ANY_TABLE | {
    "header only": HMI.splitlines()[0] + "\n",
    "missing column": "sonication,temperature_c\na,37\na,50\n",
    "NaN": HMI + "a,nan,97\n",
    "text": HMI + "a,warm,97\n",
    "negative displacement": HMI + "a,60,-97\n",
    "ragged row": HMI + "a,60\n",
    "one row": "".join(HMI.splitlines(keepends=True)[:2]),
    "kelvin": HMI.replace("37", "310").replace("50", "323"),
    "fraction": HMI.replace("100", "1.0").replace("98", "0.98"),
    "unsorted time": TIMES + "30,99\n",
    "after the end": TIMES + "90,97\n",
    "below the start": HMI + "b,20,100\nb,50,98\n",
    "never heated": HMI + "b,36,100\nb,36.5,98\n",
}
HEATING = "time_s,temperature_c\n" + "".join(f"{2.5 * row},{37 + min(row, 8 - 0.5 * row)}\n" for row in range(9))
BAD_HEATING = ANY_TABLE | {
    "header only": HEATING.splitlines()[0] + "\n",
    "missing column": "time_s,signal\n0,37\n2,38\n",
    "NaN": HEATING + "25,nan\n",
    "text": HEATING + "25,warm\n",
    "ragged row": HEATING + "25\n",
    "one row": "".join(HEATING.splitlines(keepends=True)[:2]),
    "kelvin": HEATING.replace(",3", ",31").replace(",4", ",31"),
    "minutes": "time_s,temperature_c\n" + "".join(f"{0.04 * row},{37 + row}\n" for row in range(9)),
    "unsorted time": HEATING + "3,38\n",
    "truncated": HEATING[: HEATING.rindex(",")],
    "too few rows": "".join(HEATING.splitlines(keepends=True)[:6]),
    "never heated": "time_s,temperature_c\n" + "".join(f"{2.5 * row},{37 - 0.1 * row}\n" for row in range(9)),
}
BAD_EXPERIMENTS = {
    "no such file": ABSENT,
    "a folder": FOLDER,
    "empty": "",
    "binary": b"\x89PNG\r\n\x1a\n\x00\x00\xff",
    "broken": EXAMPLE.replace("[transducer]", "[transducer"),
    "truncated": EXAMPLE[: EXAMPLE.index("[protocol]")],
    "unknown key": EXAMPLE.replace("push_ms", "push_us"),
    "missing key": EXAMPLE.replace("frequency_mhz = 1.1", ""),
    "text": EXAMPLE.replace("62.6", '"62.6"'),
    "NaN": EXAMPLE.replace("62.6", "nan"),
    "metres": EXAMPLE.replace("62.6", "0.0626"),
    "zero frequency": EXAMPLE.replace("= 1.1", "= 0"),
    "kelvin": EXAMPLE.replace("[35.0, 40.0", "[308.0, 313.0"),
    "impossible geometry": EXAMPLE.replace("= 64.0", "= 130.0"),
    "focus outside": EXAMPLE.replace("thickness_mm = 40.0", "thickness_mm = 4.0"),
}
ANCHORS = "anchor_temperatures_c = [35.0, 45.0, 55.0, 65.0, 84.0]"
BAD_CALIBRATIONS = {
    "unknown key": (("reference_temperature_c", "reference_temprature_c"), "did you mean `reference_temperature_c`?"),
    "unknown key below": (
        ("[calibration.lesion]", "[calibration.lesion]\nrelaxation_time_sd = 1.0"),
        "unknown key `lesion.relaxation_time_sd`; did you mean `lesion.relaxation_time_relative_sd`?",
    ),
    "unknown section": (("[calibration.lesion]", "[calibration.scar]"), "unknown key `scar`"),
    "text": (
        ("relative_sd = 0.25", 'relative_sd = "wide"'),
        "`attenuation.level_relative_sd`: expected a number, got 'wide'",
    ),
    "negative": (("relative_sd = 0.25", "relative_sd = -0.25"), "must be greater than 0, got -0.25"),
    "NaN": (("relative_sd = 0.25", "relative_sd = nan"), "expected a finite number"),
    "percent": (("relative_sd = 0.25", "relative_sd = 25.0"), "must be less than or equal to 2, got 25.0"),
    "kelvin": (
        ("reference_temperature_c = 37.0", "reference_temperature_c = 310.15"),
        "`reference_temperature_c`: the value must be less than or equal to 120",
    ),
    "too few anchors": ((ANCHORS, "anchor_temperatures_c = [35.0, 84.0]"), "expected one value more"),
    "too many anchors": ((ANCHORS, ANCHORS.replace("84.0", "75.0, 84.0")), "expected at most 5 values"),
    "falling anchors": ((ANCHORS, ANCHORS.replace("45.0", "65.0")), "anchor_temperatures_c must rise"),
    "NaN anchor": ((ANCHORS, ANCHORS.replace("45.0", "nan")), "(entry 2): expected a finite number"),
    "no table": (('title = "Suomi', 'calibration = 3\ntitle = "Suomi'), "not valid TOML"),
}


def place(path, content):
    if content is FOLDER:
        path.mkdir()
    elif content is not ABSENT:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return str(path)


def tree(folder):
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def assert_refused(capfd, tmp_path, arguments, *, names=""):
    """The command line is answered in one line with exit status 2, with or without earlier results in the way."""
    for out in (tmp_path / "new" / "out", tmp_path / "old"):
        (tmp_path / "old").mkdir(exist_ok=True)
        (tmp_path / "old" / "summary.json").write_text("earlier")
        before = tree(tmp_path)
        assert run([*arguments, "--out", str(out)]) == 2
        assert tree(tmp_path) == before
        printed = capfd.readouterr()
        message = printed.err
        assert message.count("\n") == 1 and message.startswith("arfjax: ") and message.endswith("\n")
        assert names in message and "Traceback" not in message and printed.out == ""
    return message


@pytest.mark.parametrize(
    ("option", "value", "cause"),
    [
        ("--temperature-c", "90", "--temperature-c must lie between 35 and 70 degC"),
        ("--temperature-c", "nan", "--temperature-c must lie between"),
        ("--watch-ms", "0.1", "--watch-ms must be 0.5 (the push)"),
        ("--watch-ms", "nan", "--watch-ms must be"),
        ("--watch-ms", "1000", "to 50 ms"),
    ],
)
def test_push_options(capfd, tmp_path, option, value, cause):
    experiment = place(tmp_path / "e.toml", EXAMPLE)
    assert cause in assert_refused(capfd, tmp_path, ["push", experiment, option, value])


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        (["--temperature-c", "90"], "--temperature-c must lie between 35 and 70 degC"),
        (["--temperature-c", "nan"], "--temperature-c must lie between"),
        (["--frequency-hz", "0"], "--frequency-hz must be 5 to 1000 Hz, got 0"),
        (["--frequency-hz", "nan"], "--frequency-hz must be"),
        (["--frequency-hz", "1.1e6"], "Give hertz."),
        (["--depth", "50"], "--depth must be 0.01 to 1, got 50; it is a share"),
        (["--depth", "nan"], "--depth must be"),
        (["--duty-cycle", "0.5"], "--duty-cycle 0.5 is only for --modulation square"),
        (["--modulation", "square", "--depth", "0.5"], "--depth 0.5 has no effect on square modulation"),
        (["--modulation", "square", "--duty-cycle", "1"], "--duty-cycle must be 0.01 to below 1, got 1"),
        (["--modulation", "square", "--duty-cycle", "30"], "got 30; it is a share, not a percentage"),
        (["--modulation", "triangle"], "'triangle' is not one of"),
    ],
)
def test_vibrate_options(capfd, tmp_path, options, cause):
    experiment = place(tmp_path / "e.toml", EXAMPLE)
    assert cause in assert_refused(capfd, tmp_path, ["vibrate", experiment, *options])


def test_waves_too_short_for_any_mesh(capfd, tmp_path):
    """Found when the mesh is made, before anything is computed."""
    experiment = place(tmp_path / "e.toml", EXAMPLE.replace('"young"', '"constrained"'))
    options = ["--modulation", "square", "--frequency-hz", "900"]
    for out in ("new", "old"):
        before = tree(tmp_path)
        assert run(["vibrate", experiment, *options, "--out", str(tmp_path / out)]) == 2
        assert "lower the frequency" in capfd.readouterr().err and tree(tmp_path) == before


@pytest.mark.parametrize("content", BAD_DMA.values(), ids=BAD_DMA.keys())
def test_dma_measurements(capfd, tmp_path, content):
    data = place(tmp_path / "measured.csv", content)
    for command in (["fit-dma", data], ["diagnose", "--dma", data], ["design", "--dma", data]):
        assert_refused(capfd, tmp_path, command, names=data)


@pytest.mark.parametrize("content", BAD_HEATING.values(), ids=BAD_HEATING.keys())
def test_fit_heating(capfd, tmp_path, content):
    data = place(tmp_path / "course.csv", content)
    assert_refused(capfd, tmp_path, ["fit-heating", data], names=data)


@pytest.mark.parametrize("content", BAD_EXPERIMENTS.values(), ids=BAD_EXPERIMENTS.keys())
def test_experiments(capfd, tmp_path, content):
    experiment, hmi = place(tmp_path / "experiment.toml", content), place(tmp_path / "hmi.csv", HMI)
    commands = (["simulate", experiment], ["calibrate", experiment, "--hmi", hmi])
    for arguments in (
        *commands,
        ["sonicate", experiment],
        ["vibrate", experiment],
        ["vary", experiment],
        ["field", experiment],
        ["reproduce", "--experiment", experiment],
        ["diagnose", experiment, "--hmi", hmi],
        ["design", experiment, "--hmi", hmi],
    ):
        assert_refused(capfd, tmp_path, arguments, names=experiment)


@pytest.mark.parametrize("content", BAD_HMI.values(), ids=BAD_HMI.keys())
def test_hmi_measurements(capfd, tmp_path, content):
    experiment, hmi = place(tmp_path / "experiment.toml", EXAMPLE), place(tmp_path / "hmi.csv", content)
    for command in ("calibrate", "diagnose", "design"):
        assert_refused(capfd, tmp_path, [command, experiment, "--hmi", hmi], names=hmi)


@pytest.mark.parametrize(("replacement", "cause"), BAD_CALIBRATIONS.values(), ids=BAD_CALIBRATIONS.keys())
def test_calibrate_settings(capfd, tmp_path, replacement, cause):
    assert replacement[0] in EXAMPLE
    experiment, hmi = place(tmp_path / "e.toml", EXAMPLE.replace(*replacement, 1)), place(tmp_path / "h.csv", HMI)
    assert cause in assert_refused(capfd, tmp_path, ["calibrate", experiment, "--hmi", hmi], names=experiment)


@pytest.mark.parametrize("power", ["0", "-5", "nan", "1e6"])
def test_field_power(capfd, tmp_path, power):
    experiment = place(tmp_path / "experiment.toml", EXAMPLE)
    message = assert_refused(capfd, tmp_path, ["field", experiment, "--power-w", power])
    assert message.startswith("arfjax: --power-w must be 0.001 to 10000 W, got ")


@pytest.mark.parametrize("table", [HMI, TIMES])
def test_reference_outside_the_protocol(capfd, tmp_path, table):
    experiment = place(
        tmp_path / "e.toml", EXAMPLE.replace("reference_temperature_c = 37.0", "reference_temperature_c = 34")
    )
    hmi = place(tmp_path / "hmi.csv", table)
    assert "34 degC" in assert_refused(capfd, tmp_path, ["calibrate", experiment, "--hmi", hmi], names=hmi)


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (["fit-dma", "{data}"], "Missing option '--out'"),
        (["fit-dma"], "Missing argument"),
        (["fit-dma", "{data}", "--out", "{data}"], "measured.csv: is a file, not a folder"),
        (["fit-dma", "{data}", "--out", "{data}/below"], "measured.csv: is a file, not a folder"),
        (["fit-dma", "{data}", "--out", "out", "--colour", "red"], "No such option: --colour"),
        (["fit-dma", "{data}", "--out", "out", "--starts", "0"], "Invalid value for '--starts'"),
        (["fit-dma", "{data}", "--out", "out", "--seed", "x"], "Invalid value for '--seed'"),
        (["fit-dma", "{data}", "--out", "out", "--model", "maxwell"], "'maxwell' is not one of"),
        (["fit-dma", "{data}", "{data}", "--out", "out"], "unexpected extra argument"),
        (["fit-dna", "{data}", "--out", "out"], "No such command 'fit-dna'"),
        (["simulate", "--out", "out"], "Missing argument"),
        (["calibrate", "{data}", "--out", "out"], "Missing option '--hmi'"),
        (["field", "{data}"], "Missing option '--out'"),
        (["field", "{data}", "--out", "out", "--power-w", "much"], "Invalid value for '--power-w'"),
        (["reproduce"], "Missing option '--out'"),
        (["fit-heating", "{data}"], "Missing option '--out'"),
        (["fit-heating", "{data}", "--out", "out", "--baseline", "310"], "must be a temperature from 0 to 120 degC"),
        (["fit-heating", "{data}", "--out", "out", "--baseline", "nan"], "must be a temperature from 0 to 120 degC"),
        (["fit-heating", "{data}", "--out", "out", "--starts", "0"], "Invalid value for '--starts'"),
        (["diagnose", "--dma", "{data}"], "Missing option '--out'"),
        (["diagnose", "--dma", "{data}", "--out", "out", "--level", "0.7"], "Invalid value for '--level'"),
        (["diagnose", "--dma", "{data}", "--out", "out", "--level", "nan"], "Invalid value for '--level'"),
        (["diagnose", "--dma", "{sweep}", "--out", "{data}"], "measured.csv: is a file, not a folder"),
        (["diagnose", "--dma", "{data}", "--out", "out"], "measured.csv: no sweep has more than 4 frequencies"),
        (["design", "--dma", "{data}", "--out", "out"], "measured.csv: no sweep has more than 4 frequencies"),
        (["design", "--dma", "{data}", "--out", "out", "--causes", "gremlins"], "there is no cause 'gremlins'"),
        (["design", "--dma", "{data}", "--out", "out", "--causes", ","], "names by commas are expected, got ','"),
        (["design", "{data}", "--dma", "{data}", "--out", "out"], "an experiment file is of HMI"),
        (["design", "{data}", "--hmi", "{data}", "--out", "out", "--trust-units"], "--trust-units and --model are of"),
        (["data", "unknown"], "no shipped data set is called 'unknown'"),
    ],
)
def test_command_lines(capfd, tmp_path, monkeypatch, arguments, cause):
    monkeypatch.chdir(tmp_path)
    data, sweep = place(tmp_path / "measured.csv", DMA), place(tmp_path / "sweep.csv", SWEEP)
    before = tree(tmp_path)
    assert run([argument.format(data=data, sweep=sweep) for argument in arguments]) == 2
    printed = capfd.readouterr()
    assert printed.err.startswith("arfjax: ") and printed.err.count("\n") == 1 and cause in printed.err
    assert printed.out == "" and tree(tmp_path) == before


def test_out_that_cannot_be_written(capfd, tmp_path, monkeypatch):
    def refused(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkdtemp", refused)
    data = place(tmp_path / "measured.csv", DMA)
    assert "cannot be written to (Permission denied)" in assert_refused(capfd, tmp_path, ["fit-dma", data])


def test_full_disk(capfd, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("inverse.commands.fit_dma.fit_sweeps", full)
    data = place(tmp_path / "measured.csv", DMA)
    assert "No space left on device" in assert_refused(capfd, tmp_path, ["fit-dma", data])


def test_no_arguments_show_the_help(capfd):
    assert run([]) == 0
    printed = capfd.readouterr()
    assert "Usage" in printed.out and printed.err == ""


@contextlib.contextmanager
def interrupted_output(out, **given):
    with output_directory(out, **given) as folder:
        (folder / "summary.json").write_text("half")
        raise KeyboardInterrupt
        yield


@pytest.mark.parametrize(
    "command",
    [
        "fit_dma", "fit_heating", "simulate", "sonicate", "vibrate", "vary", "field", "calibrate", "reproduce",
        "diagnose", "design",
    ],
)  # fmt: skip
def test_an_interrupt_leaves_nothing(capfd, tmp_path, monkeypatch, command):
    monkeypatch.setattr(f"inverse.commands.{command}.output_directory", interrupted_output)
    experiment, dma = place(tmp_path / "experiment.toml", EXAMPLE), place(tmp_path / "dma.csv", DMA)
    hmi = place(tmp_path / "hmi.csv", HMI)
    heating = place(tmp_path / "heating.csv", HEATING)
    inputs = {"fit_dma": [dma], "simulate": [experiment], "calibrate": [experiment, "--hmi", hmi], "reproduce": []}
    inputs |= {
        "vary": [experiment],
        "fit_heating": [heating],
        "sonicate": [experiment],
        "vibrate": [experiment],
        "field": [experiment],
    }
    sweep = place(tmp_path / "sweep.csv", SWEEP)
    inputs |= {"diagnose": ["--dma", sweep], "design": ["--dma", sweep]}
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "summary.json").write_text("earlier")
    before = tree(tmp_path)
    for out in ("new", "old"):
        assert run([command.replace("_", "-"), *inputs[command], "--out", str(tmp_path / out)]) == 130
        assert capfd.readouterr().err == "arfjax: stopped; nothing was written.\n"
        assert tree(tmp_path) == before


def program(code, *arguments):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], env=environment, capture_output=True, text=True, timeout=120
    )


def test_the_program_itself(tmp_path):
    data = place(tmp_path / "measured.csv", BAD_DMA["zero frequency"])
    code = "from inverse.commands.main import main; main()"
    done = program(code, "fit-dma", data, "--out", str(tmp_path / "out"))
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr == f"arfjax: {data}, line 5, column 'frequency_hz': " + done.stderr.partition("': ")[2]
    assert "frequency 0 is not positive" in done.stderr and done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["measured.csv"]


def test_a_request_to_terminate_leaves_nothing(tmp_path):
    data = place(tmp_path / "measured.csv", DMA)
    code = (
        "import os, signal, inverse.commands.fit_dma as command; from inverse.commands.main import main; "
        "command.fit_sweeps = lambda *_, **__: os.kill(os.getpid(), signal.SIGTERM); main()"
    )
    done = program(code, "fit-dma", data, "--out", str(tmp_path / "out"))
    assert done.returncode == 130 and done.stderr.endswith("arfjax: stopped; nothing was written.\n")
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["measured.csv"]
