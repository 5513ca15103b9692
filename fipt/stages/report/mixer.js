"use strict";
// The light mixer: a picture is the sum of its layers, each with the light of one lamp, times a gain per channel.
const mixer = facts("mixer-facts");

const curves = {
  clip: (x) => x,
  soft: (x) => (x * (1 + x / 16)) / (1 + x), // Reinhard's, white at 4
  film: (x) => (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), // Narkowicz's fit of the ACES curve
};
const STEPS = 16383;
const display = Uint8ClampedArray.from({ length: STEPS + 1 }, (_, i) => 255 * encodedOf(i / STEPS)); // rounds

// Adds layers times gains, three planes a layer, and writes the picture as it is displayed.
function draw(canvas, view, gains, exposure, curve) {
  const size = view.width * view.height;
  const image = new ImageData(view.width, view.height);
  const sum = new Float32Array(size);
  for (let channel = 0; channel < 3; channel++) {
    sum.fill(0);
    gains.forEach((gain, layer) => {
      if (!gain[channel]) return;
      const plane = view.planes.subarray((3 * layer + channel) * size, (3 * layer + channel + 1) * size);
      for (let i = 0; i < size; i++) sum[i] += gain[channel] * plane[i];
    });
    for (let i = 0; i < size; i++) {
      const shown = Math.min(Math.max(curve(exposure * sum[i]), 0), 1);
      image.data[4 * i + channel] = display[Math.round(STEPS * shown)];
    }
  }
  for (let i = 3; i < image.data.length; i += 4) image.data[i] = 255;
  canvas.width = view.width;
  canvas.height = view.height;
  canvas.getContext("2d").putImageData(image, 0, 0);
}

if (mixer) {
  const section = document.getElementById("mixer");
  const canvas = section.querySelector(".mix canvas");
  const rows = [...section.querySelectorAll(".lamp")];
  const [chosen, exposure, curve] = ["view", "exposure", "curve"].map((name) => section.querySelector(`[name=${name}]`));
  const luminance = (rgb) => rgb.reduce((sum, value, i) => sum + value * mixer.luminance[i], 0);
  let view = null;
  let waiting = false;

  // A lamp's controls: whether it is on, its strength, and its colour where that was changed (linear).
  function state(row) {
    const [on, strength, color] = ["on", "strength", "color"].map((name) => row.querySelector(`[name=${name}]`));
    const changed = color && color.value !== color.defaultValue;
    return { on: on.checked, strength: strength.value ** 2, color: changed ? linearColor(color.value) : null };
  }

  // Factors on a layer's channels. Another colour keeps the luminance, as the colour of a light setup does.
  function gain(part, { on, strength, color }) {
    if (!on) return [0, 0, 0];
    if (!color) return [strength, strength, strength];
    const scale = (strength * luminance(part.radiance)) / Math.max(luminance(color), 1e-9);
    return color.map((value, i) => (scale * value) / part.radiance[i]);
  }

  // The mix as a light setup of the configuration.
  function setup(states) {
    const text = (value) => String(+value.toPrecision(4));
    const edits = [];
    let outside = "";
    states.forEach(({ on, strength, color }, index) => {
      const part = mixer.parts[index];
      const scale = on ? text(strength) : "0";
      if (scale === "1" && !color) return;
      if (part.key === "outside") outside = `\n    environment: {scale: ${scale}}`;
      const paint = on && color ? `, color: [${color.map(text).join(", ")}]` : "";
      const names = part.emitters.map((name) => JSON.stringify(name)); // YAML reads JSON's strings
      const chosen = names.length > 1 ? `names: [${names.join(", ")}]` : `name: ${names[0]}`;
      if (names.length) edits.push(`\n      - {${chosen}, scale: ${scale}${paint}}`);
    });
    if (!edits.length && !outside) return "setups:\n  mix: {}  # as captured";
    return `setups:\n  mix:${edits.length ? "\n    emitters:" : ""}${edits.join("")}${outside}`;
  }

  function mix() {
    waiting = false;
    if (!view) return;
    const states = rows.map(state);
    states.forEach(({ on, strength }, index) => {
      rows[index].classList.toggle("off", !on || !strength);
      rows[index].querySelector("output").textContent = on ? `× ${strength.toFixed(2)}` : "off";
      rows[index].querySelector("[name=strength]").setAttribute("aria-valuetext", `${strength.toFixed(2)} times`);
    });
    const stops = Number(exposure.value);
    section.querySelector(".stops").textContent = `${stops > 0 ? "+" : ""}${stops.toFixed(1)} EV`;
    exposure.setAttribute("aria-valuetext", `${stops.toFixed(1)} stops`);
    section.querySelector(".setup").textContent = setup(states);
    draw(canvas, view, states.map((lamp, index) => gain(mixer.parts[index], lamp)), 2 ** stops, curves[curve.value]);
  }

  function soon() {
    if (!waiting) requestAnimationFrame(mix);
    waiting = true;
  }

  // Small pictures of the view under each lamp alone, bright enough to be seen.
  function thumbnails() {
    const size = view.width * view.height;
    rows.forEach((row, layer) => {
      const green = view.planes.slice((3 * layer + 1) * size, (3 * layer + 2) * size).sort();
      const bright = Math.max(green[Math.floor(0.9 * size)], 1e-4);
      const only = mixer.parts.map((_, other) => (other === layer ? [1, 1, 1] : [0, 0, 0]));
      draw(row.querySelector("canvas"), view, only, 0.6 / bright, curves.clip);
    });
  }

  async function show(index) {
    const next = mixer.views[index];
    if (!next.planes) next.planes = halfFloats(await unpacked(`mixer-${index}`));
    if (Number(chosen.value) !== index) return; // another was chosen meanwhile
    view = next;
    canvas.setAttribute("aria-label", `View ${view.name} under the mixed light`);
    thumbnails();
    mix();
    section.dataset.ready = view.name;
  }

  section.querySelector("form").addEventListener("input", (event) => {
    if (event.target === chosen) show(Number(chosen.value));
    else soon();
  });
  section.querySelector("form").addEventListener("reset", () => setTimeout(() => show(Number(chosen.value))));
  section.addEventListener("click", (event) => {
    const button = event.target.closest("[data-only]");
    if (button) {
      const own = button.closest(".lamp");
      const alone = rows.every((row) => row.querySelector("[name=on]").checked === (row === own));
      for (const row of rows) row.querySelector("[name=on]").checked = alone || row === own;
      soon();
    }
  });
  show(0);
}
