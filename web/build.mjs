/* Bundles src/ with three into ../knotfab/report/viewer/viewer.js, one classic script, and its notices beside it.

   The banner's hash is of the sources and the lockfile: a test holds it against what is committed. */
import { createHash } from "node:crypto";
import { copyFileSync, mkdirSync, readFileSync, readdirSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = fileURLToPath(new URL(".", import.meta.url));
const out = `${here}../knotfab/report/viewer/`;
const hash = createHash("sha256");
for (const name of ["package-lock.json", "build.mjs", ...readdirSync(`${here}src`).sort().map((file) => `src/${file}`)])
  hash.update(`${name}\n`).update(readFileSync(here + name));
const notice = `${here}node_modules/three/LICENSE`;
const licence = readFileSync(notice, "utf8").replace("\u00a9", "(c)");
const { version } = JSON.parse(readFileSync(`${here}node_modules/three/package.json`, "utf8"));

mkdirSync(out, { recursive: true });
await build({
  absWorkingDir: here,
  entryPoints: ["src/viewer.js"],
  outfile: `${out}viewer.js`,
  bundle: true,
  minify: true,
  format: "iife",
  globalName: "KnotfabViewer",
  target: ["es2022", "chrome110", "firefox110", "safari16.4"],
  loader: { ".css": "text" },
  legalComments: "none",
  charset: "ascii",
  banner: {
    js: `/*! knotfab viewer, GPL-3.0-or-later; sources sha256:${hash.digest("hex")}\n`
      + `It contains three.js ${version}, under this licence:\n\n${licence.trim()} */`,
  },
});
copyFileSync(notice, `${out}three-LICENSE.txt`);
