/** The start screen: instructions, the board, and the existing sessions. */

import { get, post, remove } from "./api.js";
import { byId, el } from "./dom.js";
import { reportingErrors } from "./notices.js";

/** Create a session with the board of the start screen; returns its id, undefined if the board is invalid. */
export async function create() {
  const square = Number(byId("square").value) || null;
  const made = await reportingErrors(post("/sessions", { board: byId("board").value.trim() || null, square_mm: square }));
  return made?.id;
}

export async function drawSessions() {
  const sessions = await reportingErrors(get("/sessions"));
  if (!sessions) return;
  byId("sessions").hidden = !sessions.length;
  byId("session-list").replaceChildren(...sessions.map(item));
}

function item(session) {
  const when = new Date(1000 * session.created).toLocaleString(undefined, { dateStyle: "medium", timeStyle: "short" });
  const picture = session.thumb
    ? el("img", { src: `/api/sessions/${session.id}/photographs/${session.thumb}/thumb.jpg`, alt: "" })
    : el("span", { class: "no-picture", "aria-hidden": "true" });
  const facts = [session.photographs === 1 ? "1 photograph" : `${session.photographs} photographs`];
  if (session.board) facts.push(session.board.replace("x", "×"));
  if (session.f_px) facts.push(`f = ${session.f_px.toFixed(1)} px`);
  const away = async () => {
    if (!confirm("Delete this session with its photographs?")) return;
    await reportingErrors(remove(`/sessions/${session.id}`));
    drawSessions();
  };
  return el(
    "li", { class: "session" },
    el("a", { href: `#${session.id}` }, picture, el("strong", {}, when), el("span", {}, facts.join(" · "))),
    el("button", { type: "button", class: "quiet away", "aria-label": `Delete the session of ${when}`, onclick: away }, "×"),
  );
}
