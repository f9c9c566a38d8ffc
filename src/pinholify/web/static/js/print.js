/** The dialogs: printing a board, and changing the session's board. */

import { change, download } from "./api.js";
import { byId, el, sentence } from "./dom.js";
import { state } from "./state.js";

export function preparePrint() {
  const dialog = byId("print");
  byId("print-page").replaceChildren(...state.about.pages.map((page) => el("option", { selected: page === "A4" }, page)));
  const open = () => {
    if (state.session?.board) byId("print-board").value = state.session.board.spec;
    byId("print-problem").textContent = "";
    dialog.showModal();
  };
  byId("open-print").addEventListener("click", open);
  byId("print-first").addEventListener("click", open);
  byId("print-close").addEventListener("click", () => dialog.close());
  byId("print-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const values = {
      board: byId("print-board").value.trim(), square_mm: byId("print-square").value,
      page: byId("print-page").value, ending: byId("print-ending").value,
    };
    attempt("print-problem", async () => {
      await download(`/board?${new URLSearchParams(values)}`);
      dialog.close();
    });
  });
}

export function prepareBoard() {
  const dialog = byId("board-dialog");
  byId("board-close").addEventListener("click", () => dialog.close());
  byId("board-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const data = {
      board: byId("new-board").value.trim() || null,
      square_mm: Number(byId("new-square").value) || null,
      mirrored: byId("new-mirrored").checked,
    };
    attempt("board-problem", async () => {
      await change(`/sessions/${state.session.id}`, data);
      dialog.close();
    });
  });
}

export function openBoard() {
  byId("new-board").value = state.session.board?.spec ?? "";
  byId("new-square").value = state.session.square_mm ?? "";
  byId("new-mirrored").checked = state.session.mirrored;
  byId("board-problem").textContent = "";
  byId("board-dialog").showModal();
}

async function attempt(place, action) {
  byId(place).textContent = "";
  try {
    await action();
  } catch (error) {
    byId(place).textContent = sentence(error.message);
  }
}
