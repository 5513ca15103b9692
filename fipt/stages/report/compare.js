"use strict";
// Before and after: each held-out view's photograph over one of its layers, with a line between them that can be moved.
for (const view of document.querySelectorAll(".compared")) {
  const stage = view.querySelector(".stage");
  const [under, over] = stage.querySelectorAll("img");
  const [left, right] = stage.querySelectorAll(".side");
  const slider = stage.querySelector("input");
  const truth = view.querySelector("[name=truth]");
  const layers = [...view.querySelectorAll("[data-layer]")];
  const photo = view.querySelector("[data-layer=photo] img");
  const known = (key) => view.querySelector(`[data-truth="${CSS.escape(key)}"] img`);

  function put(image, source, name) {
    image.src = source.src;
    image.alt = source.alt;
    name.textContent = source.dataset.label;
  }

  function show(button) {
    for (const layer of layers) layer.setAttribute("aria-pressed", String(layer === button));
    const key = button.dataset.layer;
    if (truth) truth.disabled = !known(key);
    const before = truth && truth.checked && known(key);
    put(under, button.querySelector("img"), right);
    put(over, before || photo, left);
    slider.setAttribute("aria-label", `${left.textContent} on the left, ${right.textContent} on the right`);
  }

  const pressed = () => layers.find((layer) => layer.getAttribute("aria-pressed") === "true");
  for (const layer of layers) layer.addEventListener("click", () => show(layer));
  if (truth) truth.addEventListener("change", () => show(pressed()));
  slider.addEventListener("input", () => stage.style.setProperty("--at", `${slider.value}%`));
  show(pressed());
  view.classList.add("ready");
}
