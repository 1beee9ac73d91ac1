"""Read tables of cells with line numbers from CSV, TSV, Excel and MATLAB files and ROS bags.

The format is detected from the content, not from the name.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
import warnings
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain, islice, takewhile, zip_longest
from pathlib import Path
from typing import IO, Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from bowstring.aliases import Bools, Floats
from bowstring.data import matlab, motive, rosbag
from bowstring.errors import InputError, library_errors
from bowstring.files.atomic_io import readable
from bowstring.optional import load_extra
from bowstring.units import NUMBER, Text, quote, wrong

MOST_ROWS: Final = 2_000_000
MOST_SHEET_ROWS: Final = 200_000  # reading a spreadsheet takes ten times as long as text
_MOST_COLUMNS: Final = 2_000
_MOST_BYTES: Final = 500_000_000
_MOST_SHEET_BYTES: Final = 100_000_000
_MOST_UNPACKED: Final = 200_000_000
_MOST_UNPACKED_PART: Final = 50_000_000  # bytes of a part other than a sheet
_MOST_RATIO: Final = 100  # packed XML of numbers has 5 to 30
_MOST_PARTS: Final = 5_000
_LAST_SHEET_ROW: Final = 1_048_576  # last row of a sheet in Excel
_LONGEST_SHEET_ROW: Final = 5_000_000  # bytes of XML; a row is kept in memory as a whole
_CHUNK: Final = 20_000  # cells
_MOST_LINES: Final = 1_000  # rows of a sheet in which its table begins
_ZIP: Final = b"PK\x03\x04"  # a workbook begins with it
_BLANK: Final = ' \t,;"\r\n'  # characters of a line without cells

#: Separators and their names.
MARKS: Final = {",": "comma", ";": "semicolon", "\t": "tab", " ": "blanks"}

Row = tuple[int, list[str]]
COLUMN: Final = Text(200, "tip_x")
Name = Annotated[str, COLUMN]


class Form(BaseModel):
    """Layout of a table in its file, if it is not simply a header with rows below.

    Attributes
    ----------
    skip : int
        Lines (rows of a sheet) above the header, or above the numbers where there is no header.
    skip_below : int
        Rows between the header and the numbers, such as a row of units.
    header : {"first", "none"}
    header_rows : int
        Rows of the header. The name of a column joins its cells, ``tip X``; a blank cell above
        others takes the text to its left.
    names : tuple of str
        Names of the columns, instead of the header; without both they are ``column_1`` and so on.
    separator : str or None
        Name of the separator of cells; None to detect it.
    last : int or None
        Last line (row of a sheet) that is read, from 1.
    block : str or None
        Title of one of several tables in the file, a line of its own. The table ends at the next
        blank line; `skip` counts from the title.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    skip: Annotated[int, Field(ge=0, le=100_000)] = 0
    skip_below: Annotated[int, Field(ge=0, le=100_000)] = 0
    header: Literal["first", "none"] = "first"
    names: tuple[Name, ...] = ()
    separator: Literal["comma", "semicolon", "tab", "blanks"] | None = None
    header_rows: Annotated[int, Field(ge=1, le=5)] = 1
    last: Annotated[int, Field(ge=1)] | None = None
    block: Name | None = None

    @model_validator(mode="after")
    def _check(self) -> Form:
        if self.last is not None and self.block is not None:
            raise wrong("block and last: write one of them; a block ends at a blank line")
        if self.last is not None and self.last <= self.skip:
            raise wrong(f"last: got {self.last}; must be a line below the {self.skip} of skip")
        return self


#: Value that trackers of NDI write for what they did not measure.
_NOT_MEASURED: Final = -3.697314e28
_NOT_MEASURED_TEXT: Final = re.compile(r"-3[.,]69731[0-9]+[eE]\+?0?28")
_MISSING: Final = ("", "nan", "null", "na", "n/a", "#n/a", "none")


def not_measured(values: Floats) -> Bools:
    """Whether numbers are an instrument's value for what it did not measure."""
    return np.abs(values - _NOT_MEASURED) < 1e-6 * abs(_NOT_MEASURED)


def is_missing(cell: str) -> bool:
    """Whether a cell is blank, or says that nothing was measured."""
    text = cell.strip()
    return text.lower() in _MISSING or _NOT_MEASURED_TEXT.fullmatch(text) is not None


