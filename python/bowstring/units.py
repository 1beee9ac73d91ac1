"""Numbers with units: parsing, and validators of the robot file's fields."""

from __future__ import annotations

import json
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
    from pydantic_core import CoreSchema, PydanticCustomError

# Everyday units, so that pint (0.3 s to load) is needed for rare ones only. Decimal factors keep
# "3 mm" and "0.003 m" the same float, hence the same robot hash.
_UNITS: Final[dict[str, dict[str, Decimal]]] = {
    si: {unit: Decimal(factor) for unit, factor in units.items()}
    for si, units in {
        "": {},
        "m": {"m": "1", "cm": "1e-2", "mm": "1e-3", "um": "1e-6", "km": "1e3"},
        "m^2": {"m^2": "1", "cm^2": "1e-4", "mm^2": "1e-6"},
        "kg": {"kg": "1", "g": "1e-3", "mg": "1e-6"},
        "Pa": {"Pa": "1", "kPa": "1e3", "MPa": "1e6", "GPa": "1e9", "TPa": "1e12"},
        "kg/m^3": {"kg/m^3": "1", "g/cm^3": "1e3"},
        "m/s^2": {"m/s^2": "1"},
        "rad": {"rad": "1", "deg": "0.01745329251994329576923690768488613"},
        "N": {"N": "1", "mN": "1e-3", "kN": "1e3"},
        "N*m": {"N*m": "1", "N*mm": "1e-3", "mN*m": "1e-3"},
        "N*m^2": {"N*m^2": "1", "N*mm^2": "1e-6"},
        "N/m": {"N/m": "1", "mN/m": "1e-3", "N/mm": "1e3"},
        "kg/m": {"kg/m": "1", "g/m": "1e-3"},
        "kg*m": {"kg*m": "1", "g*mm": "1e-6"},
        "kg*m^2": {"kg*m^2": "1", "kg*mm^2": "1e-6", "g*mm^2": "1e-9"},
        "m/N": {"m/N": "1", "mm/N": "1e-3", "um/N": "1e-6"},
        "s": {"s": "1", "ms": "1e-3", "us": "1e-6", "min": "60"},
        "1/s": {"1/s": "1", "s^-1": "1"},
    }.items()
}
_QUANTITY_NAMES: Final = {
    "m": "length",
    "m^2": "area",
    "kg": "mass",
    "Pa": "stress (pressure)",
    "kg/m^3": "density",
    "m/s^2": "acceleration",
    "rad": "angle",
    "N": "force",
    "N*m": "moment",
    "N*m^2": "bending stiffness",
    "N/m": "force per length",
    "kg/m": "mass per length",
    "kg*m": "rotary inertia per length",
    "kg*m^2": "moment of inertia",
    "m/N": "compliance",
    "s": "time",
    "1/s": "rate",
}
# Spellings that differ from the table's.
_OTHER_FORMS: Final = {"Nm": "N*m", "Nmm": "N*mm", "mNm": "mN*m", "/s": "1/s"}
_SAME_UNIT: Final = str.maketrans({"²": "^2", "³": "^3", "µ": "u", "μ": "u", "°": "deg", "·": "*"})
NUMBER: Final = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?"
# Names with small whole powers only, so that pint never computes 9**9**9.
_UNIT: Final = r"[A-Za-z_]+(?:\^-?[1-9])?(?:[*/][A-Za-z_]+(?:\^-?[1-9])?){0,5}"
_MAX_WORD: Final = 100


@cache
def _pint() -> Any:
    """Unit registry for units that are not in the table above, built at the first use."""
    import pint

    return pint.UnitRegistry(cache_folder=None)


