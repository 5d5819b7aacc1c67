"""Some thirty files as instruments, spreadsheets and controllers write them.

All made up: eleven targets of an axis of 500 mm whose errors grow by 30 µm/m, wave by 4 µm
and lie 3 µm apart between the directions, so that every file says what it must be read as.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

TARGETS = np.linspace(0.0, 500.0, 11)
RUNS = (1, 2, 3)


def error(target: float, side: int, run: int) -> float:
    """Return the error in µm that the files hold, as written with two decimals."""
    wave = 4.0 * np.sin(target / 60.0)
    return round(float(0.03 * target + wave + 1.5 * side + 0.1 * run), 2)


@dataclasses.dataclass(frozen=True)
class InstrumentFile:
    """A file and what it must be read as.

    Attributes:
        content: Bytes.
        rows: Number of readings.
        roles: That it states itself, without the axis.
        axis: Axis of the roles.
        bidirectional: The errors are those of `error`, with runs and directions.
    """

    content: bytes
    rows: int
    roles: tuple[str, ...]
    axis: str = "X"
    bidirectional: bool = False
    columns: tuple[str, ...] = ()
    """Columns that a job names, where the file states no roles."""


LASER = ("position", "error", "run", "direction")


def passes() -> list[tuple[int, int, float]]:
    """Return run, direction, target in the order of measurement."""
    return [
        (run, side, float(target))
        for run in RUNS
        for side in (1, -1)
        for target in TARGETS[::side]
    ]


def long_table(
    top: Sequence[str],
    separator: str = ";",
    comma: bool = True,
    sides: tuple[str, str] = ("1", "-1"),
    encoding: str = "utf-8",
    foot: Sequence[str] = (),
    place: Callable[[float], str] = "{:.3f}".format,
    error_in: float = 1.0,
) -> bytes:
    """Return a table of target, error in so many µm, run and direction."""
    lines = list(top)
    for run, side, target in passes():
        cells = [
            place(target),
            f"{error(target, side, run) / error_in:.{2 if error_in == 1.0 else 16}f}",
            str(run),
            sides[side < 0],
        ]
        line = separator.join(cells)
        line = line.replace(".", ",") if comma else line
        lines.append(line.replace("\0", "."))
    return ("\r\n".join([*lines, *foot]) + "\r\n").encode(encoding)


def wide_table(
    top: Sequence[str],
    separator: str = ";",
    comma: bool = True,
    runs: Sequence[tuple[int, int]] = tuple((r, s) for r in RUNS for s in (1, -1)),
    foot: Sequence[str] = (),
    encoding: str = "utf-8",
    actual: bool = False,
) -> bytes:
    """Return a table with one column per run and direction."""
    lines = list(top)
    for target in TARGETS.tolist():
        values = [error(target, side, run) for run, side in runs]
        if actual:
            cells = [f"{target + 1e-3 * value:.5f}" for value in values]
        else:
            cells = [f"{value:.2f}" for value in values]
        line = separator.join([f"{target:.3f}", *cells])
        lines.append(line.replace(".", ",") if comma else line)
    return ("\n".join([*lines, *foot]) + "\n").encode(encoding)


def blocks() -> bytes:
    """A heading above the rows of each run and direction, below the names of the columns."""
    lines = ["Positioniergenauigkeit Achse X", "Soll [mm];Abw. [µm]"]
    for run in RUNS:
        for side in (1, -1):
            lines.append(f"Lauf {run};{'hin' if side > 0 else 'rück'}")
            lines += [
                f"{t:.3f};{error(t, side, run):.2f}".replace(".", ",")
                for t in TARGETS.tolist()[::side]
            ]
    return ("\r\n".join(lines) + "\r\n").encode()


def run_per_row() -> bytes:
    """Targets along the top, a run and direction in front of each row."""
    lines = ["Positionsabweichung in µm, Achse X", ""]
    lines.append("Position [mm];" + ";".join(f"{t:.1f}" for t in TARGETS.tolist()))
    for run in RUNS:
        for side in (1, -1):
            values = [f"{error(t, side, run):.2f}" for t in TARGETS.tolist()]
            lines.append(";".join([f"{run} {'↑' if side > 0 else '↓'}", *values]))
    return ("\n".join(lines) + "\n").encode()


def renishaw() -> bytes:
    lines = ["HEADER::", "File Type: RTL", "Owner: Renishaw plc", "Version no: 1", ""]
    lines += ["TARGET DATA::", f"Target-count: {TARGETS.size}", "Targets :"]
    lines += ["  ".join(f"{t:.4f}" for t in TARGETS[k : k + 4]) for k in (0, 4, 8)]
    lines += ["Flags: 1 0 0", "", "USER-TEXT::", "Machine: Portal 7", "Serial No: 12"]
    lines += ["Date: 10:15 Nov 20 2026", "By: op", "Axis: X", "Location: hall", ""]
    lines += ["RUNS::", f"Run-count: {2 * len(RUNS)}", "", "DEVIATIONS::"]
    lines += ["Run Target Data:"]
    number = 0
    for run in RUNS:
        for side in (1, -1):
            number += 1
            for at in range(TARGETS.size)[::side]:
                value = error(float(TARGETS[at]), side, run)
                lines.append(f"  {number}   {at + 1}   {value:.4f}")
    lines += ["", "ENVIRONMENT::", "Air temperature: 20.1", "EOF::"]
    return ("\r\n".join(lines) + "\r\n").encode("cp1252")


def triplets() -> bytes:
    lines = [
        f"{t:.3f} {t + 1e-3 * error(t, 1, 1):.5f} {t + 1e-3 * error(t, -1, 1):.5f}"
        for t in TARGETS.tolist()
    ]
    return "\n".join(lines).encode() + b"\n"


def straightness(top: Sequence[str], separator: str = "\t") -> bytes:
    lines = [
        f"{t:.1f}{separator}{error(t, 1, 1):.2f}".replace(".", ",")
        for t in TARGETS.tolist()
    ]
    return ("\n".join([*top, *lines]) + "\n").encode("utf-8")


def probe(template: str, top: Sequence[str] = (), foot: Sequence[str] = ()) -> bytes:
    lines = [
        template.format(n=5 * j + i + 1, x=40.0 * i, y=25.0 * j, z=0.01 * i - 0.02 * j)
        for j in range(4)
        for i in range(5)
    ]
    return ("\n".join([*top, *lines, *foot]) + "\n").encode("utf-8")


def matrix() -> bytes:
    """A probed table as a spreadsheet shows it: X along the top, Y down the side."""
    rows = [
        f"{25 * j}" + "".join(f";{1.5 * i - 2.5 * j:.1f}" for i in range(5))
        for j in range(4)
    ]
    top = ["Ebenheit, Abweichung in µm", "Y [mm] \\ X [mm];0;40;80;120;160"]
    return ("\n".join([*top, *rows]) + "\n").replace(".", ",").encode("utf-8")


def thermal(
    top: Sequence[str], stamp: Callable[[int], str], separator: str = ";"
) -> bytes:
    lines = [
        f"{stamp(k)}{separator}{20 + 0.1 * k:.1f}{separator}{0.5 * k:.2f}"
        for k in range(40)
    ]
    text = "\r\n".join([*top, *lines]) + "\r\n"
    text = text.replace(".", ",") if separator == ";" else text
    return text.replace("\0", ".").encode("utf-8")


def clock(k: int) -> str:
    return f"{8 + (30 * k) // 3600:02}:{(30 * k) // 60 % 60:02}:{30 * k % 60:02}"


def scope_trace() -> bytes:
    lines = ["Model,DSO-7", "Record Length,200", "Sample Interval,0.001", ""]
    lines += ["TIME [s],CH1 [V],CH2 [V]"]
    lines += [f"{0.001 * k:.4f},{np.sin(k):.4f},{k % 7}" for k in range(200)]
    return ("\n".join(lines) + "\n").encode()


TITLE = ["Laserinterferometer SIOS", "Maschine: Portal 7", "Datum: 20.11.2026"]
FILES: dict[str, InstrumentFile] = {
    "matrix of a surface": InstrumentFile(
        matrix(), 20, ("X.position", "Y.position", "Z.error"), axis=""
    ),
    "laser table, English": InstrumentFile(
        long_table(["Target (mm),Error (um),Run,Direction"], ",", False),
        66,
        LASER,
        bidirectional=True,
    ),
    "German Excel export": InstrumentFile(
        long_table(
            [*TITLE, "", "Sollposition [mm];Abweichung [µm];Lauf;Richtung"],
            sides=("vorwärts", "rückwärts"),
            encoding="cp1252",
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "German export with padded titles and a row of units": InstrumentFile(
        long_table(
            [
                "Positionierabweichung;;;",
                "Maschine;Portal 7;;",
                "Achse;X;;",
                "Soll;Abweichung;Lauf Nr.;Richtung",
                "mm;µm;;",
            ],
            sides=("hin", "rück"),
            encoding="utf-8-sig",
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "UTF-16 with tabs and arrows": InstrumentFile(
        long_table(
            ["Soll [mm]\tFehler [µm]\tMessreihe\tRichtung"],
            "\t",
            sides=("↑", "↓"),
            encoding="utf-16",
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "signs of the direction and a statistic below": InstrumentFile(
        long_table(
            ["Target [mm];Deviation [µm];Cycle;Dir."],
            sides=("+", "-"),
            foot=["", "Mittelwert;7,5;;", "Max;16,0;;"],
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "blanks and a title": InstrumentFile(
        long_table(
            [
                "XL-80 linear measurement of axis X",
                "",
                "Target (mm)   Error (um)   Run   Direction",
            ],
            "   ",
            False,
            sides=("up", "down"),
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "inches": InstrumentFile(
        long_table(
            ["Axis: X", "Target (in),Deviation (thou),Run,Dir"],
            ",",
            False,
            place=lambda target: f"{target / 25.4:.15f}",
            error_in=25.4,
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "inches, as a line below says": InstrumentFile(
        long_table(
            ["Position\tError\tRun\tDirection"],
            "\t",
            False,
            foot=["", "All values in inches"],
            place=lambda target: f"{target / 25.4:.15f}",
            error_in=25_400.0,
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "Excel, French": InstrumentFile(
        long_table(
            ["Position (mm);Erreur (µm);Cycle;Sens"],
            sides=("aller", "retour"),
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "Excel, Italian, in nm": InstrumentFile(
        long_table(
            ["Quota [mm];Scostamento [nm];Ciclo;Verso"],
            sides=("andata", "ritorno"),
            error_in=1e-3,
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "groups of digits in whole numbers only": InstrumentFile(
        long_table(
            ["Position [mm];Abweichung [µm];Lauf;Richtung"],
            place=lambda target: f"{target + 800.0:,.0f}".replace(",", "\0"),
        ),
        66,
        LASER,
    ),
    "names between other separators than the rows": InstrumentFile(
        long_table(["Target [mm]\tError [um]\tRun\tDirection"], comma=False),
        66,
        LASER,
        bidirectional=True,
    ),
    "run above names between blanks": InstrumentFile(
        (
            "VM 182\nAchse : X\nMesslauf 1\nPosition/mm   Abweichung/um\n"
            + "".join(f"{t:10.3f}  {error(t, 1, 1):8.2f}\n" for t in TARGETS.tolist())
        ).encode(),
        11,
        ("position", "error"),
    ),
    "thousands in groups": InstrumentFile(
        long_table(
            ["Position [µm];Abweichung [µm];Lauf;Richtung"],
            sides=("auf", "ab"),
            place=lambda target: f"{1000.0 * target:,.1f}".replace(",", "\0"),
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "wide, up and down": InstrumentFile(
        wide_table(
            [
                "Target [mm],Up 1 [um],Down 1 [um],Up 2 [um],Down 2 [um],Up 3 [um],"
                "Down 3 [um]"
            ],
            ",",
            False,
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "wide, two header rows and a row of units": InstrumentFile(
        wide_table(
            [
                "Positionsmessung nach ISO 230-2",
                "",
                "Soll;Lauf 1;;Lauf 2;;Lauf 3;",
                ";vorwärts;rückwärts" + 2 * ";vorwärts;rückwärts",
                "mm" + 6 * ";µm",
            ],
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "wide, arrows and a mean": InstrumentFile(
        wide_table(
            ["Soll [mm];1↑ [µm];1↓ [µm];2↑ [µm];2↓ [µm];3↑ [µm];3↓ [µm]"],
            encoding="utf-8-sig",
            foot=["", "Mittelwert" + 6 * ";1,00"],
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "wide, directions above their runs and a unit in front": InstrumentFile(
        wide_table(
            [
                "Positionsabweichung X-Achse [µm]",
                "",
                "Position\tHin\t\t\tRück\t\t",
                "[mm]\t1\t2\t3\t1\t2\t3",
            ],
            "\t",
            runs=[(run, side) for side in (1, -1) for run in RUNS],
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "headings between the header and the rows": InstrumentFile(
        blocks(), 66, LASER, bidirectional=True
    ),
    "one row per run": InstrumentFile(run_per_row(), 66, LASER, bidirectional=True),
    "comments that hold axis and unit": InstrumentFile(
        long_table(
            ["# Axis: X", "# Unit: um", "target  error  run  dir"],
            " ",
            False,
            sides=("+1", "-1"),
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "units behind slashes": InstrumentFile(
        long_table(
            ["T = 20,3 °C; p = 1013 hPa", "Soll/mm\tAbw./µm\tLauf Nr.\tRicht."],
            "\t",
            sides=("vor", "zurück"),
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "directions below another name": InstrumentFile(
        long_table(
            ["Ziel mm;Fehler µm;Durchlauf;Fahrt"],
            sides=("→", "←"),
            encoding="utf-8-sig",
        ),
        66,
        LASER,
        bidirectional=True,
    ),
    "wide, actual positions": InstrumentFile(
        wide_table(
            ["Nominal\tRun 1 +\tRun 1 -\tRun 2 +\tRun 2 -\tRun 3 +\tRun 3 -"],
            "\t",
            False,
            actual=True,
        ),
        66,
        ("position", "actual", "run", "direction"),
        bidirectional=True,
    ),
    "wide, one direction for the file": InstrumentFile(
        wide_table(
            [
                "Achse: X",
                "Richtung: vorwärts",
                "Einheit: µm",
                "",
                "Soll [mm];Lauf 1;Lauf 2;Lauf 3",
            ],
            runs=[(1, 1), (2, 1), (3, 1)],
        ),
        33,
        LASER,
    ),
    "Renishaw": InstrumentFile(renishaw(), 66, LASER, bidirectional=True),
    "LinuxCNC triplets": InstrumentFile(
        triplets(), 22, ("position", "actual", "run", "direction")
    ),
    "Centroid": InstrumentFile(
        ("6 -1448819\n" + "\n".join(f"{-7 * k}" for k in range(6)) + "\n").encode(),
        6,
        (),
    ),
    "straightness with title and units": InstrumentFile(
        straightness(["Geradheit Y über X", "X\tdY", "mm\tµm"]),
        11,
        ("X.position", "Y.error"),
        axis="",
    ),
    "straightness, English": InstrumentFile(
        straightness(
            [
                "Straightness measurement",
                "Operator: me",
                "X position [mm];Y error [um]",
            ],
            ";",
        ),
        11,
        ("X.position", "Y.error"),
        axis="",
    ),
    "Heidenhain table": InstrumentFile(
        probe(
            "{n:<6}{x:+.3f}   {y:+.3f}   {z:+.4f}",
            ["BEGIN TAST .TAB MM", "NR    X          Y          Z"],
            ["[END]"],
        ),
        20,
        (),
        axis="",
        columns=("X", "Y", "Z"),
    ),
    "Siemens log": InstrumentFile(
        probe("N{n} X={x:.3f} Y={y:.3f} Z={z:.4f}"),
        20,
        (),
        axis="",
        columns=("X", "Y", "Z"),
    ),
    "FARO export": InstrumentFile(
        probe(
            "P{n},{x:.3f},{y:.3f},{z:.4f}",
            ["Device,FaroArm", "Units,mm", "Name,X [mm],Y [mm],dZ [mm]"],
        ),
        20,
        ("X.position", "Y.position", "Z.error"),
        axis="",
    ),
    "oscilloscope": InstrumentFile(
        scope_trace(), 200, ("time",), axis="", columns=("CH1", "CH2")
    ),
    "thermal log, date and time apart": InstrumentFile(
        thermal(
            ["Datalogger 4;;;", "Datum;Uhrzeit;Spindel [°C];Z [µm]"],
            lambda k: f"20\0{11}\0{2026};{clock(k)}",
        ),
        40,
        ("time", "temperature.spindel"),
        axis="",
    ),
    "thermal log, ISO stamps": InstrumentFile(
        thermal(
            ["# logger", "timestamp,T1 [degC],dz [um]"],
            lambda k: f"2026-11-20T{clock(k)}",
            ",",
        ),
        40,
        ("time", "temperature.t1"),
        axis="",
    ),
    "capture": InstrumentFile(
        (
            b'{"Header": {"SignalListHFData": [{"Name": "CYCLE", "Axis": "Cycle"},'
            b' {"Name": "ENC_POS|1", "Axis": "X1"}]}, "Payload": ['
            b'{"HFData": [[1, 0.5], [2, 0.6], [3, 0.7]]}, {"HFCallEvent": {"a": 1}},'
            b' {"HFData": [[4, 0.8], [5, 0.9]]}]}'
        ),
        5,
        (),
        axis="",
        columns=("ENC_POS|1",),
    ),
    "motion log with roles": InstrumentFile(
        (
            "time [s];X.position [mm];X.encoder [mm]\n"
            + "".join(f"{0.01 * k:.2f};{k:.3f};{k + 0.001:.4f}\n" for k in range(60))
        )
        .replace(".", ",")
        .replace("X,", "X.")
        .encode(),
        60,
        ("time", "X.position", "X.encoder"),
        axis="",
    ),
}
