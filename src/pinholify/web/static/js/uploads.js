/** Uploads of dropped or chosen files: a few at a time, shown at once, with a notice for each that is refused. */

import { upload } from "./api.js";
import { byId, announce } from "./dom.js";
import { notice } from "./notices.js";
import { applyEvent, changed, state } from "./state.js";

const AT_ONCE = 3;
const VIDEO = /\.(mp4|mov|m4v|webm|mkv|avi)$/i;

let waiting = [];
let running = 0;
let count = 0;

/** Upload `files` to the session whose id `session` resolves to. */
export async function add(files, session) {
  const fitting = files.filter(fits);
  if (!fitting.length) return;
  const id = await session();
  if (!id) return;
  announce(fitting.length === 1 ? `Adding ${fitting[0].name}` : `Adding ${fitting.length} files`);
  for (const file of fitting) {
    const key = `arriving-${(count += 1)}`;
    state.arriving.set(key, { name: file.name, url: isVideo(file) ? null : URL.createObjectURL(file) });
    waiting.push({ file, key, session: id });
    state.expected += 1;
  }
  changed();
  while (running < AT_ONCE && waiting.length) next();
}

/** Cancel the uploads that have not started. */
export function stop() {
  for (const { key } of waiting) arrived(key);
  waiting = [];
}

export const isVideo = (file) => file.type.startsWith("video/") || VIDEO.test(file.name);

function fits(file) {
  const most = isVideo(file) ? state.about.video_bytes : state.about.photograph_bytes;
  if (file.size <= most) return true;
  notice(`“${file.name}” has ${Math.round(file.size / 1e6)} MB; the limit is ${Math.round(most / 1e6)} MB`);
  return false;
}

async function next() {
  const { file, key, session } = waiting.shift();
  running += 1;
  const kind = isVideo(file) ? "videos" : "photographs";
  try {
    const photograph = await upload(`/sessions/${session}/${kind}?name=${encodeURIComponent(file.name)}`, file);
    if (kind === "photographs" && state.session?.id === session) applyEvent({ kind: "photograph", photograph });
  } catch (error) {
    notice(error.message);
  }
  arrived(key);
  running -= 1;
  if (waiting.length) next();
}

function arrived(key) {
  const picture = state.arriving.get(key);
  if (picture?.url) URL.revokeObjectURL(picture.url);
  state.arriving.delete(key);
  if (!state.arriving.size) state.expected = 0;
  changed();
}

/** Let files be dropped anywhere on the page; `onFiles` is called with them. */
export function acceptDrops(onFiles) {
  const veil = byId("drop-veil");
  const carriesFiles = (event) => event.dataTransfer?.types.includes("Files");
  addEventListener("dragenter", (event) => { if (carriesFiles(event)) veil.hidden = false; });
  addEventListener("dragover", (event) => event.preventDefault());
  addEventListener("dragleave", (event) => { if (!event.relatedTarget) veil.hidden = true; });
  addEventListener("drop", (event) => {
    event.preventDefault();
    veil.hidden = true;
    onFiles(event.dataTransfer.files);
  });
}
