/** The photographs as tiles: the picture with its corners, its error, and whether it is included. */

import { change, remove } from "./api.js";
import { byId, el, sentence } from "./dom.js";
import { reportingErrors } from "./notices.js";
import { overlay } from "./overlay.js";
import { changed, photographs, shownPhotograph, state } from "./state.js";

const drawn = new Map(); // key -> { signature, element }

export function drawTiles() {
  const list = byId("tiles");
  const wanted = photographs().map(photographTile);
  wanted.push(...[...state.arriving].map(([key, picture]) => arrivingTile(key, picture)));
  const keep = new Set(wanted.map(({ key }) => key));
  for (const key of drawn.keys()) if (!keep.has(key)) drawn.delete(key);
  const elements = wanted.map(({ key, signature, make }) => {
    const known = drawn.get(key);
    if (known?.signature === signature) return known.element;
    const focused = known?.element.contains(document.activeElement) ? document.activeElement.dataset.part : null;
    const element = make();
    drawn.set(key, { signature, element });
    if (focused) setTimeout(() => element.querySelector(`[data-part="${focused}"]`)?.focus());
    return element;
  });
  if (elements.length !== list.children.length || elements.some((e, i) => list.children[i] !== e)) {
    list.replaceChildren(...elements);
  }
}

function photographTile(photograph) {
  const board = state.result?.boards[photograph.id] ?? null;
  const chosen = shownPhotograph()?.id === photograph.id;
  const largest = largestError();
  const columns = state.session.board?.columns ?? 1;
  const error = photograph.included ? board?.rms_px ?? null : null;
  const parts = [photograph.included, photograph.found, photograph.uv.length, photograph.uv[0], photograph.reason];
  const signature = JSON.stringify([...parts, photograph.suggestion, columns, chosen, error, largest, board?.reason]);
  return { key: photograph.id, signature, make: () => tile(photograph, board, error, largest, chosen, columns) };
}

function tile(photograph, board, error, largest, chosen, columns) {
  const path = `/sessions/${state.session.id}/photographs/${photograph.id}`;
  const picture = el(
    "button",
    {
      type: "button", class: "picture", "data-part": "picture", "aria-pressed": String(chosen),
      "aria-label": `Show ${photograph.name}`,
      onclick: () => { state.selected = photograph.id; changed(); },
    },
    el("img", { src: `/api${path}/thumb.jpg`, alt: "", loading: "lazy", width: photograph.size[0], height: photograph.size[1] }),
    photograph.found ? overlay(photograph, columns) : null,
  );
  const counts = el("input", {
    type: "checkbox", "data-part": "include", "aria-label": `Include ${photograph.name}`,
    checked: photograph.included, disabled: !photograph.found,
    onchange: (event) => reportingErrors(change(path, { included: event.target.checked })),
  });
  const away = el("button", {
    type: "button", class: "quiet away", "aria-label": `Remove ${photograph.name}`,
    onclick: () => reportingErrors(remove(path)),
  }, "×");
  return el(
    "li",
    { class: `tile${photograph.included && photograph.found ? "" : " out"}`, "data-photograph": photograph.id },
    picture,
    el("div", { class: "tile-foot" }, counts, el("span", { class: "name", title: photograph.name }, photograph.name), away),
    errorLine(photograph, board, error, largest),
  );
}

function errorLine(photograph, board, error, largest) {
  if (!photograph.found) return el("p", { class: "why" }, sentence(whyNot(photograph)));
  if (!photograph.included) return el("p", { class: "why" }, "Left out.");
  if (board && !board.used) return el("p", { class: "why" }, `Not scored: ${sentence(board.reason)}`);
  if (error === null) return el("p", { class: "why" }, `${photograph.uv.length} corners`);
  const bar = el("span", { class: "error-bar", "aria-hidden": "true" });
  bar.style.setProperty("--share", String(Math.min(1, error / largest)));
  return el("p", { class: "error" }, bar, `${error.toFixed(2)} px`);
}

function whyNot(photograph) {
  return photograph.suggestion ? `It shows a board of ${photograph.suggestion.replace("x", "×")}` : photograph.reason;
}

function arrivingTile(key, picture) {
  const make = () => el(
    "li",
    { class: "tile arriving" },
    el("div", { class: "picture" }, picture.url ? el("img", { src: picture.url, alt: "" }) : null),
    el("div", { class: "tile-foot" }, el("span", { class: "name" }, picture.name)),
    el("p", { class: "why" }, picture.url ? "Searching for the board …" : "Uploading the video …"),
  );
  return { key, signature: key, make };
}

/** The error that corresponds to a full bar: the largest of all photographs. */
export function largestError() {
  const errors = Object.values(state.result?.boards ?? {}).map((board) => board.rms_px ?? 0);
  return Math.max(...errors, 0.01);
}
