/**
 * The life of a live session's connection.
 *
 *     connecting --> live --> closed          by `close()`
 *         ^            |
 *         +- waiting <-+--> failed             busy: until a place is free; lost: after a pause, longer each time
 */

import { asProblem, Problem, request } from "../api/api";
import type { ConnectionState, Hello, Incoming, LiveInfo, Ready, Stats } from "./types";
import { dial } from "./wire";

const MOST_WAIT_MS = 5000;
const FIRST_WAIT_MS = 250;
/** The service keeps a lost session for as long. */
const RESUME_MS = 10_000;
const MOST_TRIES = 12;
const BYE_MS = 1500;

/** Close codes after which trying again makes sense; all others of the protocol report a fault. */
const PASSING = new Set([1000, 1001, 1005, 1006, 1011, 1012, 1013, 4408, 4410, 4430]);
const BUSY = 1013;
const BAD_FRAME = 4415;

/** The service's abilities and free places at this moment. Throws a Problem. */
export async function readLiveInfo(): Promise<LiveInfo> {
  const answer = await request("/v1/live");
  return { ...(await answer.json()), retryAfterS: Number(answer.headers.get("Retry-After") ?? 5) };
}

export interface ConnectionEvents {
  /** The first message, made anew for each connection from the service's abilities where they have just been read. */
  hello(info: LiveInfo | null): Promise<Hello>;
  onready(message: Ready): void;
  onmessage(message: Incoming): void;
  onframe(data: ArrayBuffer): void;
  onstate(state: ConnectionState): void;
  /** A frame was refused: true if `hello` will choose another codec now. */
  refused(): boolean;
}

export interface Connection {
  open(): void;
  /** End the session; resolves to the figures of the whole session, or null. */
  close(): Promise<Stats | null>;
  /** Continue with another `hello`: a new connection takes the session over. */
  renew(): void;
  sendMessage(message: object): void;
  send(bytes: Uint8Array<ArrayBuffer>): void;
  readonly live: boolean;
  /** Bytes that wait for the network. */
  readonly backlog: number;
}

type FatalError = Extract<Incoming, { type: "error" }>;