def cell_number(cell: str) -> float:
    """Number of a cell; NaN for other text, what was not measured and digits that are not ASCII."""
    cell = cell.strip()
    try:
        value = float(cell) if cell.isascii() and "_" not in cell else math.nan
    except ValueError:
        return math.nan
    return math.nan if value < -1e28 and _NOT_MEASURED_TEXT.fullmatch(cell) else value


def is_text(cell: str) -> bool:
    """Whether a cell is no number, also not one with a decimal comma."""
    return math.isnan(cell_number(with_point(cell)))


def with_point(cell: str) -> str:
    """Replace a decimal comma of a cell by a point."""
    return cell.replace(",", ".") if cell.count(",") == 1 else cell


class UnknownColumnsError(InputError):
    """Error for a table whose columns are not recognised.

    Attributes
    ----------
    table : Table
        Table, as far as it was read.
    """

    def __init__(self, message: str, table: Table) -> None:
        super().__init__(message)
        self.table = table


@dataclass
class Table:
    """Table with a header and rows.

    Attributes
    ----------
    path : Path
    sha256 : str
        Hash of the whole file.
    header : list of str
        Names of the columns, stripped.
    line : int
        Line of the header in the file, from 1; in a spreadsheet the row of its sheet.
    about : dict
        Comments ``# key: value`` above the header, keys in lower case.
    separator : str
        Separator of cells; empty for a spreadsheet.
    notes : list of (int, str)
        Lines and notes for the user; reading rows may add further ones.
    form : Form
    length_unit : str or None
        Unit of all coordinates, if the file states it.
    own : int or None
        Number of columns of the file itself; the others were joined. None: all.
    rate : float or None
        Rows per second, if the file states it and its header was detected.
    below : list of list of str
        Cells of the rows that are skipped between the header and the numbers.
    """

    path: Path
    sha256: str
    header: list[str]
    line: int
    about: dict[str, str]
    separator: str
    notes: list[tuple[int, str]] = field(default_factory=list)
    rows: Iterator[Row] = field(default_factory=lambda: iter(()), repr=False)
    form: Form = field(default_factory=Form)
    length_unit: str | None = None
    own: int | None = None
    rate: float | None = None
    below: list[list[str]] = field(default_factory=list)

    def chunks(self) -> Iterator[list[Row]]:
        """Yield chunks of rows, once: line and cells, without blank lines and comments."""
        count, most = 0, MOST_ROWS if self.separator else MOST_SHEET_ROWS
        size = max(_CHUNK // max(len(self.header), 10), 1)
        while chunk := list(islice(self.rows, size)):
            count += len(chunk)
            if count > most:
                text = "split it" if self.separator else "save it as CSV, of which more is read"
                raise InputError(
                    f"{self.path}: the table has more than {most} rows, which is the most "
                    f"that is read; {text}"
                )
            yield chunk


def open_table(path: str | Path, form: Form | None = None) -> Table:
    """Open a table and read its header.

    Parameters
    ----------
    path : str or Path
        Text in UTF-8 (or UTF-16 with a byte order mark) with commas, semicolons or tabs between
        cells, an Excel workbook (.xlsx), of which the first sheet is read, a MATLAB file (.mat),
        whose variables are columns and lines are rows, or a ROS bag (.mcap), of which a topic is
        read and lines are messages. Blank lines and lines that begin with # are skipped. A CSV
        export of OptiTrack's Motive is recognised by its first line.
    form : Form, optional
        Layout of the table in the file.

    Returns
    -------
    Table

    Raises
    ------
    InputError
        If the table cannot be read; the message has advice. `UnknownColumnsError` if there are
        numbers in place of a header, blanks between its names, or a name twice.
    """
    path, form = Path(path), form or Form()
    data = _bytes(path)
    sha256 = hashlib.sha256(data).hexdigest()
    if not data.strip():
        raise InputError(f"{path}: the table is empty")
    if data.startswith(_ZIP):
        return _workbook(path, data, sha256, form)
    if matlab.is_matlab(data):
        return _matlab(path, data, sha256, form)
    if rosbag.is_bag(data):
        return _bag(path, data, sha256, form)
    if other := rosbag.other_bag(data):
        raise InputError(
            f"{path}: this looks like a bag in the format {other}; bags are read as .mcap, which "
            "mcap convert makes of it"
        )
    if data.startswith(b"\xd0\xcf\x11\xe0"):
        raise InputError(
            f"{path}: this is a workbook of the old Excel format (or a locked one); save it as "
            ".xlsx without a password, or as CSV"
        )
    return _text(path, data, sha256, form)


def _bytes(path: Path) -> bytes:
    try:
        if path.is_dir():
            raise InputError(f"{path}: this is a folder; name the file of the table")
        # pipes are read too; a device such as /dev/zero has no end
        with readable(path) as file:
            data = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"{path}: the table cannot be read: {error.strerror}") from None
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        # a null character in the name
        raise InputError(f"{quote(str(path))} is no name of a file") from None
    if len(data) > _MOST_BYTES:
        raise InputError(
            f"{path}: the table is too large; up to {_MOST_BYTES // 10**6} MB are read, split it"
        )
    return data


