/** The robots that come with the page. */

import amouri from "../../python/bowstring/robot/builtin/amouri2019.yaml?raw";
import crl from "../../python/bowstring/robot/builtin/crl-ftdcr-v4.yaml?raw";
import rao from "../../python/bowstring/robot/builtin/rao2021.yaml?raw";
import { readModel, type Model } from "./model";
import type { Source } from "./state";

const PRESETS = new Map([["amouri2019", amouri], ["crl-ftdcr-v4", crl], ["rao2021", rao]]);

export const NAMES = [...PRESETS.keys()];
export const FIRST = "amouri2019";

/** The robot of a source; throws where it cannot be read. */
export function modelFrom(source: Source): Model {
  if (!("preset" in source)) return readModel(source.text, source.fileName);
  const text = PRESETS.get(source.preset);
  if (text === undefined) throw new Error("the link names a robot that this page does not have");
  return readModel(text, source.preset);
}
