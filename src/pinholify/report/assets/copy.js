// A button beside each block of lines that copies it; where the browser forbids that, selects it.
"use strict";
for (const snippet of document.querySelectorAll(".snippet")) {
  const code = snippet.querySelector("code");
  const title = snippet.querySelector("h3").textContent;
  const button = document.createElement("button");
  const said = (text) => {
    button.textContent = text;
    setTimeout(() => { button.textContent = "Copy"; }, 2000);
  };
  button.type = "button";
  button.textContent = "Copy";
  button.setAttribute("aria-label", `Copy: ${title}`);
  button.addEventListener("click", async () => {
    try {
      await navigator.clipboard.writeText(code.textContent);
      said("Copied");
    } catch {
      getSelection().selectAllChildren(code);
      said("Selected");
    }
  });
  snippet.append(button);
}