@cache
def _factor(unit: str, si: str) -> Decimal:
    """Factor from ``unit`` to the SI unit ``si``; ValueError has the end of a message "got ..."."""
    if len(unit) > _MAX_WORD:
        raise ValueError(f"; {quote(unit)} is not a unit")
    plain = unit.translate(_SAME_UNIT).replace("**", "^").replace(" ", "")
    plain = _OTHER_FORMS.get(plain, plain)
    if plain in _UNITS[si]:
        return _UNITS[si][plain]
    if not si:
        raise ValueError("; this is a plain number without a unit")
    if any(plain in units for units in _UNITS.values()):
        raise ValueError(f"; {quote(unit)} is not a unit of {_QUANTITY_NAMES[si]}")
    if not re.fullmatch(_UNIT, plain):
        raise ValueError(f"; {quote(unit)} is not a unit of {_QUANTITY_NAMES[si]}")
    registry = _pint()
    try:
        found = registry.parse_units(plain)
    except Exception as error:  # pint raises many kinds of exception on invalid units
        same = [known for known in _UNITS[si] if known.lower() == plain.lower()]
        hint = f" (units are case-sensitive: {same[0]})" if same else ""
        raise ValueError(f"; {quote(unit)} is not a known unit{hint}") from error
    try:
        # Versions of pint differ in the last digit, which must not change a robot's hash.
        return Decimal(f"{float(registry.Quantity(1.0, found).m_as(si)):.15g}")
    except Exception as error:
        raise ValueError(f"; {quote(unit)} is not a unit of {_QUANTITY_NAMES[si]}") from error


def _parse_quantities(text: str, si: str) -> list[float]:
    """Read "641 mm" or "0 0 -9.81 m/s^2" as SI; ValueError has the end of a message "got ..."."""
    numbers, unit = _split(text)
    if not numbers:
        raise ValueError(", which is not a number" + (" with a unit" if si else ""))
    if si and not unit:
        raise ValueError(" without a unit")
    factor = _factor(unit, si) if unit else Decimal(1)
    return [float(Decimal(number) * factor) for number in numbers]


def _split(text: str) -> tuple[list[str], str]:
    """Split "0 0 -9.81 m/s^2" or "641mm" into numbers and unit.

    Word by word, because a single pattern could take exponential time on hostile text.
    """
    words = text.split()
    numbers: list[str] = []
    for i, word in enumerate(words):
        match = re.match(NUMBER, word, re.ASCII) if len(word) <= _MAX_WORD else None
        if match is None:
            return numbers, " ".join(words[i:])
        numbers.append(match.group())
        if rest := word[match.end() :]:
            return numbers, " ".join((rest, *words[i + 1 :]))
    return numbers, ""


def read_number(text: str, si: str) -> float:
    """Read one number of the command line; without a unit it is SI.

    ValueError continues the sentence 'got "...", '.
    """
    text = text.strip()
    if si == "1/s":
        text = re.sub(r"\s+1/", " /", text)  # "0.5 1/s" is one number
    if re.fullmatch(NUMBER, text, re.ASCII):
        values = [float(text)]
    elif not re.match(NUMBER, text, re.ASCII):
        raise ValueError("which is not a number")
    elif re.match(rf"{NUMBER}\s+{NUMBER}", text, re.ASCII):
        raise ValueError("which is more than one number")
    else:
        try:
            values = _parse_quantities(text, si)
        except ValueError as error:
            why = str(error)
            raise ValueError(re.sub("^; ", "but ", why).removeprefix(", ")) from None
    if not math.isfinite(values[0]):
        raise ValueError("which is too large")
    return values[0]


def read_share(text: str) -> float:
    """Read a share such as "0.01" or "1 %"; ValueError as by `read_number`."""
    text = text.strip()
    if text.endswith("%"):
        return read_number(text[:-1], "") / 100.0
    return read_number(text, "")


@cache
def _limit(text: str, si: str) -> float:
    return _parse_quantities(text, si)[0]


def number_with_unit(value: float, si: str, digits: int = 4) -> str:
    """Write an SI number in the usual unit of its quantity, to some significant digits."""
    unit, factor = si, 1.0
    if si == "m":
        unit, factor = ("m", 1.0) if abs(value) >= 10 else ("mm", 1e-3)
    elif si == "kg":
        unit, factor = ("kg", 1.0) if abs(value) >= 1 else ("g", 1e-3)
    elif si == "Pa":
        units = (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3), ("Pa", 1.0))
        unit, factor = next((u for u in units if abs(value) >= u[1]), units[-1])
    return f"{rounded(value / factor, digits)} {unit}".rstrip()


_BY_SIZE: Final = {"Pa": ("GPa", "MPa", "kPa", "Pa"), "N": ("kN", "N", "mN")}


