import { createHash } from "node:crypto";
import { defineConfig, type Plugin } from "vite";

/** Writes script and style into the page, which then is one file that needs no server. */
function oneFile(): Plugin {
  return {
    name: "one-file",
    enforce: "post",
    generateBundle(_, bundle) {
      const page = bundle["index.html"];
      if (page?.type !== "asset") throw new Error("the build has no index.html");
      let html = String(page.source);
      const put = (tag: RegExp, directive: string, open: string, content: string, close: string) => {
        const hash = createHash("sha256").update(content).digest("base64");
        // a function, as the content has dollar signs
        html = html.replace(tag, () => `${open}${content}${close}`).replace(`${directive} 'self'`, `${directive} 'sha256-${hash}'`);
      };
      for (const [name, part] of Object.entries(bundle)) {
        if (part === page) continue;
        if (part.type === "chunk") {
          const code = part.code.replaceAll("</script", "<\\/script").replaceAll("<!--", "\\x3C!--");
          put(/<script type="module"[^>]*><\/script>/, "script-src", '<script type="module">', code, "</script>");
        } else if (name.endsWith(".css")) {
          put(/<link rel="stylesheet"[^>]*>/, "style-src", "<style>", String(part.source), "</style>");
        } else throw new Error(`the page must be one file, and ${name} is beside it`);
        delete bundle[name];
      }
      page.source = html;
    },
  };
}

export default defineConfig({
  plugins: [oneFile()],
  build: { target: "es2022", assetsInlineLimit: Infinity, chunkSizeWarningLimit: 3000, modulePreload: { polyfill: false } },
  // robot files come from the Python package
  server: { fs: { allow: [".."] } },
});
