/** The result next to the photographs: the verdict, f, the errors, the coverage and the downloads. */

import { change, download, post } from "./api.js";
import { announce, byId, el, sentence } from "./dom.js";
import { coverage } from "./coverage.js";
import * as live from "./live.js";
import { notice, reportingErrors } from "./notices.js";
import { openBoard } from "./print.js";
import { abandoned, changed, outdated, photographs, shownPhotograph, stale, state } from "./state.js";
import { largestError } from "./tiles.js";

const FEWEST = 3;
const LEVELS = { good: "Good", fair: "Fair", poor: "Poor" };
let shown = "";
let announced = "";

export function drawResult() {
  const signature = JSON.stringify([
    state.session, state.result, state.final, state.pending, state.problem, Boolean(state.activity), state.arriving.size,
    [...state.photographs.values()].map((p) => [p.id, p.included, p.suggestion, p.uv.length]), shownPhotograph()?.id,
  ]);
  if (signature === shown) return;
  shown = signature;
  const aside = byId("result");
  const open = new Set([...aside.querySelectorAll("details[open]")].map((details) => details.id));
  aside.replaceChildren(...[verdict(), focal(), errors(), coverage(), downloads()].filter(Boolean));
  for (const id of open) byId(id)?.setAttribute("open", "");
  aside.classList.toggle("stale", stale());
  aside.classList.toggle("unjudged", Boolean(state.result?.level) && (!state.final || stale()));
  announceVerdict();
}

function announceVerdict() {
  const text = state.final && state.result?.sentence ? state.result.sentence : "";
  if (text && text !== announced) announce(text);
  announced = text;
}

function verdict() {
  const other = suggestion();
  if (other) return otherBoard(other);
  if (state.problem && !state.activity && !state.pending) return card("verdict poor", chip("Not yet"), el("p", {}, sentence(state.problem)));
  if (!state.result) return waiting();
  const { level } = state.result;
  const again = abandoned()
    ? el("button", { type: "button", class: "primary", onclick: () => reportingErrors(post(`/sessions/${state.session.id}/solve`)) },
      "Calibrate with these photographs")
    : null;
  if (!level) return card("verdict", chip(state.final ? "Not scored" : "Preview"), el("p", {}, unscored()), again);
  const [headline, ...reasons] = state.result.findings ?? [state.result.sentence];
  const list = reasons.length ? el("ul", {}, ...reasons.map((text) => el("li", {}, sentence(text)))) : null;
  return card(`verdict ${level}`, chip(LEVELS[level]), el("p", {}, sentence(headline)), list, again);
}

const unscored = () => state.final
  ? "Too few boards lie where the camera is known; add photographs with the board in other places."
  : "The result is being evaluated.";

function waiting() {
  const found = state.session.usable.length;
  if (!found && state.photographs.size && !state.activity && !state.arriving.size && !live.running()) return noBoard();
  const text = found >= FEWEST
    ? "Calibrating …"
    : `${found} of at least ${FEWEST} photographs show the board; ten or more give a good camera.`;
  return card("verdict", chip("Waiting"), el("p", {}, text), el("p", { class: "help" }, state.session.advice));
}

function noBoard() {
  const { board } = state.session;
  const shown = board ? `the board ${board.spec.replace("x", "×")}` : "a whole checkerboard";
  const one = state.photographs.size === 1;
  return card(
    "verdict poor",
    chip("No board"),
    el("p", {}, `${one ? "The photograph does not show" : `None of the ${state.photographs.size} photographs shows`} ${shown}.`),
    el("p", {}, "If you use another board, select it; otherwise photograph the whole board, sharp and in good light."),
    el("button", { type: "button", class: "primary", onclick: openBoard }, "Select the board"),
  );
}

/** The size of another board, if more photographs show one than show the session's. */
function suggestion() {
  const others = [...state.photographs.values()].map((p) => p.suggestion).filter(Boolean);
  return others.length > state.session.usable.length ? others[0] : null;
}

function otherBoard(spec) {
  const name = spec.replace("x", "×");
  const now = state.session.board.spec.replace("x", "×");
  return card(
    "verdict poor",
    chip("Another board"),
    el("p", {}, `These photographs show a board of ${name} inner corners, not ${now}.`),
    el("button", {
      type: "button", class: "primary",
      onclick: () => reportingErrors(change(`/sessions/${state.session.id}`, { board: spec })),
    }, `Use ${name}`),
  );
}