def lines_of_table(path: Path) -> tuple[list[str], bool]:
    """Lines of a text file, or the first rows of a workbook with tabs between cells.

    Returns
    -------
    list of str
    bool
        Whether the file is a workbook.
    """
    data = _bytes(path)
    if not data.startswith(_ZIP):
        return re.split(r"\r\n|\n|\r", data.decode(_encoding(path, data))), False
    rows = _values(path, _sheets(path, data)[0], 1, _MOST_COLUMNS)
    cells = ([" ".join(cell.split()) for cell in row] for _, row in islice(rows, _MOST_LINES))
    return ["\t".join(row).rstrip("\t") for row in cells], True


# -- text --------------------------------------------------------------------------------------


def _text(path: Path, data: bytes, sha256: str, form: Form) -> Table:
    encoding = _encoding(path, data)
    file = io.TextIOWrapper(io.BytesIO(data), encoding=encoding, newline="")
    start, lines = _part(path, file, form)
    about: dict[str, str] = {}
    number, first = 0, ""
    for number, first in enumerate(lines, 1):
        if number > form.skip and first.strip() and not is_comment(first):
            break
        if number > form.skip:
            _remember(first, about)
    else:
        what = f"the table has no line below the {form.skip} that are skipped" if form.skip else (
            "the table is empty, there are only comments"
        )  # fmt: skip
        raise InputError(f"{path}: {what}")
    if motive.is_export(first) and form == Form():
        return _motive(path, lines, first, number, sha256)
    named = (mark for mark, name in MARKS.items() if name == form.separator)
    separator = next(named, "") or default_separator(first)
    words = first.split()
    if separator not in first and len(words) > 3:
        has_header = not all(re.fullmatch(NUMBER, word) for word in words)
        if not has_header:
            words = [f"column_{i}" for i in range(1, len(words) + 1)]
        blanks = Form(header="first" if has_header else "none", separator="blanks")
        raise UnknownColumnsError(
            f"{path}, line {number}: the header has blanks between its names; separate cells by "
            "commas, semicolons or tabs",
            Table(path, sha256, words, number, about, " ", form=blanks),
        )
    number += start
    lines = chain([first], lines)
    split = enumerate(map(str.split, lines), 1) if separator == " " else _split(lines, separator)
    rows = _text_rows(path, split, number - 1)
    return _named(Table(path, sha256, [], number, about, separator, [], rows, form))


def _part(path: Path, file: Iterator[str], form: Form) -> tuple[int, Iterator[str]]:
    """Number of lines above the part of a file that a form names, and its lines."""
    if form.last is not None:
        return 0, islice(file, form.last)
    if form.block is None:
        return 0, file
    titles, before = [], ""
    for number, line in enumerate(file, 1):
        if title := title_of(line):
            if title == form.block:
                return number, takewhile(lambda line: not is_blank(line), file)
            if is_blank(before):
                titles.append(title)
        before = line
    have = f"the file has {', '.join(map(quote, titles[:12]))}" if titles else "it has none"
    raise InputError(f"{path}: there is no block {quote(form.block)}; {have}")


def title_of(line: str) -> str:
    """Text of a line that has one cell only; empty for other lines."""
    text = line.strip(_BLANK)
    return "" if re.search(r"[\t;,]", text) else text


def is_name(text: str) -> bool:
    """Whether a mapping can name a column or a block so."""
    return 0 < len(text) <= COLUMN.most and text.isprintable()


def is_blank(line: str) -> bool:
    """Whether a line has no cell that is not blank."""
    return not line.strip(_BLANK)


