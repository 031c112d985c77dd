// Tables that sort by their heads and scroll inside their box.
import { el, put, fill } from "./dom.js";

/** `columns`: {head, value(row), text(row), words, title, node(row)}; `onpick(row)` makes rows to be chosen. */
export function sheet(label, columns, rows, { chosen = null, tall = false } = {}) {
  const body = el("tbody");
  let sorted = null, up = true;
  const heads = columns.map((column, k) => el("th", { scope: "col", class: column.words ? "words" : null, title: column.title ?? null },
    column.value ? el("button", { type: "button", onclick: () => sort(k) }, column.head) : column.head));
  const draw = () => put(body, rows.map((row) => el("tr", { class: chosen?.(row) ? "chosen" : null },
    columns.map((column) => el("td", { class: [column.words ? "words" : "", column.wrap ? "wrap" : ""].join(" ").trim() || null }, column.node ? column.node(row) : column.text(row))))));
  const sort = (k) => {
    up = sorted === k ? !up : true;
    sorted = k;
    const empty = (value) => value === null || value === undefined || value === "";
    rows = [...rows].sort((one, other) => {
      const [a, b] = [columns[k].value(one), columns[k].value(other)];
      if (empty(a) || empty(b)) return empty(a) - empty(b);
      return (typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b))) * (up ? 1 : -1);
    });
    heads.forEach((head, at) => (at === k ? head.setAttribute("aria-sort", up ? "ascending" : "descending") : head.removeAttribute("aria-sort")));
    draw();
  };
  draw();
  const table = fill(el("table"), el("thead", {}, el("tr", {}, heads)), body);
  return { node: el("div", { class: `scroll${tall ? " tall" : ""}`, tabindex: "0", role: "region", "aria-label": label }, table), draw };
}
