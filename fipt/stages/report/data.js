"use strict";
// Numbers that the page carries as text: packed by fipt.stages.report.images.packed.

// Content of a data element as an ArrayBuffer.
async function unpacked(id) {
  const text = atob(document.getElementById(id).textContent.trim());
  const packed = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

// Content of a JSON element; null where the page has none.
function facts(id) {
  const element = document.getElementById(id);
  return element && JSON.parse(element.textContent);
}

// Half floats whose low bytes come before all high bytes, as 32-bit floats.
function halfFloats(buffer) {
  const bytes = new Uint8Array(buffer);
  const count = bytes.length / 2;
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const exponent = (bits >> 10) & 31;
    const mantissa = bits & 1023;
    const size = exponent ? (1 + mantissa / 1024) * 2 ** (exponent - 15) : mantissa * 2 ** -24;
    table[bits] = bits & 32768 ? -size : size;
  }
  return Float32Array.from({ length: count }, (_, i) => table[bytes[i] | (bytes[count + i] << 8)]);
}

const linearOf = (encoded) => (encoded <= 0.04045 ? encoded / 12.92 : ((encoded + 0.055) / 1.055) ** 2.4);
const encodedOf = (linear) => (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
// "#rrggbb" as linear red, green and blue.
const linearColor = (text) => [1, 3, 5].map((at) => linearOf(parseInt(text.slice(at, at + 2), 16) / 255));
