/**
 * The life of a live session's connection.
 *
 *     connecting ──► live ──► closed          by `close()`
 *         ▲            │
 *         └─ waiting ◄─┴─► failed             busy: until there is room; lost: after a moment, longer each time
 */

import { Problem, request } from "../api.js";
import { dial } from "./wire.js";

const MOST_WAIT_MS = 5000;
const FIRST_WAIT_MS = 250;
/** A lost session waits as long on the other side: its place is still ours. */
const RESUME_MS = 10_000;
const MOST_TRIES = 12;
const BYE_MS = 1500;

/** Close codes after which trying again makes sense; all others of the protocol say that something is wrong. */
const PASSING = new Set([1000, 1001, 1005, 1006, 1011, 1012, 1013, 4408, 4410, 4430]);
const BUSY = 1013;
const BAD_FRAME = 4415;

/** What the service can do now, and in how many seconds to ask again if it has no room. Throws a Problem. */
export async function lookAround() {
  const answer = await request("/v1/live");
  return { ...(await answer.json()), retryAfterS: Number(answer.headers.get("Retry-After") ?? 5) };
}

/**
 * @param {object} told
 * @param {function(object|null): Promise<object>} told.hello the first message, made anew for each connection from what
 *     `lookAround` has just found, if it did
 * @param {function(object)} told.onready @param {function(object)} told.onmessage @param {function(ArrayBuffer)} told.onframe
 * @param {function(object)} told.onstate {name: "connecting"|"live"|"closed"} or {name: "waiting", why: "busy"|"lost", until}
 *     or {name: "failed", problem}; `until` on the clock of `performance.now()`
 * @param {function(): boolean} told.refused a frame was refused: true if `hello` will do it differently now
 */
export function createConnection({ hello, onready, onmessage, onframe, onstate, refused }) {
  let socket = null;
  let session = "";
  let tries = 0;
  let seen = 0;
  let turn = 0;
  let timer = 0;
  let fatal = null;
  let live = false;

  async function open() {
    const mine = ++turn;
    clearTimeout(timer);
    live = false;
    if (!session || tries === 0) onstate({ name: "connecting" });
    try {
      const room = !session || tries > 1 ? await lookAround() : null;
      if (mine !== turn) return;
      if (room?.free === 0 && !waitsForUs()) return wait("busy", room.retryAfterS * 1000);
      const first = await hello(room);
      if (mine === turn) connect(first);
    } catch (problem) {
      if (mine !== turn) return;
      if (!(problem instanceof Problem)) console.error(problem);
      if (problem.code === "offline" || problem.status >= 500 || problem.status === 429) lost();
      else fail(problem);
    }
  }

  const waitsForUs = () => session && performance.now() - seen < RESUME_MS;

  function connect(first) {
    const mine = (socket = dial(session));
    const ours = (listener) => (event) => mine === socket && listener(event);
    fatal = null;
    mine.addEventListener("open", ours(() => mine.send(JSON.stringify(first))));
    mine.addEventListener("message", ours(({ data }) => (typeof data === "string" ? hear(JSON.parse(data)) : see(data))));
    mine.addEventListener("close", ours((event) => ended(event.code)));
  }

  /** Only an answer proves that all is well again. */
  function see(data) {
    tries = 0;
    onframe(data);
  }

  function hear(message) {
    if (message.type === "ready") {
      session = message.session;
      live = true;
      onstate({ name: "live" });
      onready(message);
    } else if (message.type === "error" && message.fatal) {
      fatal = message;
    } else {
      onmessage(message);
    }
  }

  function ended(code) {
    if (live) seen = performance.now();
    live = false;
    socket = null;
    if (code === BUSY) return wait("busy", (fatal?.retry_after_s ?? 5) * 1000);
    if (PASSING.has(code) || (code === BAD_FRAME && refused())) return lost();
    fail(problemOfClose(code, fatal?.problem));
  }

  function lost() {
    tries += 1;
    if (tries > MOST_TRIES) return fail(unreachable());
    wait("lost", tries === 1 ? 0 : Math.min(MOST_WAIT_MS, FIRST_WAIT_MS * 2 ** (tries - 2)));
  }

  /** Try again after `ms`, and not before the tab is seen. */
  function wait(why, ms) {
    onstate({ name: "waiting", why, until: performance.now() + ms });
    timer = setTimeout(() => (document.hidden ? document.addEventListener("visibilitychange", open, { once: true }) : open()), ms);
  }

  function fail(problem) {
    forget();
    onstate({ name: "failed", problem });
  }

  function forget() {
    turn += 1;
    clearTimeout(timer);
    document.removeEventListener("visibilitychange", open);
    socket = null;
    live = false;
  }

  /** Say goodbye; resolves to the figures of the whole session, or null. */
  function close() {
    const [last, spoken] = [socket, live];
    forget();
    onstate({ name: "closed" });
    if (!last) return Promise.resolve(null);
    if (!spoken) return Promise.resolve(last.close(1000));
    return farewell(last);
  }

  return {
    open,
    close,
    /** Go on with another `hello`: a new connection takes the session over. */
    renew: () => (socket || live ? open() : undefined),
    say: (message) => live && socket.send(JSON.stringify(message)),
    send: (bytes) => socket.send(bytes),
    get live() {
      return live && socket?.readyState === WebSocket.OPEN;
    },
    /** Bytes that wait for the network. */
    get backlog() {
      return socket?.bufferedAmount ?? 0;
    },
  };
}

function farewell(socket) {
  return new Promise((done) => {
    const late = setTimeout(() => (socket.close(1000), done(null)), BYE_MS);
    socket.addEventListener("message", ({ data }) => {
      const message = typeof data === "string" ? JSON.parse(data) : {};
      if (message.type !== "bye") return;
      clearTimeout(late);
      done(message.stats);
    });
    socket.addEventListener("close", () => (clearTimeout(late), done(null)));
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ type: "bye" }));
  });
}

const unreachable = () =>
  new Problem({ code: "offline", title: "The connection is lost", detail: "The service does not answer any more.", remedy: "Check that it is running and that you are connected; then try again." });

const TOO_LARGE = ["The picture is too large", "The service does not take frames of this size.", "Choose a smaller size."];

const SAID = {
  1009: TOO_LARGE,
  4403: ["The session was ended", "An operator of the service has ended it.", "Ask them why, or try again later."],
  4404: ["Something is missing", "The service does not have what this session asks for.", "Remove the colour reference and drop it again."],
  4409: ["It goes on elsewhere", "Another page or program has taken this session up.", "Start again to have one of your own."],
  4413: TOO_LARGE,
  4415: ["The frames were not understood", "The service could not decode what this browser sent.", "Choose another codec under Connection."],
  4429: ["Too much at once", "The service got more frames or changes than it allows.", "Choose a lower rate, then start again."],
};

function problemOfClose(code, given) {
  const [title, detail, remedy] = SAID[code] ?? ["The session ended", `The service closed it (${code}).`, "Start again."];
  return new Problem({ code: `close-${code}`, detail, remedy, ...given, title });
}
