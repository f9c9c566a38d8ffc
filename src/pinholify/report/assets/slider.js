// Lays a straightened picture over its photograph; a slider, a finger or the mouse moves the border between them.
"use strict";
for (const compare of document.querySelectorAll(".compare")) {
  const slider = compare.querySelector("input");
  const halves = compare.querySelector(".halves");
  const show = () => compare.style.setProperty("--at", `${slider.value}%`);
  const follow = (event) => {
    const box = halves.getBoundingClientRect();
    slider.value = (100 * (event.clientX - box.left)) / box.width;
    show();
  };
  slider.addEventListener("input", show);
  halves.addEventListener("pointerdown", (event) => {
    halves.setPointerCapture(event.pointerId);
    follow(event);
  });
  halves.addEventListener("pointermove", (event) => {
    if (halves.hasPointerCapture(event.pointerId)) follow(event);
  });
  halves.addEventListener("dragstart", (event) => event.preventDefault());
  slider.hidden = false;
  compare.classList.add("live");
  show();
}