function focal() {
  const { result } = state;
  if (!result) return null;
  const facts = [
    ["field of view", result.width_degrees === null ? "?" : `${result.width_degrees.toFixed(1)}° horizontally`],
    ["held-out error", result.heldout_px === null ? "–" : `${result.heldout_px.toFixed(2)} px`],
    ["corner noise", `${result.noise_px.toFixed(2)} px per axis`],
    ["coverage", `${Math.round(100 * result.covered)} % of the picture`],
  ];
  return card(
    "focal",
    el("h2", {}, "Focal length"),
    el("p", { class: "f", id: "focal" }, result.f_px.toFixed(1), el("span", { class: "unit" }, " px"),
      el("span", { class: "std" }, ` ± ${twoDigits(result.f_px_std)}`)),
    el("dl", { class: "facts" }, ...facts.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)])),
    el("details", { id: "virtual" }, el("summary", {}, "The virtual camera"), virtualCamera(result)),
  );
}

function virtualCamera(result) {
  const scale = result.square_mm ?? 1;
  const unit = result.square_mm ? "mm" : "squares";
  const rows = Object.entries(result.virtual).map(([name, [value, std]]) => el(
    "tr", {}, el("th", { scope: "row" }, name), el("td", {}, `${(value * scale).toFixed(3)} ± ${twoDigits(std * scale)}`),
  ));
  const reference = state.photographs.get(result.reference)?.name ?? "a photograph that was removed";
  return el(
    "div", {},
    el("p", { class: "help" }, `In ${unit}, in the frame of the board in ${reference}. The number above is the focal length `
      + "at the centre of the picture, in px per radian."),
    el("table", {}, el("tbody", {}, ...rows)),
  );
}

function errors() {
  const scored = photographs().filter((p) => p.included && state.result?.boards[p.id]?.rms_px);
  if (!scored.length) return null;
  const largest = largestError();
  const bars = scored.map((photograph) => {
    const error = state.result.boards[photograph.id].rms_px;
    const bar = el("button", {
      type: "button", class: `column${error > 2 * state.result.rms_px ? " poor" : ""}`,
      "aria-label": `${photograph.name}: ${error.toFixed(2)} px`, title: `${photograph.name}: ${error.toFixed(2)} px`,
      "aria-pressed": String(shownPhotograph()?.id === photograph.id),
      onclick: () => { state.selected = photograph.id; changed(); },
    });
    bar.style.setProperty("--share", String(error / largest));
    return bar;
  });
  return card(
    "errors",
    el("h2", {}, "Error by photograph"),
    el("div", { class: "columns", role: "group", "aria-label": "Errors" }, ...bars),
    el("p", { class: "help" }, `RMS of all: ${state.result.rms_px.toFixed(2)} px; tallest column: ${largest.toFixed(2)} px.`),
  );
}

function downloads() {
  if (!state.result) return null;
  const base = `/sessions/${state.session.id}`;
  const ready = state.final && !outdated();
  const get = (path) => () => reportingErrors(download(path).then((notes) => notes.forEach((text) => notice(text))));
  const formats = el(
    "select", { id: "format", "aria-label": "Format of another program" },
    ...state.about.formats.map(({ name, title }) => el("option", { value: name }, title)),
  );
  return card(
    "take-away",
    el("h2", {}, "Download"),
    el("div", { class: "actions" },
      el("button", { type: "button", class: "primary", id: "download-camera", disabled: !ready, onclick: get(`${base}/camera.npz`) }, "Camera"),
      el("button", { type: "button", id: "download-corners", disabled: !state.session.usable.length, onclick: get(`${base}/corners.vnl`) }, "Corners")),
    el("div", { class: "actions" },
      el("a", {
        id: "open-report", class: "button", target: "_blank", rel: "noopener",
        href: ready ? `/api${base}/report` : null, role: "link", "aria-disabled": String(!ready),
      }, "Open the report"),
      el("button", { type: "button", id: "download-report", disabled: !ready, onclick: get(`${base}/report.html`) }, "Save the report")),
    el("div", { class: "actions" }, formats,
      el("button", {
        type: "button", id: "download-export", disabled: !ready,
        onclick: () => get(`${base}/export/${formats.value}`)(),
      }, "Export")),
    el("p", { class: "help" }, "Exports describe straightened pictures, which are made with ",
      el("code", {}, "pinholify undistort camera.npz"), "."),
  );
}

const card = (name, ...children) => el("section", { class: `card ${name}` }, ...children);
const chip = (text) => el("p", { class: "chip" }, text);

function twoDigits(value) {
  if (value === null) return "?";
  return value.toFixed(Math.max(0, Math.min(6, 1 - Math.floor(Math.log10(Math.max(value, 1e-6))))));
}
