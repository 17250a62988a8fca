import { defineConfig } from "vitest/config";

/** The tests call functions without side effects, so that one process runs all of them: a third of the time. */
export default defineConfig({ test: { include: ["test/**/*.test.ts"], pool: "threads", isolate: false } });
