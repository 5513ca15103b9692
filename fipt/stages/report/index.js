"use strict";
// Sorts and filters the table of rooms. The page is complete without it.
const body = document.querySelector("#table tbody");
const heads = [...document.querySelectorAll("#table thead th")];
const search = document.getElementById("search");
const state = document.getElementById("state");
const count = document.getElementById("count");
const rows = [...body.rows];
const texts = rows.map((row) => row.textContent.toLowerCase());

function value(row, column, kind) {
  const text = row.cells[column].dataset.value;
  if (kind === "text") return text;
  return text === "" ? null : Number(text);
}

// Rooms without a value come last in either direction.
function compare(one, other, sign) {
  if (one === null || other === null) return (one === null) - (other === null);
  return sign * (typeof one === "string" ? one.localeCompare(other, undefined, { numeric: true }) : one - other);
}

function sort(head) {
  const column = heads.indexOf(head);
  const button = head.querySelector("button");
  const sign = head.ariaSort ? (head.ariaSort === "ascending" ? -1 : 1) : Number(button.dataset.first ?? 1);
  for (const each of heads) each.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
  const keyed = rows.map((row) => [value(row, column, button.dataset.kind), row]);
  keyed.sort((one, other) => compare(one[0], other[0], sign));
  body.append(...keyed.map(([, row]) => row));
}

function filter() {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  rows.forEach((row, place) => {
    const fits = (!state.value || row.classList.contains(state.value)) && words.every((word) => texts[place].includes(word));
    row.hidden = !fits;
    shown += fits;
  });
  count.textContent = `${shown} of ${rows.length} rooms`;
}

for (const head of heads) head.querySelector("button")?.addEventListener("click", () => sort(head));
search.addEventListener("input", filter);
state.addEventListener("change", filter);
