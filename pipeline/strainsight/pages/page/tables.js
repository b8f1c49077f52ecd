// Interactive tables: sort by a column, copy, save as CSV. Without scripts they are plain tables.

const natural = new Intl.Collator("en", { numeric: true });
const number = /^[-+]?(\d+\.?\d*(e[-+]?\d+)?|inf)$/i;

/** The cells of some rows as a matrix; a spanning cell is repeated. */
function grid(rows) {
  const cells = rows.map(() => []);
  rows.forEach((row, i) => {
    let j = 0;
    for (const cell of row.cells) {
      while (cells[i][j]) j += 1;
      for (let down = i; down < Math.min(i + cell.rowSpan, rows.length); down += 1)
        for (let right = j; right < j + cell.colSpan; right += 1) cells[down][right] = cell;
    }
  });
  return cells;
}

/** Sort key of a cell: its first number, else its text; undefined for "–", empty cells and NaN. */
function sortKey(cell) {
  if (!cell || cell.colSpan > 1) return undefined;
  const text = cell.textContent.trim();
  const first = cell.querySelector("data");
  if (first && text.startsWith(first.textContent.trim())) {
    const value = Number(first.value.replace("inf", "Infinity"));
    return Number.isNaN(value) ? undefined : value;
  }
  return text === "–" || text === "" ? undefined : text;
}

/** Order of two keys: numbers, then text in natural order (G2 before G10); undefined keys are always last. */
function compare(a, b, sense) {
  if (a === undefined || b === undefined) return (a === undefined) - (b === undefined);
  if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
  if (typeof a === "string") return sense * natural.compare(a, b);
  return sense * ((a > b) - (a < b));
}

/** Units that are sorted: rows, or blocks if cells span rows. */
function units(table) {
  const blocks = [...table.tBodies];
  const whole = blocks.length > 1 || blocks.some((block) => block.querySelector("[rowspan]"));
  const moved = whole ? blocks : [...blocks[0].rows];
  return moved.map((node) => ({ node, cells: grid(whole ? [...node.rows] : [node]) }));
}

/** Sort the units by a column; a block by its smallest entry, descending by its largest. */
function sort(table, all, column, sense) {
  const keyed = all.map(({ node, cells }) => {
    const keys = cells.map((row) => sortKey(row[column])).sort((a, b) => compare(a, b, sense));
    return { node, key: keys[0] };
  });
  if (sense) keyed.sort((a, b) => compare(a.key, b.key, sense));
  for (const { node } of keyed)
    if (node.tagName === "TBODY") table.insertBefore(node, table.tFoot);
    else table.tBodies[0].append(node);
}

/** Add a button to every heading; clicks sort ascending, descending, and in the original order. */
function sortable(table) {
  const all = units(table);
  if (all.length < 2) return;
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    if (!head.textContent.trim()) return;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.append(...head.childNodes);
    head.append(button);
    head.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => {
      const next = { none: "ascending", ascending: "descending", descending: "none" }[head.getAttribute("aria-sort")];
      for (const other of table.tHead.querySelectorAll("[aria-sort]")) other.setAttribute("aria-sort", "none");
      head.setAttribute("aria-sort", next);
      sort(table, all, column, { none: 0, ascending: 1, descending: -1 }[next]);
    });
  });
}

/** Text that spreadsheets do not interpret as a formula. */
function safe(text) {
  const numbers = text.split(/;? /).every((part) => number.test(part));
  return /^[=+\-@＝＋－＠]/.test(text) && !numbers ? `'${text}` : text;
}

/** Text of a cell with exact numbers; line breaks as "; ", "–" as empty, without links to other pages. */
function words(cell) {
  const copy = cell.cloneNode(true);
  for (const aside of copy.querySelectorAll(".aside")) aside.remove();
  for (const exact of copy.querySelectorAll("data")) exact.textContent = exact.value === "nan" ? "" : exact.value;
  for (const line of copy.querySelectorAll("br")) line.replaceWith("; ");
  const text = copy.textContent.replace(/\s+/g, " ").trim().replace(/^; /, "");
  return text === "–" ? "" : text;
}

/** Units of the exact numbers in a cell. */
const unitsOf = (cell) => [...(cell?.querySelectorAll("data[data-unit]") ?? [])].map((exact) => exact.dataset.unit);

/** The table as rows of text in the current order, foot last. The unit of a column is added to its heading, or as another
 * column if the rows have different units. */
function contents(table) {
  const cells = grid([...table.rows]);
  const columnUnits = cells[0].map((_, j) => [...new Set(cells.flatMap((row) => unitsOf(row[j])))]);
  const line = (row, i) =>
    columnUnits.flatMap((names, j) => {
      const text = row[j] && row[j] !== row[j - 1] ? words(row[j]) : "";
      if (names.length > 1) return [text, i ? (unitsOf(row[j])[0] ?? "") : `${text}, unit`];
      return i || !names.length || text.includes("[") ? [text] : [`${text} [${names[0]}]`];
    });
  return cells.map((row, i) => line(row, i).map(safe));
}

/** Copy to the clipboard; if a page opened as a file has none, by a selection. Returns the message. */
async function copy(table, text) {
  try {
    await navigator.clipboard.writeText(text);
    return "copied";
  } catch {
    const area = document.createElement("textarea");
    area.value = text;
    document.body.append(area);
    area.select();
    const done = document.execCommand("copy");
    area.remove();
    if (!done) getSelection().selectAllChildren(table);
    return done ? "copied" : "selected: press Ctrl+C";
  }
}

/** Save as CSV for spreadsheets: UTF-8 with byte-order mark. */
function save(rows, name) {
  const quoted = (text) => (/[",;\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const csv = rows.map((row) => `${row.map(quoted).join(",")}\r\n`).join("");
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob(["\ufeff", csv], { type: "text/csv;charset=utf-8" }));
  link.download = `${name.replace(/[^\p{L}\p{N}_.-]+/gu, "-")}.csv`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  return "saved";
}

/** Add the buttons Copy and Save CSV with a status message. */
function tools(table, name, place) {
  const bar = document.createElement("div");
  bar.className = "tools";
  const status = document.createElement("span");
  status.className = "status";
  status.setAttribute("role", "status");
  bar.append(status);
  const add = (key, label, action) => {
    const button = document.createElement("button");
    button.type = "button";
    button.dataset.do = key;
    button.textContent = label;
    button.setAttribute("aria-label", `${label}: ${name}`);
    button.addEventListener("click", async () => {
      status.textContent = "";
      status.textContent = await action();
      button.focus();
    });
    bar.append(button);
  };
  add("copy", "Copy", () => copy(table, contents(table).map((row) => row.join("\t")).join("\n")));
  add("csv", "Save CSV", () => save(contents(table), `${document.querySelector("main").dataset.run}-${name}`));
  place.append(bar);
}

for (const region of document.querySelectorAll(".scroll[data-table]")) {
  const table = region.querySelector("table");
  if (!table.tHead) continue;
  tools(table, region.dataset.table, region.previousElementSibling);
  sortable(table);
}
