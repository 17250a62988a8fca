/** Calls of a worker, which is started with the first one. */

export interface Call<Request> {
  id: number;
  request: Request;
}

export interface Answer<Value> {
  id: number;
  /** Absent if it failed. */
  value?: Value;
}

/**
 * A function that lets a worker work. It gives undefined if the worker failed, or if it cannot run, for example because the
 * connection was lost before its program was loaded.
 */
export function workerCalls<Request, Value>(
  start: () => Worker,
): (request: Request, transfer: Transferable[]) => Promise<Value | undefined> {
  const waiting = new Map<number, (value: Value | undefined) => void>();
  let worker: Worker | undefined;
  let asked = 0;

  function started(): Worker {
    const made = start();
    made.onmessage = ({ data: { id, value } }: MessageEvent<Answer<Value>>) => {
      waiting.get(id)?.(value);
      waiting.delete(id);
    };
    made.onerror = () => {
      for (const done of waiting.values()) done(undefined);
      waiting.clear();
      worker = undefined;
    };
    return made;
  }

  return (request, transfer) => {
    const call: Call<Request> = { id: ++asked, request };
    worker ??= started();
    const answer = new Promise<Value | undefined>((done) => waiting.set(call.id, done));
    worker.postMessage(call, transfer);
    return answer;
  };
}

/** Answer the calls of this worker. */
export function answerCalls<Request, Value>(work: (request: Request) => Value | Promise<Value>): void {
  self.onmessage = async ({ data: { id, request } }: MessageEvent<Call<Request>>) => {
    const answer: Answer<Value> = { id };
    try {
      answer.value = await work(request);
    } finally {
      self.postMessage(answer);
    }
  };
}
