/** The live camera: frames are sent one after another, and the app keeps those that are sharp and new. */

import { upload } from "./api.js";
import { announce, byId, el, svg } from "./dom.js";
import { bars, nextBoard } from "./coverage.js";
import { notice } from "./notices.js";
import { dots, latticePath, polygon } from "./overlay.js";
import { state } from "./state.js";

const PAUSE = 60; // ms between frames
const QUALITY = 0.95;
const CAMERA = { facingMode: "environment", width: { ideal: 1920 }, height: { ideal: 1080 }, resizeMode: "none" };

let stream = null;
let last = null;
let taken = 0;

export const running = () => stream !== null;

/** Start the camera and send frames until `stop`, to the session whose id `session` resolves to. */
export async function start(session) {
  if (running()) return;
  if (!navigator.mediaDevices) {
    notice("The browser allows the camera only for pages of this computer or over HTTPS; open the app at 127.0.0.1");
    return;
  }
  try {
    stream = await navigator.mediaDevices.getUserMedia({ video: CAMERA, audio: false });
  } catch (error) {
    notice(error.name === "NotFoundError" ? "No camera was found; connect one and try again"
      : "The browser refused access to the camera; allow it for this page and try again");
    return;
  }
  const id = await session();
  if (!id) { stop(); return; }
  const video = byId("video");
  video.srcObject = stream;
  byId("live-mirror").checked = stream.getVideoTracks()[0].getSettings().facingMode === "user";
  mirror();
  taken = state.session?.usable.length ?? 0;
  byId("live").hidden = false;
  byId("stage").hidden = true;
  await video.play();
  byId("live-picture").style.setProperty("--wide", String(video.videoWidth / video.videoHeight));
  sendFrames(id, video, stream);
}

export function stop() {
  if (!stream) return;
  stream.getTracks().forEach((track) => track.stop());
  stream = null;
  last = null;
  byId("video").srcObject = null;
  byId("live").hidden = true;
  byId("stage").hidden = false;
}

async function sendFrames(id, video, mine) {
  const canvas = document.createElement("canvas");
  while (stream === mine) {
    try {
      const picture = await grab(video, canvas);
      if (picture) onFrame(await upload(`/sessions/${id}/frames`, picture));
    } catch (error) {
      notice(error.message);
      stop();
    }
    await new Promise((done) => setTimeout(done, PAUSE));
  }
}

async function grab(video, canvas) {
  if (!video.videoWidth) return null;
  Object.assign(canvas, { width: video.videoWidth, height: video.videoHeight });
  canvas.getContext("2d").drawImage(video, 0, 0);
  return new Promise((done) => canvas.toBlob(done, "image/jpeg", QUALITY));
}

function onFrame(frame) {
  if (!running()) return;
  last = frame;
  if (frame.kept) {
    taken += 1;
    announce(`Photograph ${taken} taken`);
    byId("live-picture").classList.remove("flash");
    requestAnimationFrame(() => byId("live-picture").classList.add("flash"));
  }
  drawLive();
}

export function mirror() {
  byId("live-picture").classList.toggle("mirrored", byId("live-mirror").checked);
  drawLive();
}

/** Draw the overlay and the hints; also called when the session changes. */
export function drawLive() {
  if (!running() || !state.session) return;
  if (state.accepted) {
    stop();
    notice("The camera is calibrated; you can put the board down");
    return;
  }
  setText("live-hint", last ? last.hint : "Starting the camera …");
  byId("live-count").textContent = `${state.session.usable.length} taken`;
  byId("live-advice").replaceChildren(el("span", {}, inView(nextBoard())), bars(state.session.bars));
  if (last) drawOverlay(last);
}

/** Change a text only if it differs, so that a screen reader announces it once. */
function setText(place, text) {
  if (byId(place).textContent !== text) byId(place).textContent = text;
}

function drawOverlay({ size: [width, height], ids, uv }) {
  const overlay = byId("live-overlay");
  const former = state.session.usable.flatMap((id) => state.photographs.get(id)?.uv ?? []);
  const next = state.result?.next?.outline;
  overlay.setAttribute("viewBox", `0 0 ${width} ${height}`);
  overlay.replaceChildren(
    svg("path", { class: "former", d: dots(former) }),
    next ? svg("path", { class: "ghost", d: polygon(next) }) : "",
    svg("path", { class: "lattice", d: latticePath({ ids, uv }, state.session.board?.columns ?? 1) }),
    svg("path", { class: "corner", d: dots(uv) }),
  );
}

/** `text` with left and right as the person sees them. */
function inView(text) {
  if (!byId("live-mirror").checked) return text;
  return text.replace(/\b(left|right)\b/g, (side) => (side === "left" ? "right" : "left"));
}
