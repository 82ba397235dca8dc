// Bundles the page into ../page. Licences of libraries stay as comments at the end of each file.
import { copyFile, mkdir, rm } from "node:fs/promises";
import { build } from "esbuild";

const out = new URL("../page/", import.meta.url).pathname;
await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });
await build({
  entryPoints: [{ in: "src/main.ts", out: "studio" }, { in: "src/studio.css", out: "studio" }],
  outdir: out,
  bundle: true,
  splitting: true,
  format: "esm",
  target: "es2022",
  minify: true,
  legalComments: "eof",
  logLevel: "warning",
});
await copyFile("src/index.html", `${out}index.html`);
