import { defineConfig } from "vite";

/** Four pages; every address below /static/, and no inline data: the content security policy allows neither. */
export default defineConfig({
  base: "/static/",
  // Scripts and styles refer to their parts by relative addresses, so that a proxy may serve them under a prefix.
  experimental: { renderBuiltUrl: (_, { hostType }) => (hostType === "html" ? undefined : { relative: true }) },
  build: {
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    rolldownOptions: { input: ["index.html", "live.html", "live-view.html", "ops.html"] },
    target: "es2022",
  },
});