def default_separator(line: str) -> str:
    """Detect the separator of a line: the most frequent mark, in numbers the strongest one."""
    marks = "\t;,"
    found = max(marks, key=lambda mark: line.count(mark))  # the first one of equal counts
    if any(re.fullmatch(r"\s*" + NUMBER + r"\s*", cell) for cell in re.split(r"[\t;,]", line)):
        return next((mark for mark in marks if mark in line), found)  # commas may be decimal ones
    return found


def _split(lines: Iterable[str], separator: str) -> Iterator[Row]:
    """Yield the line number at the end of each row, and its cells."""
    reader = csv.reader(lines, delimiter=separator, strict=True)
    return ((reader.line_num, cells) for cells in reader)


def _named(table: Table) -> Table:
    """Read the names of the columns, and skip lines between them and the numbers."""
    form = table.form
    try:
        table.line, first = next(table.rows)
    except StopIteration:
        raise InputError(f"{table.path}: the table is empty") from None
    below: Iterable[Row] = ()
    for line, cells in islice(table.rows, form.header_rows - 1):
        table.line, first = line, joined_names(first, cells)
    own = form.names if form.header == "none" else ()
    while len(first) > len(own) and not first[-1].strip():
        first.pop()
    if form.header == "first":
        table.header = [name.strip() for name in first]
    else:
        table.header = [f"column_{i}" for i in range(1, len(first) + 1)]
        below = [(table.line, first)]
    if form.names:
        if len(form.names) != len(table.header):
            raise InputError(
                f"{table.path}, line {table.line}: the mapping names {len(form.names)} columns, "
                f"here there are {len(table.header)}"
            )
        table.header = list(form.names)
    table.rows = chain(below, table.rows)
    table.below = [cells for _, cells in islice(table.rows, form.skip_below)]
    _check_header(table)
    return table


def joined_names(above: list[str], below: list[str]) -> list[str]:
    """Names from two rows of a header; a blank cell of the upper one takes the text to its left."""
    out, last = [], ""
    for upper, lower in zip_longest(above, below, fillvalue=""):
        last = upper.strip() or (last if lower.strip() else "")
        out.append(f"{last} {lower.strip()}".strip())
    return out


def _motive(path: Path, file: Iterator[str], first: str, line: int, sha256: str) -> Table:
    rows = _text_rows(path, _split(chain([first], file), ","), line - 1)
    export = motive.read_header(path, rows)
    about = {"name": export.take} if export.take else {}
    table = Table(path, sha256, export.columns, export.line, about, ",", [], rows)
    table.length_unit = export.unit
    _check_header(table)
    return table


def _matlab(path: Path, data: bytes, sha256: str, form: Form) -> Table:
    if form.model_copy(update={"block": None}) != Form():
        raise InputError(f"{path}: of the fields of table, a MATLAB file has block alone")
    columns, left = matlab.read_columns(path, data, form.block)
    table = Table(path, sha256, [], 1, {}, ",", form=form)
    if left:
        names = ", ".join(map(quote, left[:12]))
        table.notes.append((1, f"variables with another number of rows are not read: {names}"))
    return _of_columns(table, columns)


def _bag(path: Path, data: bytes, sha256: str, form: Form) -> Table:
    if form.model_copy(update={"block": None}) != Form():
        raise InputError(f"{path}: of the fields of table, a bag has block alone, its topic")
    table = Table(path, sha256, [], 1, {}, ",", form=form)
    topic = form.block
    if topic is None:
        topics = rosbag.topics(path, data)
        if not topics:
            raise InputError(f"{path}: no topic has numbers that can be read")
        topic = topics[0]
        if len(topics) > 1:
            raise UnknownColumnsError(
                f"{path}: several topics have numbers: {rosbag.in_words(topics)}; name one in a "
                f"mapping, such as table: {{block: {topic}}}",
                table,
            )
    columns, notes = rosbag.read_topic(path, data, topic)
    table.notes += [(1, note) for note in notes]
    return _of_columns(table, columns)


def blocks_of(path: Path) -> list[str]:
    """Topics of a bag that a mapping can name as its block; empty for other files."""
    data = _bytes(path)
    return list(filter(is_name, rosbag.topics(path, data))) if rosbag.is_bag(data) else []


