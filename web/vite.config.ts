import { defineConfig } from "vite";

export default defineConfig({
  base: "./", // works in any folder of a server
  build: { target: "es2022", assetsInlineLimit: 0, modulePreload: { polyfill: false } },
  // robot files come from the Python package
  server: { fs: { allow: [".."] } },
});
