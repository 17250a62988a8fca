/** The inputs of a method besides the video: a drop zone for each, which shows the chosen file. */

import { useEffect, useRef, useState } from "preact/hooks";
import { asProblem, asset as assetOf, paths } from "../api/api";
import type { Asset, FileInput, Inputs as Given } from "../api/schemas";
import { bytes, percent } from "../ui/format";
import { Icon, IconButton } from "../ui/icons";
import { useMediaUrl } from "../ui/media";
import { upload } from "../ui/upload";
import { ACCEPT, Dropzone } from "./dropzone";

export interface InputsProps {
  /** The method's inputs without `video`. */
  specs: FileInput[];
  /** Asset ids by name of the input. */
  given: Given;
  onChange(given: Given): void;
  /** Problems of the service, by name of the input. */
  faults?: Record<string, string>;
}

export function Inputs({ specs, given, onChange, faults = {} }: InputsProps) {
  const latest = useRef(given);
  latest.current = given; // another upload may end first
  const slot = (spec: FileInput) => (
    <Slot
      key={spec.name}
      spec={spec}
      id={given[spec.name] ?? ""}
      fault={faults[spec.name] ?? ""}
      onChange={(id) => {
        const { [spec.name]: _old, ...rest } = latest.current;
        latest.current = id ? { ...rest, [spec.name]: id } : rest;
        onChange(latest.current);
      }}
    />
  );
  const folded = specs.filter(rare);
  return (
    <div class="inputs" hidden={!specs.length}>
      {specs.filter((spec) => !rare(spec)).map(slot)}
      {folded.length > 0 && (
        <details class="more-inputs" open={folded.some(({ name }) => given[name] || faults[name])}>
          <summary>Advanced inputs</summary>
          {folded.map(slot)}
        </details>
      )}
    </div>
  );
}

/** Pictures and films come first; inputs that few users have are folded away unless they are required. */
const rare = (spec: FileInput): boolean =>
  !spec.required && (["json", "images"].includes(spec.kind) || /guide|lines/.test(spec.name));

interface SlotProps {
  spec: FileInput;
  /** The asset's id, or empty. */
  id: string;
  fault: string;
  onChange(id: string): void;
}

function Slot({ spec, id, fault, onChange }: SlotProps) {
  const [asset, setAsset] = useState<Asset | null>(null);
  const [sent, setSent] = useState<number | null>(null);
  const [refused, setRefused] = useState("");
  const wrong = refused || fault;

  useEffect(() => {
    if (id && asset?.id !== id) assetOf(id).then(setAsset, () => onChange(""));
  }, [id]);

  async function take(file: File): Promise<void> {
    setSent(0);
    setRefused("");
    try {
      const made = await upload(file, { onProgress: setSent });
      setAsset(made);
      onChange(made.id);
    } catch (error) {
      const problem = asProblem(error);
      setRefused([problem.message, problem.remedy].join(" "));
    }
    setSent(null);
  }

  return (
    <div class={`slot ${wrong ? "wrong" : ""}`}>
      <div class="slot-title">
        {spec.title}
        {!spec.required && <span class="optional">optional</span>}
      </div>
      <div class="slot-content">
        {sent !== null ? (
          <div class="slot-file">
            <span>Uploading… {sent > 0 && percent(sent)}</span>
          </div>
        ) : id && asset?.id === id ? (
          <div class="slot-file">
            <Thumbnail asset={asset} />
            <span class="slot-name">
              {asset.filename}
              <small>{bytes(asset.size_bytes)}</small>
            </span>
            <IconButton name="close" label={`Remove ${spec.title}`} onClick={() => onChange("")} />
          </div>
        ) : (
          <Dropzone
            accept={ACCEPT[spec.kind]}
            label={`${spec.title}: choose a file`}
            onfiles={([file]) => file && take(file)}
            class="drop-small"
          >
            <Icon name="image" />
            <span>{spec.help}</span>
          </Dropzone>
        )}
      </div>
      <p class="field-error">{wrong}</p>
    </div>
  );
}

function Thumbnail({ asset }: { asset: Asset }) {
  const shown = ["image", "video"].includes(asset.kind);
  const url = useMediaUrl(shown ? paths.content(asset.id) : "");
  if (!shown) return <Icon name="image" />;
  const src = url ? { src: url } : {};
  return (
    <span class="slot-thumb">
      {asset.media_type.startsWith("image/") ? <img alt="" {...src} /> : <video muted preload="metadata" {...src} />}
    </span>
  );
}
