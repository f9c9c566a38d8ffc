/** The page: opens sessions, draws them, and handles the buttons. */

import { get, listen, post } from "./api.js";
import { byId, el } from "./dom.js";
import * as live from "./live.js";
import { clearNotices, notice, reportingErrors } from "./notices.js";
import { openBoard, prepareBoard, preparePrint } from "./print.js";
import { drawResult } from "./result.js";
import { create, drawSessions } from "./start.js";
import { applyEvent, reset, show, state } from "./state.js";
import { drawTiles } from "./tiles.js";
import * as uploads from "./uploads.js";
import { drawViewer } from "./viewer.js";

let current = null; // the id of the open session; empty on the start screen
let events = null;
let creating = null;
const ready = reportingErrors(get("/about"));

/** The id of the open session; creates one if none is open. */
async function session() {
  if (current) return current;
  creating ??= create().finally(() => { creating = null; });
  const id = await creating;
  if (id && id !== current) {
    location.hash = id;
    open();
  }
  return id;
}

/** Open the session in the address, or the start screen. */
function open() {
  const id = location.hash.slice(1);
  if (id === current) return;
  if (current) {
    live.stop();
    uploads.stop();
  }
  current = id;
  events?.close();
  events = null;
  reset();
  clearNotices();
  if (id) events = listen(id, onEvent, onLoss);
  else drawSessions();
  draw();
}

function onEvent(event) {
  if (event.kind === "notice") notice(event.text);
  else if (event.kind === "gone") location.hash = "";
  else applyEvent(event);
}

function onLoss(forGood) {
  if (!forGood) return;
  notice("The session cannot be opened. If it was not deleted, the app was restarted: open the address shown in the terminal");
}

function draw() {
  const id = current;
  const empty = state.photographs.size + state.arriving.size === 0 && !state.activity;
  const known = state.session !== null;
  byId("start").hidden = Boolean(id) && (!known || !empty || live.running());
  byId("sessions").hidden = Boolean(id) || byId("session-list").children.length === 0;
  byId("work").hidden = !(known && (!empty || live.running()));
  byId("all-sessions").hidden = !id;
  document.body.classList.toggle("at-work", !byId("work").hidden);
  drawActivity();
  if (!known) return;
  drawPill();
  drawTiles();
  drawViewer();
  drawResult();
  live.drawLive();
}

function drawActivity() {
  const activity = state.activity ?? arrivals();
  byId("activity").hidden = !activity;
  if (!activity) return;
  byId("activity-text").textContent = activity.text;
  const progress = byId("activity-progress");
  if (activity.share === null) progress.removeAttribute("value");
  else progress.value = activity.share;
}

/** The progress of photographs that were just added. */
function arrivals() {
  const { expected, arriving } = state;
  if (!arriving.size) return null;
  if (expected === 1) return { text: `Adding ${[...arriving.values()][0].name}`, share: null };
  const done = expected - arriving.size;
  return { text: `Searching for the board: ${done} of ${expected} done`, share: done / expected };
}

function drawPill() {
  const { board, square_mm: square } = state.session;
  const name = board ? board.spec.replace("x", "×") : "not detected yet";
  const text = square ? `${name}, ${square} mm` : name;
  const pill = byId("board-pill");
  if (pill.dataset.text === text) return;
  pill.dataset.text = text;
  pill.replaceChildren("Board: ", el("strong", {}, text), " ", el("button", { type: "button", class: "quiet", onclick: openBoard }, "Change"));
}

function chosen(event) {
  add(event.target.files);
  event.target.value = "";
}

/** Upload `files`, once the page knows the app's limits. */
async function add(files) {
  const all = [...files];
  if (await ready) uploads.add(all, session);
}

async function begin() {
  if (location.search) history.replaceState(null, "", location.pathname + location.hash);
  uploads.acceptDrops(add);
  byId("files").addEventListener("change", chosen);
  byId("more-files").addEventListener("change", chosen);
  state.about = await ready;
  if (!state.about) return;
  show(draw);
  preparePrint();
  prepareBoard();
  byId("use-camera").addEventListener("click", () => live.start(session));
  byId("more-camera").addEventListener("click", () => live.start(session));
  byId("live-stop").addEventListener("click", () => live.stop());
  byId("live-mirror").addEventListener("change", live.mirror);
  byId("stop").addEventListener("click", () => {
    uploads.stop();
    reportingErrors(post(`/sessions/${state.session.id}/cancel`));
  });
  addEventListener("hashchange", open);
  open();
}

begin();
