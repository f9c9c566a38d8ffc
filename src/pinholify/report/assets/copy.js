// Adds a button to each block of code that copies it, or selects it where the browser forbids copying.
"use strict";
for (const snippet of document.querySelectorAll(".snippet")) {
  const code = snippet.querySelector("code");
  const title = snippet.querySelector("h3").textContent;
  const button = document.createElement("button");
  const label = (text) => {
    button.textContent = text;
    setTimeout(() => { button.textContent = "Copy"; }, 2000);
  };
  button.type = "button";
  button.textContent = "Copy";
  button.setAttribute("aria-label", `Copy: ${title}`);
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(code.textContent);
      label("Copied");
    } catch {
      getSelection().selectAllChildren(code);
      label("Selected");
    }
  });
  snippet.append(button);
}