def unit_of_size(value: float, si: str, usual: str) -> str:
    """Choose the unit for a value of this size: the usual one, or a smaller one."""
    units = _BY_SIZE.get(si, ())
    if usual not in units or value == 0:
        return usual
    smaller = units[units.index(usual) :]
    return next((u for u in smaller if abs(value) >= _UNITS[si][u]), smaller[-1])


def si_of(unit: str) -> str:
    """SI unit of the quantity of a unit; empty for a plain number."""
    return next((si for si, units in _UNITS.items() if unit in units), unit)


def is_numbers(text: str) -> bool:
    """Whether a text has numbers and units only, as the parts of a list that has blanks."""
    words = re.findall(r"[^\s,]+", text)
    units = {unit for usual in _UNITS.values() for unit in usual}
    number = re.compile(f"{NUMBER}(.*)", re.ASCII)
    rest = [match[1] if (match := number.fullmatch(word)) else word for word in words]
    return bool(words) and all(unit == "" or unit in units for unit in rest)


def has_no_unit(text: str) -> bool:
    """Whether a number of the command line has no unit and is thus SI."""
    return re.fullmatch(NUMBER, text.strip(), re.ASCII) is not None


def rounded(value: float, digits: int = 2) -> str:
    """Round to `digits` significant digits; no exponent up to a million."""
    return f"{float(f'{value:.{digits}g}'):.{max(digits, 6)}g}"


