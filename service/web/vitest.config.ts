import { defineConfig } from "vitest/config";

/** The tests call functions without side effects, so that one process runs all of them: a third of the time. The time
 * limit ends a test that hangs; a busy machine needs more than the usual five seconds for a property test. */
export default defineConfig({
  test: { include: ["test/**/*.test.ts"], pool: "threads", isolate: false, testTimeout: 60_000 },
});
