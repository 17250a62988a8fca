/** Style sheets are imported for their effect; the bundler links them from the page. */
declare module "*.css";

/** The samples of a track, which Chromium hands out; not part of TypeScript's DOM types. */
declare class MediaStreamTrackProcessor {
  constructor(init: { track: MediaStreamTrack });
  readonly readable: ReadableStream<AudioData>;
}
