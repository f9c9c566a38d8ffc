/** Notices that stay on the page until they are closed. */

import { byId, el, sentence } from "./dom.js";

const MOST = 4;

export function notice(text, action = null) {
  const list = byId("notices");
  const whole = sentence(text);
  if ([...list.children].some((child) => child.dataset.text === whole)) return;
  const close = el("button", { type: "button", class: "quiet", "aria-label": "Close", onclick: () => item.remove() }, "×");
  const act = action && el("button", { type: "button", onclick: () => { item.remove(); action.run(); } }, action.label);
  const item = el("div", { class: "notice", "data-text": whole }, el("p", {}, whole), act, close);
  list.append(item);
  while (list.children.length > MOST) list.firstElementChild.remove();
}

export function clearNotices() {
  byId("notices").replaceChildren();
}

/** The value of `promise`; if it is rejected, shows the reason and returns undefined. */
export async function reportingErrors(promise) {
  try {
    return await promise;
  } catch (error) {
    notice(error.message);
    return undefined;
  }
}