export function createConnection({
  hello,
  onready,
  onmessage,
  onframe,
  onstate,
  refused,
}: ConnectionEvents): Connection {
  let socket: WebSocket | null = null;
  let session = "";
  let tries = 0;
  let lastLiveAt = 0;
  let turn = 0;
  let timer = 0;
  let fatal: FatalError | null = null;
  let live = false;

  async function open(): Promise<void> {
    const mine = ++turn;
    clearTimeout(timer);
    live = false;
    if (!session || tries === 0) onstate({ name: "connecting" });
    try {
      const info = !session || tries > 1 ? await readLiveInfo() : null;
      if (mine !== turn) return;
      if (info?.free === 0 && !placeIsKept()) return wait("busy", info.retryAfterS * 1000);
      const first = await hello(info);
      if (mine === turn) connect(first);
    } catch (error) {
      if (mine !== turn) return;
      const problem = asProblem(error);
      if (problem.code === "offline" || problem.status >= 500 || problem.status === 429) lost();
      else fail(problem);
    }
  }

  const placeIsKept = () => session && performance.now() - lastLiveAt < RESUME_MS;

  function connect(first: Hello): void {
    const mine = dial(session);
    socket = mine;
    fatal = null;
    mine.addEventListener("open", () => mine === socket && mine.send(JSON.stringify(first)));
    mine.addEventListener("message", ({ data }) => {
      if (mine !== socket) return;
      if (typeof data === "string") hear(JSON.parse(data));
      else see(data);
    });
    mine.addEventListener("close", (event) => mine === socket && ended(event.code));
  }

  /** Only an answer proves that the connection works again. */
  function see(data: ArrayBuffer): void {
    tries = 0;
    onframe(data);
  }

  function hear(message: Incoming): void {
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

  function ended(code: number): void {
    if (live) lastLiveAt = performance.now();
    live = false;
    socket = null;
    if (code === BUSY) wait("busy", (fatal?.retry_after_s ?? 5) * 1000);
    else if (PASSING.has(code) || (code === BAD_FRAME && refused())) lost();
    else fail(problemOfClose(code, fatal));
  }

  function lost(): void {
    tries += 1;
    if (tries > MOST_TRIES) fail(unreachable());
    else wait("lost", tries === 1 ? 0 : Math.min(MOST_WAIT_MS, FIRST_WAIT_MS * 2 ** (tries - 2)));
  }

  /** Try again after `ms`, and not before the tab is visible. */
  function wait(why: "busy" | "lost", ms: number): void {
    onstate({ name: "waiting", why, until: performance.now() + ms });
    timer = window.setTimeout(() => {
      if (document.hidden) document.addEventListener("visibilitychange", open, { once: true });
      else open();
    }, ms);
  }

  function fail(problem: Problem): void {
    forget();
    onstate({ name: "failed", problem });
  }

  function forget(): void {
    turn += 1;
    clearTimeout(timer);
    document.removeEventListener("visibilitychange", open);
    socket = null;
    live = false;
  }

  function close(): Promise<Stats | null> {
    const [last, spoken] = [socket, live];
    forget();
    onstate({ name: "closed" });
    if (last && spoken) return farewell(last);
    last?.close(1000);
    return Promise.resolve(null);
  }

  return {
    open: () => void open(),
    close,
    renew() {
      if (socket || live) open();
    },
    sendMessage(message) {
      if (live) socket?.send(JSON.stringify(message));
    },
    send: (bytes) => socket?.send(bytes),
    get live() {
      return live && socket?.readyState === WebSocket.OPEN;
    },
    get backlog() {
      return socket?.bufferedAmount ?? 0;
    },
  };
}

function farewell(socket: WebSocket): Promise<Stats | null> {
  return new Promise((done) => {
    const late = setTimeout(() => {
      socket.close(1000);
      done(null);
    }, BYE_MS);
    const end = (stats: Stats | null) => {
      clearTimeout(late);
      done(stats);
    };
    socket.addEventListener("message", ({ data }) => {
      const message: Incoming | null = typeof data === "string" ? JSON.parse(data) : null;
      if (message?.type === "bye") end(message.stats);
    });
    socket.addEventListener("close", () => end(null));
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ type: "bye" }));
  });
}

const unreachable = (): Problem =>
  new Problem({
    code: "offline",
    title: "The connection is lost",
    detail: "The service does not answer any more.",
    remedy: "Check that it is running and that you are connected; then try again.",
  });

type Explanation = [title: string, detail: string, remedy: string];
const TOO_LARGE: Explanation = [
  "The picture is too large",
  "The service does not take frames of this size.",
  "Choose a smaller size.",
];

const EXPLANATIONS: Record<number, Explanation> = {
  1009: TOO_LARGE,
  4403: ["The session was ended", "An operator of the service has ended it.", "Ask them why, or try again later."],
  4404: [
    "Something is missing",
    "The service does not have an input of this session.",
    "Remove the colour reference and drop it again.",
  ],
  4409: [
    "It goes on elsewhere",
    "Another page or program has taken this session over.",
    "Start again to have one of your own.",
  ],
  4413: TOO_LARGE,
  4415: [
    "The frames were not understood",
    "The service could not decode the frames of this browser.",
    "Choose another codec under Connection.",
  ],
  4429: [
    "Too much at once",
    "The service got more frames or changes than it allows.",
    "Choose a lower rate, then start again.",
  ],
};

function problemOfClose(code: number, fatal: FatalError | null): Problem {
  const [title, detail, remedy] = EXPLANATIONS[code] ?? [
    "The session ended",
    `The service closed it (${code}).`,
    "Start again.",
  ];
  return new Problem({ code: `close-${code}`, detail, remedy, ...fatal?.problem, title });
}