def printable(text: str) -> str:
    """Escape control characters, such as \\x1b, in text from files and users.

    Line feeds and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode("ascii")
        for c in text
    )


def quote(value: object) -> str:
    """Quote a value in a message, shortened to one line."""
    if isinstance(value, str):
        if not value.strip():
            return "nothing"
        value = value[:_MAX_WORD]
        if re.fullmatch(NUMBER, value.strip(), re.ASCII):
            text = value.strip()
        else:
            text = json.dumps(value, ensure_ascii=not value.isprintable())
    elif isinstance(value, Mapping):
        return "a set of fields"
    elif isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    else:
        text = str(value) if not isinstance(value, int) or abs(value) < 1e15 else "a huge number"
    return text if len(text) <= 60 else text[:56] + " ..." + '"' * text.startswith('"')


def wrong(sentence: str) -> PydanticCustomError:
    from pydantic_core import PydanticCustomError

    return PydanticCustomError("bowstring", "{sentence}", {"sentence": sentence})


class Marker(ABC):
    """Annotation of a field that pydantic validates by `read`."""

    @abstractmethod
    def read(self, value: Any) -> Any: ...

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(self.read)

    @abstractmethod
    def json_schema(self) -> dict[str, Any]: ...

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return self.json_schema()


@dataclass(frozen=True)
class Quantity(Marker):
    """Annotation of a field with a unit: text in a file, an SI number in Python.

    Text must have a unit; a Python number is SI. The limits are far outside any robot: they only
    keep every later product finite.
    """

    si: str
    example: str
    low: str
    high: str
    vector: int | None = None  # None: one number; 0: any count from 1; n: exactly n

    def read(self, value: object) -> float | tuple[float, ...]:
        if self.vector is None:
            return self._read_one(value)
        if isinstance(value, str):
            values = self._read_text(value)
        elif isinstance(value, (list, tuple)):
            values = [self._read_one(item) for item in value]
        else:
            raise self._refuse(value, "")
        if not values or (self.vector and len(values) != self.vector):
            count = self.vector or "at least one"
            raise wrong(f"got {len(values)} numbers; must have {count}, {self._advice}")
        return tuple(values)

    @property
    def _advice(self) -> str:
        return f"for example {self.example}" if not self.si else f'for example "{self.example}"'

    def _refuse(self, value: object, why: str) -> PydanticCustomError:
        return wrong(f"got {quote(value)}{why}; write {self._advice}")

    def _read_text(self, text: str) -> list[float]:
        try:
            values = _parse_quantities(text, self.si)
        except ValueError as error:
            raise self._refuse(text, str(error)) from None
        for value in values:
            self._check(value, text)
        return values

    def _read_one(self, value: object) -> float:
        if isinstance(value, str):
            values = self._read_text(value)
            if len(values) != 1:
                raise self._refuse(value, "; must be one number")
            return values[0]
        if isinstance(value, Mapping):
            raise wrong(
                f"got a set of fields; write one number, {self._advice}; a distribution, such as "
                "{normal: {sd: 5 %}}, goes into the file of uncertainty --distributions"
            )
        if isinstance(value, bool) or not isinstance(value, Real):
            raise self._refuse(value, "")
        try:
            number = float(value)
        except (OverflowError, TypeError):  # an enormous int, a complex number
            raise self._refuse(value, "; must be a finite number") from None
        self._check(number, number)
        return number

    def _check(self, number: float, given: object) -> None:
        low, high = _limit(self.low, self.si), _limit(self.high, self.si)
        if not low <= number <= high:  # this refuses NaN too
            got = quote(given) + (f" {self.si}" if isinstance(given, float) else "").rstrip()
            raise wrong(f"got {got}; must lie between {self.low} and {self.high}")

    def json_schema(self) -> dict[str, Any]:
        if not self.si:
            low, high = float(self.low), float(self.high)
            examples = [float(self.example)]
            return {"type": "number", "minimum": low, "maximum": high, "examples": examples}

        def text(more: str, example: str) -> dict[str, Any]:
            pattern = rf"^\s*{NUMBER}{more}\s*[A-Za-zµμ°].*$"
            return {"type": "string", "pattern": pattern, "examples": [example]}

        numbers, unit = _split(self.example)
        one = text("", f"{numbers[-1]} {unit}")
        if self.vector is None:
            return one
        times = f"{{{self.vector - 1}}}" if self.vector else "*"
        row = text(rf"(\s+{NUMBER}){times}", self.example)
        array: dict[str, Any] = {"type": "array", "items": one, "minItems": self.vector or 1}
        if self.vector:
            array["maxItems"] = self.vector
        return {"anyOf": [row, array]}


@dataclass(frozen=True)
class Count(Marker):
    """Annotation of a field that is a whole number from 1."""

    most: int
    example: str

    def read(self, value: object) -> int:
        if isinstance(value, str) and re.fullmatch(r"[+-]?[0-9]{1,15}", value.strip()):
            number: object = int(value)
        else:
            number = value
        if (
            isinstance(number, bool)
            or not isinstance(number, Integral)
            or not 1 <= int(number) <= self.most
        ):
            raise wrong(f"got {quote(value)}; must be a whole number from 1 to {self.most}")
        return int(number)

    def json_schema(self) -> dict[str, Any]:
        examples = [int(self.example)]
        return {"type": "integer", "minimum": 1, "maximum": self.most, "examples": examples}


@dataclass(frozen=True)
class Share(Marker):
    """Annotation of a share, given as a plain number or in percent."""

    example: str
    high: float

    def read(self, value: object) -> float:
        share = math.nan
        if isinstance(value, str):
            with suppress(ValueError):
                share = read_share(value)
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            share = float(value)
        if not 0.0 < share <= self.high:
            raise wrong(
                f"got {quote(value)}; must be above 0 and at most {self.high:g} (or "
                f'{self.high:.0%}), write for example "{self.example}"'
            )
        return share

    def json_schema(self) -> dict[str, Any]:
        return {"type": ["string", "number"], "examples": [self.example]}


@dataclass(frozen=True)
class Choice(Marker):
    """Annotation of a field with a fixed set of words."""

    words: tuple[str, ...]
    example: str

    def read(self, value: object) -> str:
        if not isinstance(value, str) or value.strip() not in self.words:
            raise wrong(f"got {quote(value)}; must be one of {', '.join(self.words)}")
        return value.strip()

    def json_schema(self) -> dict[str, Any]:
        return {"type": "string", "enum": list(self.words), "examples": [self.example]}


@dataclass(frozen=True)
class Text(Marker):
    """Annotation of a text of limited length; ``lines`` allows line feeds and empty text."""

    most: int
    example: str
    lines: bool = False

    def read(self, value: object) -> str:
        if not isinstance(value, str):
            raise wrong(f"got {quote(value)}; must be text")
        text = value.strip()
        shown = re.sub(r"[\n\t]", " ", text) if self.lines else text
        if not (text or self.lines) or len(text) > self.most or not shown.isprintable():
            raise wrong(f"got {quote(value)}; must be up to {self.most} printable characters")
        return text

    def json_schema(self) -> dict[str, Any]:
        return {
            "type": "string",
            "minLength": 0 if self.lines else 1,
            "maxLength": self.most,
            "examples": [self.example],
        }
