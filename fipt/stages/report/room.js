"use strict";
// The room in 3D: reads a binary glTF file and draws it with WebGL. Vectors are arrays of three numbers.
const room = facts("room-facts");

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const plus = (a, b, times = 1) => a.map((value, i) => value + times * b[i]);
const unit = (a) => a.map((value) => value / Math.hypot(...a));

// --- glTF ---------------------------------------------------------------------------------------

const NUMBERS = { 5120: Int8Array, 5121: Uint8Array, 5122: Int16Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const WIDTHS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

// Column-major 4x4 matrix of a node.
function nodeMatrix({ matrix, translation: t = [0, 0, 0], rotation: [x, y, z, w] = [0, 0, 0, 1], scale: s = [1, 1, 1] }) {
  if (matrix) return matrix;
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w), 0].map((v) => v * s[0]),
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w), 0].map((v) => v * s[1]),
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y), 0].map((v) => v * s[2]),
    [...t, 1],
  ].flat();
}

// a b for column-major 4x4 matrices.
function product(a, b) {
  return Array.from({ length: 16 }, (_, i) => [0, 1, 2, 3].reduce((sum, k) => sum + a[4 * k + (i % 4)] * b[4 * (i >> 2) + k], 0));
}

// Triangles of a .glb file: positions in world space, and what they are drawn with.
function readModel(buffer) {
  const head = new DataView(buffer);
  const length = head.getUint32(12, true);
  const file = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
  const start = 20 + length + 8;

  function bytes(number) {
    const { byteOffset = 0, byteLength } = file.bufferViews[number];
    return buffer.slice(start + byteOffset, start + byteOffset + byteLength);
  }
  function numbers(number) {
    const { bufferView, byteOffset = 0, componentType, count, type, normalized = false } = file.accessors[number];
    const array = new NUMBERS[componentType](bytes(bufferView), byteOffset, count * WIDTHS[type]);
    return { array, width: WIDTHS[type], kind: componentType, normalized };
  }
  function image(texture) {
    const { bufferView, mimeType } = file.images[file.textures[texture.index].source];
    return new Blob([bytes(bufferView)], { type: mimeType });
  }

  const parts = [];
  function visit(node, above) {
    const place = product(above, nodeMatrix(node));
    for (const primitive of node.mesh === undefined ? [] : file.meshes[node.mesh].primitives) {
      const { POSITION, TEXCOORD_0, COLOR_0 } = primitive.attributes;
      const position = numbers(POSITION);
      const local = position.array;
      position.array = new Float32Array(local.length);
      for (let i = 0; i < local.length; i += 3)
        for (let row = 0; row < 3; row++)
          position.array[i + row] =
            place[row] * local[i] + place[4 + row] * local[i + 1] + place[8 + row] * local[i + 2] + place[12 + row];
      const material = primitive.material === undefined ? {} : file.materials[primitive.material];
      const { baseColorFactor = [1, 1, 1, 1], baseColorTexture } = material.pbrMetallicRoughness || {};
      const glow = material.emissiveFactor || [0, 0, 0];
      parts.push({
        position,
        uv: baseColorTexture && TEXCOORD_0 !== undefined ? numbers(TEXCOORD_0) : null,
        color: COLOR_0 === undefined ? null : numbers(COLOR_0),
        index: primitive.indices === undefined ? null : numbers(primitive.indices),
        image: baseColorTexture && TEXCOORD_0 !== undefined ? image(baseColorTexture) : null,
        base: baseColorFactor.slice(0, 3),
        glow: glow.map((value) => value / Math.max(...glow, 1e-9)), // strengths differ too much to be shown
      });
    }
    for (const child of node.children || []) visit(file.nodes[child], place);
  }
  for (const node of file.scenes[file.scene || 0].nodes) visit(file.nodes[node], nodeMatrix({}));
  return parts;
}

// --- drawing ------------------------------------------------------------------------------------

const VERTEX = `#version 300 es
uniform mat4 clip_from_world;
in vec3 position; in vec2 uv; in vec3 color;
out vec3 p; out vec2 at; out vec3 shade;
void main() { p = position; at = uv; shade = color; gl_Position = clip_from_world * vec4(position, 1.0); }`;

const FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 eye, up, side, base, glow;
uniform float cut;
uniform sampler2D image;
in vec3 p; in vec2 at; in vec3 shade;
out vec4 pixel;
void main() {
  if (dot(p, up) > cut) discard;
  vec3 n = normalize(cross(dFdx(p), dFdy(p))), to_eye = normalize(eye - p);
  n = dot(n, to_eye) < 0.0 ? -n : n;
  float light = 0.45 + 0.3 * dot(n, to_eye) + 0.15 * dot(n, up) + 0.1 * dot(n, side);
  vec3 linear = glow + base * shade * texture(image, at).rgb * light * 1.25;
  linear = clamp(linear, 0.0, 1.0);
  pixel = vec4(mix(12.92 * linear, 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, linear)), 1.0);
}`;

function program(gl) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
  return made;
}

// Puts a part on the graphics card; returns a function that draws it.
async function upload(gl, shaders, part) {
  const vertices = gl.createVertexArray();
  gl.bindVertexArray(vertices);
  for (const [name, data] of Object.entries({ position: part.position, uv: part.uv, color: part.color })) {
    const place = gl.getAttribLocation(shaders, name);
    if (!data) {
      gl.vertexAttrib3f(place, 1, 1, 1);
      continue;
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data.array, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, data.width, data.kind, data.normalized, 0, 0);
  }
  if (part.index) {
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, part.index.array, gl.STATIC_DRAW);
  }
  gl.bindVertexArray(null);
  const white = new ImageData(new Uint8ClampedArray([255, 255, 255, 255]), 1, 1);
  const pixels = part.image ? await createImageBitmap(part.image, { colorSpaceConversion: "none" }) : white;
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  gl.generateMipmap(gl.TEXTURE_2D);
  return () => {
    gl.bindVertexArray(vertices);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.uniform3fv(gl.getUniformLocation(shaders, "base"), part.base);
    gl.uniform3fv(gl.getUniformLocation(shaders, "glow"), part.glow);
    if (part.index) gl.drawElements(gl.TRIANGLES, part.index.array.length, part.index.kind, 0);
    else gl.drawArrays(gl.TRIANGLES, 0, part.position.array.length / 3);
  };
}

// --- the view -----------------------------------------------------------------------------------

async function openRoom(section) {
  const canvas = section.querySelector("canvas");
  const gl = canvas.getContext("webgl2", { antialias: true });
  if (!gl) throw new Error("this browser has no WebGL 2");
  const shaders = program(gl);
  const model = readModel(await unpacked("room-model"));
  const parts = [];
  for (const part of model) parts.push(await upload(gl, shaders, part));

  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (const { position } of model)
    position.array.forEach((value, i) => {
      low[i % 3] = Math.min(low[i % 3], value);
      high[i % 3] = Math.max(high[i % 3], value);
    });
  const size = Math.hypot(...plus(high, low, -1));
  const up = room.up;
  const ahead = up[1] ? [0, 0, -1] : [0, 1, 0];
  const side = cross(ahead, up);
  let eye, yaw, pitch, fov, cut;
  const forward = () =>
    plus(up.map((value) => Math.sin(pitch) * value), plus(ahead.map((v) => Math.cos(yaw) * v), side, Math.sin(yaw)), Math.cos(pitch));

  function turnTo(direction) {
    pitch = Math.asin(Math.min(Math.max(dot(direction, up), -1), 1));
    yaw = Math.atan2(dot(direction, side), dot(direction, ahead));
  }

  function stand(number) {
    const place = room.viewpoints[number];
    if (place) {
      [eye, fov, cut] = [[...place.eye], place.fov, 1e9];
      turnTo(place.forward);
    } else {
      const [floor, ceiling] = [dot(low, up), dot(high, up)].sort((a, b) => a - b);
      [fov, cut] = [40, floor + 0.8 * (ceiling - floor)];
      const corners = Array.from({ length: 8 }, (_, i) => low.map((value, axis) => ((i >> axis) & 1 ? high[axis] : value)));
      for (const corner of corners) corner.splice(0, 3, ...plus(corner, up, Math.min(cut - dot(corner, up), 0)));
      const center = corners.reduce((sum, corner) => plus(sum, corner, 1 / 8), [0, 0, 0]);
      const away = unit(plus(plus(up.map((value) => 1.5 * value), ahead, -0.8), side, 0.3));
      turnTo(away.map((value) => -value));
      // Back off until the whole room is in the picture.
      const outside = ({ x, y, w }) => w <= 0 || Math.max(Math.abs(x), Math.abs(y)) > 0.97 * w;
      let distance = 0.3 * size;
      do {
        distance *= 1.05;
        eye = plus(center, away, distance);
      } while (distance < 20 * size && corners.some((corner) => outside(clipped(clipFromWorld(), corner))));
    }
    soon();
  }

  function clipFromWorld() {
    const f = forward();
    const right = unit(cross(f, up));
    const top = cross(right, f);
    const scale = 1 / Math.tan((fov * Math.PI) / 360);
    const aspect = canvas.clientWidth / canvas.clientHeight;
    const [near, far] = [0.03, 4 * size];
    const depth = -(far + near) / (far - near);
    const rows = [right, top, f.map((value) => -value)].map((axis) => [...axis, -dot(axis, eye)]);
    const view = [0, 1, 2, 3].flatMap((column) => [rows[0][column], rows[1][column], rows[2][column], column === 3 ? 1 : 0]);
    const lens = [scale / aspect, 0, 0, 0, 0, scale, 0, 0, 0, 0, depth, -1, 0, 0, (-2 * far * near) / (far - near), 0];
    return product(lens, view);
  }

  // Where a point is in the picture: x / w and y / w from -1 to 1, in front where w is positive.
  function clipped(matrix, point) {
    const [x, y, , w] = [0, 1, 2, 3].map((row) => [...point, 1].reduce((sum, v, k) => sum + matrix[4 * k + row] * v, 0));
    return { x, y, w };
  }

  function mark(matrix) {
    section.querySelectorAll(".mark-lamp").forEach((label, number) => {
      const { x, y, w } = clipped(matrix, room.emitters[number].center);
      label.hidden = w <= 0 || Math.abs(x) > w || Math.abs(y) > w;
      label.style.left = `${50 + (50 * x) / w}%`;
      label.style.top = `${50 - (50 * y) / w}%`;
    });
  }

  let waiting = false;
  function soon() {
    if (!waiting) requestAnimationFrame(drawRoom);
    waiting = true;
  }

  function drawRoom() {
    waiting = false;
    const sharp = Math.min(window.devicePixelRatio || 1, 2);
    [canvas.width, canvas.height] = [Math.max(1, canvas.clientWidth * sharp), Math.max(1, canvas.clientHeight * sharp)];
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0.09, 0.085, 0.08, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(shaders);
    const matrix = clipFromWorld();
    gl.uniformMatrix4fv(gl.getUniformLocation(shaders, "clip_from_world"), false, matrix);
    for (const [name, value] of Object.entries({ eye, up, side })) gl.uniform3fv(gl.getUniformLocation(shaders, name), value);
    gl.uniform1f(gl.getUniformLocation(shaders, "cut"), cut);
    for (const part of parts) part();
    mark(matrix);
    section.dataset.ready = "yes";
  }

  function look(dx, dy) {
    yaw += dx;
    pitch = Math.min(Math.max(pitch + dy, -1.55), 1.55);
    soon();
  }

  // Metres to the right, ahead and up; ahead is where the eye looks.
  function walk(x, z, y = 0) {
    const f = forward();
    eye = plus(plus(plus(eye, unit(cross(f, up)), x), f, z), up, y);
    soon();
  }

  const step = 0.02 * size;
  const keys = {
    ArrowLeft: () => look(-0.08, 0),
    ArrowRight: () => look(0.08, 0),
    ArrowUp: () => look(0, 0.06),
    ArrowDown: () => look(0, -0.06),
    w: () => walk(0, step),
    s: () => walk(0, -step),
    a: () => walk(-step, 0),
    d: () => walk(step, 0),
    q: () => walk(0, 0, -step),
    e: () => walk(0, 0, step),
  };
  canvas.addEventListener("keydown", (event) => {
    const act = !event.ctrlKey && !event.metaKey && !event.altKey && keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });

  const fingers = new Map();
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const apart = fingers.size === 2 ? spread() : 0;
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    const angle = (fov * Math.PI) / 180 / canvas.clientHeight;
    if (fingers.size === 2) walk(0, (spread() - apart) * 0.003 * size);
    else look((before[0] - event.clientX) * angle, (event.clientY - before[1]) * angle);
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener(
    "wheel",
    (event) => {
      if (document.activeElement !== canvas) return; // else the page could not be scrolled past the room
      event.preventDefault();
      walk(0, -Math.sign(event.deltaY) * step);
    },
    { passive: false },
  );
  section.addEventListener("click", (event) => {
    const button = event.target.closest("[data-walk]");
    if (button) walk(...button.dataset.walk.split(",").map((value) => 2 * step * Number(value)));
  });
  const from = section.querySelector("select");
  from.addEventListener("change", () => stand(Number(from.value)));
  new ResizeObserver(soon).observe(canvas);
  stand(Number(from.value));
}

if (room) {
  const section = document.getElementById("room");
  new IntersectionObserver(
    (seen, observer) => {
      if (!seen.some((entry) => entry.isIntersecting)) return;
      observer.disconnect();
      openRoom(section).catch((error) => {
        const excuse = section.querySelector(".excuse");
        excuse.textContent = `The room cannot be shown: ${error.message}.`;
        excuse.hidden = false;
      });
    },
    { rootMargin: "300px" },
  ).observe(section);
}