def _of_columns(table: Table, columns: dict[str, list[str]]) -> Table:
    """Table of columns of cells."""
    table.header = list(columns)
    table.rows = (
        (i, list(cells)) for i, cells in enumerate(zip(*columns.values(), strict=True), 1)
    )
    _check_header(table)
    return table


def _encoding(path: Path, data: bytes) -> str:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):  # Excel's "Unicode text"
        encoding = "utf-16"
    elif b"\0" in data[:100_000]:
        raise InputError(f"{path}: this is no text; give a table as CSV, TSV or .xlsx")
    else:
        encoding = "utf-8-sig"
    try:
        data.decode(encoding)
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(
            f"{path}, line {line}: the text is not in UTF-8; save the table as CSV in UTF-8"
        ) from None
    return encoding


def is_comment(line: str) -> bool:
    """Whether a line is a comment, also in the quotes of a spreadsheet."""
    return line.lstrip(' \t"').startswith("#")


def _remember(line: str, about: dict[str, str]) -> None:
    """Store ``# key: value`` from a line, also with a spreadsheet's separators at its end."""
    text = line.strip().strip('"').lstrip("# \t").rstrip(",;\t ").strip('"')
    key, colon, value = text.partition(":")
    if colon and re.fullmatch(r"[A-Za-z_]{1,40}", key.strip()):
        about.setdefault(key.strip().lower(), value.strip())


def _text_rows(path: Path, rows: Iterable[Row], skipped: int) -> Iterator[Row]:
    """Yield the line number at the beginning of each row, after `skipped` lines, and its cells."""
    line = 0
    try:
        for end, cells in rows:
            began, line = line + 1, end
            if not cells:
                continue
            first = cells[0]
            if "#" in first and first.lstrip().startswith("#"):
                continue
            if first or any(map(str.strip, cells)):
                yield skipped + began, cells
    except csv.Error as error:
        raise InputError(
            f"{path}, line {skipped + line + 1}: the table cannot be read: {error}"
        ) from None


def _check_header(table: Table) -> None:
    header, here = table.header, f"{table.path}, line {table.line}"
    if len(header) > _MOST_COLUMNS:
        raise InputError(
            f"{here}: the header has {len(header)} columns; up to {_MOST_COLUMNS} are read"
        )
    if all(re.fullmatch(NUMBER, name) for name in header):
        table.form = Form(header="none")
        table.header = [f"column_{i}" for i in range(1, len(header) + 1)]
        raise UnknownColumnsError(
            f"{here}: there are numbers where the names of the columns are expected; write a "
            "header",
            table,
        )
    seen: set[str] = set()
    for name in header:
        if name and name in seen:
            raise UnknownColumnsError(f"{here}: the column {quote(name)} is there twice", table)
        seen.add(name)


# -- spreadsheets ------------------------------------------------------------------------------


