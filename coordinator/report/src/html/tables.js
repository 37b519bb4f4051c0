"use strict";
// Sorting and filtering of tables, and downloads: a table as CSV, a plot as SVG. Without this script the page is the same
// with its rows in the cohort's order.
(() => {
  const make = (name, attributes = {}, ...content) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...content);
    return made;
  };

  // Value of a cell: unrounded where the page gives it, otherwise its text; null if there is none.
  const valueOf = (cell) => {
    if (!cell) return null;
    if (cell.dataset.value !== undefined) return cell.dataset.value === "" ? null : cell.dataset.value;
    const copy = cell.cloneNode(true);
    for (const extra of copy.querySelectorAll("button.save, svg, title")) extra.remove();
    for (const line of copy.querySelectorAll("br")) line.replaceWith(" ");
    const text = copy.textContent.replaceAll("\u2212", "-").replace(/^\s*[●▲✕○]\s*|\s*[▲✓]\s*$/gu, "").replace(/\s+/gu, " ").trim();
    return text === "" || text === "\u2013" ? null : text;
  };
  const numberOf = (value) => {
    const found = /^([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)(?: ?(?:%|±.*|[a-zµ/]+))?$/iu.exec(value);
    return found ? Number(found[1]) : null;
  };

  // Cells of each column: a row's cells by position, with those that span several columns repeated.
  const spread = (row) => [...row.cells].flatMap((cell) => [cell, ...Array(cell.colSpan - 1).fill(null)]);
  // Head cells of each column, from top to bottom.
  const headsOf = (table) => {
    const grid = [];
    const rows = table.tHead ? [...table.tHead.rows] : [];
    rows.forEach((row, r) => {
      let c = 0;
      for (const cell of row.cells) {
        while (grid[c]?.[r]) c++;
        for (let i = 0; i < cell.colSpan; i++) {
          grid[c + i] ??= [];
          for (let k = 0; k < cell.rowSpan; k++) grid[c + i][r + k] = cell;
        }
        c += cell.colSpan;
      }
    });
    return grid;
  };

  const sortable = (table) => {
    const body = table.tBodies[0];
    if (!table.tHead || !body || table.tBodies.length > 1 || body.rows.length < 2 || body.querySelector("[rowspan]")) return;
    const original = [...body.rows];
    headsOf(table).forEach((heads, column) => {
      const head = heads[heads.length - 1];
      if (!head || head.colSpan > 1 || head.querySelector("button")) return;
      const button = make("button", { type: "button", class: "sort" });
      button.append(...head.childNodes);
      button.title = head.title || "sort by this column";
      head.append(button);
      button.addEventListener("click", () => {
        const next = { none: "ascending", ascending: "descending", descending: "none" }[head.getAttribute("aria-sort") || "none"];
        for (const other of table.tHead.querySelectorAll("[aria-sort]")) other.removeAttribute("aria-sort");
        if (next === "none") return body.append(...original);
        head.setAttribute("aria-sort", next);
        const keys = original.map((row) => valueOf(spread(row)[column]));
        const numeric = keys.every((key) => key === null || numberOf(key) !== null);
        const sign = next === "ascending" ? 1 : -1;
        const compare = (a, b) => (numeric ? numberOf(a) - numberOf(b) : a.localeCompare(b, "en", { numeric: true }));
        const order = original.map((_, k) => k).sort((i, j) => {
          const [a, b] = [keys[i], keys[j]];
          // Missing values are last in either direction.
          if (a === null || b === null) return (a === null) - (b === null) || i - j;
          return sign * compare(a, b) || i - j;
        });
        body.append(...order.map((k) => original[k]));
      });
    });
  };

  const filtered = (table) => {
    const body = table.tBodies[0];
    if (!body || body.rows.length < 2) return;
    const box = make("input", { type: "search", placeholder: "filter patients", "aria-label": "show only patients whose name or state contains this" });
    const count = make("span", { class: "quiet", role: "status" });
    const apply = () => {
      const words = box.value.toLowerCase().split(/\s+/u).filter(Boolean);
      let left = 0;
      for (const row of body.rows) {
        const text = [row.cells[0], row.cells[1]].map((cell) => cell?.textContent ?? "").join(" ").toLowerCase();
        row.hidden = !words.every((word) => text.includes(word));
        left += row.hidden ? 0 : 1;
      }
      count.textContent = words.length ? `${left} of ${body.rows.length}; mean and SD are of all` : "";
    };
    box.addEventListener("input", apply);
    (table.closest(".scroll") ?? table).before(make("p", { class: "filter" }, box, count));
  };

  const save = (name, type, text) => {
    const address = URL.createObjectURL(new Blob([text], { type }));
    const link = make("a", { href: address, download: name });
    document.body.append(link);
    link.click();
    link.remove();
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
  };
  // A file name from the place in the page: patient or cohort, and title.
  const nameOf = (element, title, ending) => {
    const whose = element.closest("section.patient")?.querySelector("h2")?.textContent ?? document.querySelector("h1")?.textContent ?? "report";
    const plain = (text) => text.normalize("NFKD").replace(/[^\w.+-]+/gu, "-").replace(/^-+|-+$/gu, "");
    return `${[whose, title].map(plain).filter(Boolean).join("-").slice(0, 100)}.${ending}`;
  };
  const titleOf = (element) => {
    const copy = element?.cloneNode(true);
    for (const button of copy?.querySelectorAll("button") ?? []) button.remove();
    return copy?.textContent.replace(/\s+/gu, " ").trim() ?? "";
  };

  const csvOf = (table) => {
    const quoted = (value) => (/[",\n]/u.test(value) ? `"${value.replaceAll('"', '""')}"` : value);
    const heads = headsOf(table).map((cells) => [...new Set(cells)].map((cell) => cell && valueOf(cell)).filter(Boolean).join(" "));
    const rows = [...table.tBodies, table.tFoot].filter(Boolean).flatMap((part) => [...part.rows]).filter((row) => !row.hidden);
    const lines = rows.map((row) => spread(row).map((cell) => valueOf(cell) ?? ""));
    return [heads, ...lines].filter((line) => line.length).map((line) => line.map(quoted).join(",") + "\r\n").join("");
  };

  const PROPERTIES = ["fill", "fill-opacity", "stroke", "stroke-width", "stroke-dasharray", "stroke-linejoin", "stroke-linecap", "opacity",
    "font-family", "font-size", "font-weight", "font-style", "text-anchor", "paint-order", "color", "r"];
  const svgOf = (svg) => {
    const copy = svg.cloneNode(true);
    const inline = (from, to) => {
      const style = getComputedStyle(from);
      to.setAttribute("style", PROPERTIES.map((name) => `${name}:${style.getPropertyValue(name)}`).filter((rule) => !rule.endsWith(":")).join(";"));
      [...from.children].forEach((child, k) => {
        if (!["title", "TITLE"].includes(child.tagName)) inline(child, to.children[k]);
      });
    };
    inline(svg, copy);
    for (const passing of copy.querySelectorAll(".cursor, .now")) passing.remove();
    const [x, y, width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
    copy.setAttribute("width", width);
    copy.setAttribute("height", height);
    const ground = document.createElementNS("http://www.w3.org/2000/svg", "rect");
    for (const [key, value] of Object.entries({ x, y, width, height, fill: getComputedStyle(document.body).backgroundColor })) ground.setAttribute(key, value);
    copy.prepend(ground);
    return `<?xml version="1.0" encoding="UTF-8"?>\n${new XMLSerializer().serializeToString(copy)}\n`;
  };

  const button = (text, title, act) => {
    const made = make("button", { type: "button", class: "save", title }, text);
    made.addEventListener("click", act);
    return made;
  };
  for (const table of document.querySelectorAll("main table")) {
    const title = titleOf(table.caption) || titleOf(table.closest("details")?.querySelector("summary")) || "table";
    sortable(table);
    if (table.classList.contains("cohort")) filtered(table);
    const caption = table.caption ?? table.createCaption();
    caption.append(button("CSV", "download this table as CSV", () => save(nameOf(table, title, "csv"), "text/csv;charset=utf-8", csvOf(table))));
  }
  for (const svg of document.querySelectorAll("figure > svg")) {
    const caption = svg.parentElement.querySelector("figcaption");
    const title = svg.getAttribute("aria-label") || titleOf(caption);
    caption?.append(button("SVG", "download this plot as SVG", () => save(nameOf(svg, title, "svg"), "image/svg+xml", svgOf(svg))));
  }

  // `#summary` in the address, or the button, prints only the first part.
  const root = document.documentElement;
  const choose = () => {
    if (location.hash === "#summary") root.dataset.print = "summary";
  };
  addEventListener("hashchange", choose);
  choose();
  for (const print of document.querySelectorAll("button.print")) {
    print.hidden = false;
    print.addEventListener("click", () => {
      root.dataset.print = "summary";
      addEventListener("afterprint", () => { delete root.dataset.print; }, { once: true });
      globalThis.print();
    });
  }
})();
