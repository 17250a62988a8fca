/** Payloads to pictures: a video decoder of the browser, or an image each. */

const MOST_AT_ONCE = 3;

/**
 * @param {{codec: string, webcodecs?: string}} chosen `receive` of `ready`
 * @param {{onpicture(picture: CanvasImageSource, header), onlost(), onfault(error)}} told
 *     `onpicture` may use the picture until it returns; `onlost`: a key frame is needed; `onfault`: this decoder is done for
 * @returns {{decode(header), close()}}
 */
export const createDecoder = (chosen, told) => (chosen.webcodecs ? video(chosen, told) : stills(chosen, told));

function video({ webcodecs }, { onpicture, onlost, onfault }) {
  const headers = new Map();
  let needsKey = true;
  let asked = false;
  const decoder = new VideoDecoder({ output, error: onfault });
  decoder.configure({ codec: webcodecs, optimizeForLatency: true });

  function output(frame) {
    const header = headers.get(frame.timestamp);
    for (const sequence of headers.keys()) if (sequence <= frame.timestamp) headers.delete(sequence);
    if (header) onpicture(frame, header);
    frame.close();
  }

  function decode(header) {
    if (needsKey && !header.key) {
      if (!asked) onlost();
      asked = true;
      return;
    }
    needsKey = false;
    headers.set(header.sequence, header);
    decoder.decode(new EncodedVideoChunk({ type: header.key ? "key" : "delta", timestamp: header.sequence, data: header.payload }));
  }

  return { decode, close: () => decoder.state === "closed" || decoder.close() };
}

function stills({ codec }, { onpicture, onfault }) {
  let open = true;
  let atWork = 0;
  let shown = -1;

  async function decode(header) {
    if (atWork >= MOST_AT_ONCE) return;
    atWork += 1;
    try {
      const picture = await createImageBitmap(new Blob([header.payload], { type: `image/${codec}` }));
      if (open && header.sequence > shown) {
        shown = header.sequence;
        onpicture(picture, header);
      }
      picture.close();
    } catch (error) {
      if (open) onfault(error);
    }
    atWork -= 1;
  }

  return { decode, close: () => (open = false) };
}
