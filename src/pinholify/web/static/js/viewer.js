/** The selected photograph, large: as taken with its corners, and straightened, with a slider between them. */

import { picture } from "./api.js";
import { byId, el } from "./dom.js";
import { overlay } from "./overlay.js";
import { shownPhotograph, stale, state } from "./state.js";

let shown = "";
let split = 50;
let former = { of: "", address: "" }; // the last straightened picture, shown until the next is loaded

export function drawViewer() {
  const stage = byId("stage");
  const photograph = shownPhotograph();
  if (!photograph) {
    stage.replaceChildren();
    shown = "";
    return;
  }
  const signature = JSON.stringify([
    photograph.id, photograph.uv.length, photograph.uv[0], photograph.included,
    state.solve, state.result?.stage, state.session.board?.spec,
  ]);
  if (signature !== shown) {
    shown = signature;
    stage.replaceChildren(...parts(photograph));
  }
  stage.classList.toggle("stale", stale());
}

function parts(photograph) {
  const base = `/sessions/${state.session.id}/photographs/${photograph.id}`;
  const board = state.result?.boards[photograph.id];
  const before = el(
    "div",
    { class: "before" },
    el("img", { src: `/api${base}/view.jpg`, alt: `${photograph.name} as photographed` }),
    photograph.found ? overlay(photograph, state.session.board?.columns ?? 1, board, state.result?.rms_px ?? 0) : null,
  );
  const frame = el("div", { class: "frame" }, before);
  frame.style.setProperty("--ratio", `${photograph.size[0]} / ${photograph.size[1]}`);
  if (state.result) frame.append(...straight(photograph, base, frame));
  return [frame, caption(photograph, board)];
}

function straight(photograph, base, frame) {
  const image = el("img", { alt: `${photograph.name} straightened` });
  const after = el("div", { class: "after" }, image);
  image.addEventListener("load", () => frame.classList.add("ready"));
  if (former.of === base) image.src = former.address;
  const wanted = shown;
  picture(`${base}/straight.jpg`).then(
    (address) => {
      if (wanted !== shown) { URL.revokeObjectURL(address); return; }
      image.src = address;
      URL.revokeObjectURL(former.address);
      former = { of: base, address };
    },
    () => {}, // a newer camera has replaced this one, and its picture is being loaded
  );
  const slider = el("input", {
    type: "range", min: "0", max: "100", value: String(split), class: "split",
    "aria-label": "From straightened to as photographed",
    oninput: (event) => move(Number(event.target.value)),
  });
  const move = (value) => {
    split = value;
    frame.style.setProperty("--split", `${value}%`);
  };
  move(split);
  return [
    after, el("span", { class: "divider", "aria-hidden": "true" }), slider,
    el("span", { class: "tag left", "aria-hidden": "true" }, "as photographed"),
    el("span", { class: "tag right", "aria-hidden": "true" }, "straight"),
  ];
}

function caption(photograph, board) {
  const facts = [`${photograph.size[0]} × ${photograph.size[1]} px`];
  if (photograph.found) facts.push(`${photograph.uv.length} corners`);
  if (photograph.blur_px !== null) facts.push(`blur ${photograph.blur_px.toFixed(1)} px`);
  if (board?.rms_px) facts.push(`error ${board.rms_px.toFixed(2)} px`);
  if (photograph.ambiguous) facts.push("visible part of the board unknown");
  return el("p", { class: "caption" }, el("strong", {}, photograph.name), ` · ${facts.join(" · ")}`);
}
