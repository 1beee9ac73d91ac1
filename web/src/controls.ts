/** Sliders and buttons. */

import { short } from "./units";

export interface SliderOptions {
  id: string;
  label: string;
  unit: string;
  /** Bounds and step in the unit that is shown. */
  least: number;
  most: number;
  step: number;
  value: number;
  digits?: number;
  onInput: (value: number) => void;
}

/** A labelled slider that shows its value with its unit. */
export function slider(options: SliderOptions): HTMLElement {
  const { id, label, unit, least, most, step, value, digits = 4 } = options;
  const row = document.createElement("div");
  row.className = "slider";
  const name = document.createElement("label");
  name.htmlFor = id;
  name.textContent = label;
  const output = document.createElement("output");
  output.htmlFor.add(id);
  const input = document.createElement("input");
  Object.assign(input, { type: "range", id, min: String(least), max: String(most), step: String(step) });
  input.value = String(value);
  const show = (x: number) => {
    const text = `${short(x, digits)} ${unit}`.trim();
    output.textContent = text;
    input.setAttribute("aria-valuetext", text);
  };
  show(value);
  input.addEventListener("input", () => {
    show(input.valueAsNumber);
    options.onInput(input.valueAsNumber);
  });
  input.addEventListener("show", () => show(Number(input.dataset.value)));
  row.append(name, output, input);
  return row;
}

/** Shows a value in a slider or field without an input by the user. */
export function showValue(id: string, value: number): void {
  const input = document.getElementById(id) as HTMLInputElement | null;
  if (input === null) return;
  input.value = String(value);
  input.dataset.value = String(value); // a slider rounds its own to its step
  input.dispatchEvent(new Event("show"));
}

/** A labelled number with its unit, written out by the user. */
export function field(
  id: string,
  label: string,
  unit: string,
  value: number,
  onChange: (value: number, text: string) => void,
): HTMLElement {
  const row = document.createElement("label");
  row.className = "field";
  const input = document.createElement("input");
  Object.assign(input, { type: "number", id, min: "0", step: "any", value: String(value) });
  input.addEventListener("change", () => onChange(input.valueAsNumber, input.value));
  row.append(label, input, unit);
  return row;
}

export function group(title: string, ...children: HTMLElement[]): HTMLFieldSetElement {
  const set = document.createElement("fieldset");
  const legend = document.createElement("legend");
  legend.textContent = title;
  set.append(legend, ...children);
  return set;
}

export function choice(
  id: string,
  label: string,
  values: [string, string][],
  value: string,
  onChange: (value: string) => void,
): HTMLElement {
  const row = document.createElement("div");
  const name = document.createElement("label");
  name.htmlFor = id;
  name.textContent = `${label} `;
  const select = document.createElement("select");
  select.id = id;
  for (const [key, text] of values) select.add(new Option(text, key, false, key === value));
  select.addEventListener("change", () => onChange(select.value));
  row.append(name, select);
  return row;
}

export function check(id: string, label: string, value: boolean, onChange: (value: boolean) => void): HTMLElement {
  const row = document.createElement("label");
  row.className = "check";
  const input = document.createElement("input");
  Object.assign(input, { type: "checkbox", id, checked: value });
  input.addEventListener("change", () => onChange(input.checked));
  row.append(input, ` ${label}`);
  return row;
}

export function button(id: string, label: string, onClick: () => void): HTMLButtonElement {
  const found = document.createElement("button");
  Object.assign(found, { type: "button", id, textContent: label });
  found.addEventListener("click", onClick);
  return found;
}

export function fileButton(id: string, label: string, accept: string, onFile: (file: File) => void): HTMLElement {
  const row = document.createElement("label");
  row.className = "file";
  const input = document.createElement("input");
  Object.assign(input, { type: "file", id, accept });
  input.addEventListener("change", () => {
    const [file] = input.files ?? [];
    if (file) onFile(file);
    input.value = "";
  });
  row.append(label, input);
  return row;
}

export function buttons(...children: HTMLElement[]): HTMLElement {
  const row = document.createElement("div");
  row.className = "buttons";
  row.append(...children);
  return row;
}

/** Offers a file for download. */
export function download(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
