/** Coverage by the photographs: a map of the picture, the four bars, and where to hold the board next. */

import { el, svg } from "./dom.js";
import { dots, polygon } from "./overlay.js";
import { state } from "./state.js";

const BARS = { x: "X", y: "Y", size: "Size", skew: "Skew" };
const WELL = 0.05; // px: well known
const BADLY = 5; // px: poorly known

export function coverage() {
  const { session } = state;
  if (!session.size) return null;
  return el(
    "section", { class: "card coverage" },
    el("h2", {}, "Coverage"),
    map(session),
    state.result ? legend() : null,
    bars(session.bars),
    el("p", { class: "next", id: "next" }, nextBoard()),
  );
}

function map(session) {
  const [width, height] = session.size;
  const points = session.usable.flatMap((id) => state.photographs.get(id)?.uv ?? []);
  const outline = state.result?.next?.outline;
  const frame = el("div", { class: "map" });
  frame.style.setProperty("--ratio", `${width} / ${height}`);
  if (state.result) frame.append(heat(state.result.std_px));
  frame.append(svg(
    "svg", { class: "overlay", viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${points.length} corners in ${session.usable.length} photographs` },
    svg("path", { class: "seen", d: dots(points) }),
    outline ? svg("path", { class: "ghost", d: polygon(outline) }) : null,
  ));
  return frame;
}

/** The standard deviation over the picture, as a small picture that the browser smooths. */
function heat({ columns, rows, values }) {
  const canvas = el("canvas", { width: columns, height: rows, "aria-hidden": "true" });
  const context = canvas.getContext("2d");
  const pixels = context.createImageData(columns, rows);
  values.forEach((std, i) => pixels.data.set(colour(std), 4 * i));
  context.putImageData(pixels, 0, 0);
  return canvas;
}

const STOPS = [[22, 140, 134], [214, 178, 76], [178, 70, 52]];

function colour(std) {
  const share = std === null ? 1 : Math.log(std / WELL) / Math.log(BADLY / WELL);
  const place = Math.min(0.999, Math.max(0, share)) * (STOPS.length - 1);
  const [low, high] = [STOPS[Math.floor(place)], STOPS[Math.floor(place) + 1]];
  return [...low.map((value, i) => value + (high[i] - value) * (place % 1)), 150];
}

const legend = () => el(
  "p", { class: "legend" }, el("span", {}, `uncertainty ${WELL} px`), el("span", { class: "ramp", "aria-hidden": "true" }),
  el("span", {}, `${BADLY} px`),
);

export function bars(values) {
  return el("div", { class: "bars" }, ...Object.entries(BARS).map(([key, name]) => {
    const share = Math.round(100 * values[key]);
    const bar = el("meter", { min: "0", max: "100", value: String(share), "aria-label": `${name}: ${share} %` });
    return el("label", { class: share >= 100 ? "full" : "" }, el("span", {}, name), bar);
  }));
}

/** Where the next board helps most, according to the camera if there is one, or else to the bars. */
export function nextBoard() {
  const next = state.result?.next;
  if (!next) return state.session.advice;
  return `Next: hold the board ${next.place}, as outlined; this reduces the uncertainty by ${Math.round(100 * next.gain)} %.`;
}
