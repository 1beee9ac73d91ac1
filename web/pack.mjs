/** `node pack.mjs INPUT OUTPUT`: compresses the core. */

import { readFileSync, writeFileSync } from "node:fs";
import { gzipSync } from "node:zlib";

const [input, output] = process.argv.slice(2);
writeFileSync(output, gzipSync(readFileSync(input), { level: 9 }));