def _sheets(path: Path, data: bytes) -> list[Any]:
    """Sheets of a workbook with its tables first, then those named "source"."""
    openpyxl = load_extra("excel")
    with library_errors(f"{path}: the workbook cannot be unpacked"):
        _check_parts(path, data)
    with library_errors(f"{path}: this is no Excel workbook that can be read"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about styles and the like
            book = openpyxl.load_workbook(io.BytesIO(data), read_only=True, data_only=True)
        sheets = sorted(book.worksheets, key=lambda sheet: sheet.title.lower() == "source")
    if not sheets or sheets[0].title.lower() == "source":
        raise InputError(f"{path}: the workbook has no sheet with a table")
    for sheet in sheets:
        sheet.reset_dimensions()  # a file may state wrong ones
    return sheets


def _workbook(path: Path, data: bytes, sha256: str, form: Form) -> Table:
    if form.block is not None:
        raise InputError(f"{path}: block is for text files; give skip and last, rows of the sheet")
    sheets = _sheets(path, data)
    about: dict[str, str] = {}
    while sheets[-1].title.lower() == "source":
        other = sheets.pop()
        cell = next(iter(other.iter_rows(max_row=1, max_col=1, values_only=True)), (None,))
        about["source"] = _cell(cell[0] if cell else None).strip()
    sheet = sheets[0]
    line, first = _sheet_header(path, sheet, about, form.skip)
    if form.header_rows > 1:  # the first row may be the shorter one
        head = islice(_values(path, sheet, line, _MOST_COLUMNS + 1), form.header_rows)
        width = max(len("\0".join(cells).rstrip("\0").split("\0")) for _, cells in head)
        first += [""] * (width - len(first))
    below = _sheet_rows(path, sheet, line, len(first))
    last = form.last or _LAST_SHEET_ROW
    rows = takewhile(lambda row: row[0] <= last, chain([(line, first)], below))
    table = _named(Table(path, sha256, [], line, about, "", [], rows, form))
    if len(sheets) > 1:
        names = ", ".join(quote(other.title) for other in sheets[1:11])
        text = f"only the first sheet, {quote(sheet.title)}, is read, not {names}"
        table.notes.append((table.line, text))
    return table


def _check_parts(path: Path, data: bytes) -> None:
    """Refuse an archive that expands far beyond its size, before it is opened as a workbook.

    The stated sizes are binding, because reading stops at them.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        parts = archive.infolist()
        unpacked = sum(part.file_size for part in parts)
        if (
            len(data) > _MOST_SHEET_BYTES
            or len(parts) > _MOST_PARTS
            or unpacked > _MOST_UNPACKED
            or any(map(_is_bloated, parts))
        ):
            raise InputError(
                f"{path}: the workbook would unpack to {unpacked / 1e6:.0f} MB in {len(parts)} "
                "parts, far more than a table needs, and is not opened; save the table as CSV"
            )
        if not any(part.filename == "xl/workbook.xml" for part in parts):
            raise InputError(f"{path}: this archive is no Excel workbook (.xlsx)")
        for part in parts:
            if part.filename.endswith((".xml", ".rels")):
                with archive.open(part) as file:
                    _check_xml(path, file)


def _is_bloated(part: zipfile.ZipInfo) -> bool:
    size = part.file_size
    is_sheet = part.filename.startswith("xl/worksheets/")
    return (size > 1_000_000 and size > _MOST_RATIO * part.compress_size) or (
        size > _MOST_UNPACKED_PART and not is_sheet
    )


def _check_xml(path: Path, file: IO[bytes]) -> None:
    """Refuse XML with a document type definition or with excessive rows."""
    row = re.compile(rb"<(?:[A-Za-z0-9]+:)?(?:row|si)[ >/]")
    since, tail = 0, b""
    first = True
    while block := file.read(1_000_000):
        if first and b"<!DOCTYPE" in block.replace(b"\0", b""):  # in UTF-16 as well
            raise InputError(
                f"{path}: the workbook holds a document type definition, which no spreadsheet "
                "writes, and is not opened; save the table as CSV"
            )
        first = False
        text = tail + block
        ends = [found.end() for found in row.finditer(text)]
        since = len(text) - ends[-1] if ends else since + len(block)
        if since > _LONGEST_SHEET_ROW:
            raise InputError(
                f"{path}: the workbook has a row of more than {_LONGEST_SHEET_ROW // 10**6} MB, "
                "and is not opened; save the table as CSV"
            )
        tail = block[-50:]


def _sheet_header(
    path: Path, sheet: object, about: dict[str, str], skip: int
) -> tuple[int, list[str]]:
    rows = _values(path, sheet, 1 + skip, _MOST_COLUMNS + 1)
    for line, cells in islice(rows, _MOST_LINES):
        if not any(cells):
            continue
        if not cells[0].startswith("#"):
            while not cells[-1]:
                cells.pop()
            return line, cells
        _remember(cells[0], about)
    raise InputError(f"{path}: the first sheet has no header in its first {_MOST_LINES} rows")


def _sheet_rows(path: Path, sheet: object, header: int, width: int) -> Iterator[Row]:
    # one more column, to detect rows that are too long
    for line, cells in _values(path, sheet, header + 1, width + 1):
        if any(cells) and not cells[0].startswith("#"):
            yield line, cells if cells[width] else cells[:width]


def _values(path: Path, sheet: object, start: int, width: int) -> Iterator[Row]:
    rows = sheet.iter_rows(min_row=start, max_col=width, values_only=True)  # type: ignore[attr-defined]
    with library_errors(f"{path}: the sheet cannot be read"):
        for line, values in enumerate(rows, start):
            if line > _LAST_SHEET_ROW:
                raise InputError(f"{path}: the sheet has more than {_LAST_SHEET_ROW} rows")
            cells = [_cell(value) for value in values]
            yield line, cells + [""] * (width - len(cells))


def _cell(value: object) -> str:
    if value is None:
        return ""
    return repr(float(value)) if isinstance(value, float) else str(value)
