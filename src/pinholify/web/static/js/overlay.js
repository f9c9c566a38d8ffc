/** Corners over a picture, as SVG in the picture's own pixels. */

import { svg } from "./dom.js";

const FINE = 2; // multiple of the typical error above which a corner is drawn as poor

/** Lines through the rows and columns of a photograph's corners. */
export function latticePath(photograph, columns) {
  const places = new Map(photograph.ids.map((id, i) => [id, photograph.uv[i]]));
  let path = "";
  for (const [id, [u, v]] of places) {
    const right = (id + 1) % columns ? places.get(id + 1) : undefined;
    for (const next of [right, places.get(id + columns)]) {
      if (next) path += `M${u} ${v}L${next[0]} ${next[1]}`;
    }
  }
  return path;
}

/** Points as strokes of zero length, so that their size does not change with the picture's. */
export const dots = (points) => points.map(([u, v]) => `M${u} ${v}h0`).join("");

export const polygon = (points) => `M${points.map(([u, v]) => `${u} ${v}`).join("L")}Z`;

/** The overlay of a photograph: its lattice and its corners, coloured by the residuals in `board` if given. */
export function overlay(photograph, columns, board = null, typical = 0) {
  const [width, height] = photograph.size;
  const poor = photograph.uv.filter((_, i) => isPoor(board?.residuals?.[i], typical));
  return svg(
    "svg",
    { class: "overlay", viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", "aria-hidden": "true" },
    svg("path", { class: "lattice", d: latticePath(photograph, columns) }),
    svg("path", { class: "corner", d: dots(photograph.uv) }),
    svg("path", { class: "corner poor", d: dots(poor) }),
  );
}

function isPoor(residual, typical) {
  return Boolean(residual) && residual[0] !== null && Math.hypot(...residual) > FINE * typical;
}
