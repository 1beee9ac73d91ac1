/** Numbers with units, as robot files write them: "641 mm", "0 0 -9.80665 m/s^2". */

const UNITS: Record<string, Record<string, number>> = {
  "": {},
  m: { m: 1, cm: 1e-2, mm: 1e-3, um: 1e-6, km: 1e3 },
  kg: { kg: 1, g: 1e-3, mg: 1e-6 },
  Pa: { Pa: 1, kPa: 1e3, MPa: 1e6, GPa: 1e9, TPa: 1e12 },
  "kg/m^3": { "kg/m^3": 1, "g/cm^3": 1e3 },
  "m/s^2": { "m/s^2": 1 },
  rad: { rad: 1, deg: Math.PI / 180 },
  N: { N: 1, mN: 1e-3, kN: 1e3 },
  "m/N": { "m/N": 1, "mm/N": 1e-3, "um/N": 1e-6 },
  "kg*m^2": { "kg*m^2": 1, "kg*mm^2": 1e-6, "g*mm^2": 1e-9 },
};
/** Unit that a number without one probably has; a length below `metres` is probably in metres. */
function likelyUnit(x: number, si: string, metres: number): string {
  const size = Math.abs(x);
  if (si === "m") return size < metres ? "m" : "mm";
  if (si === "kg") return size < 1 ? "kg" : "g";
  if (si === "Pa") return size < 1e4 ? "GPa" : size < 1e7 ? "MPa" : "Pa";
  if (si === "rad") return size <= 2 * Math.PI ? "rad" : "deg";
  if (si === "kg/m^3") return size < 100 ? "g/cm^3" : si;
  if (si === "m/N") return size < 0.01 ? si : "mm/N";
  if (si === "kg*m^2") return size < 0.01 ? si : "kg*mm^2";
  return si;
}

const NUMBER = /^[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?/;
const SAME: Record<string, string> = { "²": "^2", "³": "^3", µ: "u", μ: "u", "°": "deg", "·": "*" };

/** A text of a file, short enough for a message. */
export function shortened(text: string): string {
  return text.length > 40 ? `${text.slice(0, 40)}...` : text;
}

/** What was found in place of a value, short enough for a message. */
export function quote(value: unknown): string {
  return `"${shortened(typeof value === "string" ? value : (JSON.stringify(value) ?? String(value)))}"`;
}

/**
 * Numbers in SI.
 *
 * @param value text with a unit, or a plain number where `si` is "".
 * @param si SI unit of the quantity.
 * @param metres length below which a number without a unit is probably in metres.
 * @throws Error whose message continues the name of the field.
 */
export function readQuantities(value: unknown, si: string, metres: number): number[] {
  if (typeof value === "number" && si === "") return [value];
  if (typeof value === "number") throw new Error(`got ${value} without a unit; write for example "${value} ${likelyUnit(value, si, metres)}"`);
  if (typeof value !== "string") throw new Error(`got ${quote(value)}, which is not a number with a unit`);
  const words = value.trim().split(/\s+/);
  const numbers: number[] = [];
  let unit = "";
  for (const [i, word] of words.entries()) {
    const match = word.length <= 100 ? NUMBER.exec(word) : null;
    if (match === null) {
      unit = words.slice(i).join("");
      break;
    }
    numbers.push(Number(match[0]));
    const rest = word.slice(match[0].length);
    if (rest !== "") {
      unit = [rest, ...words.slice(i + 1)].join("");
      break;
    }
  }
  if (numbers.length === 0) throw new Error(`got ${quote(value)}, which is not a number with a unit`);
  const largest = Math.max(...numbers.map(Math.abs));
  if (unit === "" && si !== "") throw new Error(`got ${quote(value)} without a unit; write for example "${words.join(" ")} ${likelyUnit(largest, si, metres)}"`);
  const plain = [...unit].map((c) => SAME[c] ?? c).join("").replaceAll("**", "^");
  if (unit !== "" && !Object.hasOwn(UNITS[si], plain)) {
    const known = Object.keys(UNITS[si]).join(", ");
    throw new Error(`got ${quote(value)}; the unit must be ${known === "" ? "left out" : `one of ${known}`}`);
  }
  return numbers.map((number) => number * (unit === "" ? 1 : UNITS[si][plain]));
}

/** A number with at most `digits` significant digits, without trailing zeros. */
export function short(value: number, digits = 3): string {
  if (!Number.isFinite(value)) return "–";
  return String(Number(value.toPrecision(digits)));
}
