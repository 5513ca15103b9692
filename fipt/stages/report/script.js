"use strict";
// Enlarges pictures; arrow keys step through those of the same row. The page is complete without it.
const dialog = document.getElementById("large");
const image = dialog.querySelector("img");
const caption = dialog.querySelector("figcaption");
let row = [];
let place = 0;

function show(index) {
  place = (index + row.length) % row.length;
  const shown = row[place].querySelector("img");
  image.src = shown.src;
  image.alt = shown.alt;
  // Small pictures are scaled up to the window, which their own size would prevent.
  image.style.aspectRatio = `${shown.width} / ${shown.height}`;
  caption.textContent = `${shown.alt} (${place + 1} of ${row.length})`;
}

document.addEventListener("click", (event) => {
  const button = event.target.closest("button[data-group]");
  if (!button) return;
  row = [...document.querySelectorAll("button[data-group]")].filter(
    (other) => other.dataset.group === button.dataset.group && other.checkVisibility(),
  );
  show(row.indexOf(button));
  dialog.showModal();
});

dialog.addEventListener("click", (event) => {
  const step = event.target.closest("[data-step]");
  if (step) show(place + Number(step.dataset.step));
  else if (event.target !== image && event.target !== caption) dialog.close();
});

dialog.addEventListener("keydown", (event) => {
  if (event.key === "ArrowRight") show(place + 1);
  if (event.key === "ArrowLeft") show(place - 1);
});
