// Tables that sort by their heads and scroll inside their box.
import { el, put, fill, button } from "./dom.js";

/** `columns`: {head, value(row), text(row), words, title, node(row), extra}; those that are `extra` are shown on request. */
export function sheet(label, columns, rows, { chosen = null, tall = false } = {}) {
  const body = el("tbody");
  let sorted = null, up = true;
  const looks = (column, ...more) => [column.words && "words", column.extra && "extra", ...more].filter(Boolean).join(" ") || null;
  const heads = columns.map((column, k) => el("th", { scope: "col", class: looks(column), title: column.title ?? null },
    column.value ? el("button", { type: "button", onclick: () => sort(k) }, column.head) : column.head));
  const draw = () => put(body, rows.map((row) => el("tr", { class: chosen?.(row) ? "chosen" : null },
    columns.map((column) => el("td", { class: looks(column, column.wrap && "wrap") }, column.node ? column.node(row) : column.text(row))))));
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
  const box = el("div", { class: `scroll${tall ? " tall" : ""}`, tabindex: "0", role: "region", "aria-label": label }, table);
  return { node: columns.some((column) => column.extra) ? el("div", { class: "stack" }, box, el("div", {}, allColumns(box))) : box, draw };
}

// A button that shows the columns that are not seen at first.
function allColumns(box) {
  const toggle = button("All columns", () => toggle.setAttribute("aria-pressed", String(box.classList.toggle("all"))), "small", { "aria-pressed": "false" });
  return toggle;
}
