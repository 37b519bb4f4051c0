// A table of any length: only the rows in sight are in the document.
import { element } from "./words.js";

/** Height of a row, px; dashboard.css has the same. */
const HEIGHT = 30;
/** Rows above and below those in sight. */
const MARGIN = 8;

export class Table {
  /**
   * `columns`: { key, title, right?, sort?(a, b), cell(row) -> text | [text, class], title?(row) } in order;
   * `link(row)`: address that a row opens; absent rows open nothing.
   */
  constructor(place, columns, { link, name, label, sort = null, empty = "nothing to show" }) {
    Object.assign(this, { columns, link, name, empty, sort, down: false, rows: [], shown: [], pool: [] });
    this.filter = () => true;
    this.head = element("div", { class: "thead", role: "row" });
    this.body = element("div", { class: "tbody", tabIndex: -1 });
    this.spacer = element("div", { class: "spacer" });
    this.none = element("p", { class: "absent", hidden: true });
    this.body.append(this.spacer, this.none);
    for (const column of columns) {
      const button = element("button", { type: "button", textContent: column.title });
      button.addEventListener("click", () => this.sortBy(column));
      const cell = element("span", { class: `c ${column.key}${column.right ? " right" : ""}`, role: "columnheader" }, button);
      column.head = cell;
      this.head.append(cell);
    }
    this.root = element("div", { class: "vtable", role: "table", "aria-label": label }, this.head, this.body);
    place.append(this.root);
    this.body.addEventListener("scroll", () => this.draw(), { passive: true });
    new ResizeObserver(() => this.draw()).observe(this.body);
    this.body.addEventListener("keydown", (event) => this.key(event));
  }

  sortBy(column) {
    if (this.sort === column && this.down) [this.sort, this.down] = [null, false];
    else if (this.sort === column) this.down = true;
    else [this.sort, this.down] = [column, false];
    for (const other of this.columns) {
      const own = other === this.sort;
      if (own) other.head.setAttribute("aria-sort", this.down ? "descending" : "ascending");
      else other.head.removeAttribute("aria-sort");
    }
    this.arrange();
    this.body.scrollTop = 0;
  }

  /** Takes rows in their natural order. */
  set(rows) {
    this.rows = rows;
    this.arrange();
  }

  arrange() {
    this.shown = this.rows.filter(this.filter);
    if (this.sort) {
      const sign = this.down ? -1 : 1;
      const { value } = this.sort;
      // Rows without a value come last in either direction.
      this.shown.sort((a, b) => {
        const [x, y] = [value(a), value(b)];
        if (x === null || y === null) return (x === null) - (y === null);
        return sign * (typeof x === "string" ? x.localeCompare(y, "en", { numeric: true }) : x - y);
      });
    }
    this.root.setAttribute("aria-rowcount", this.shown.length + 1);
    this.spacer.style.height = `${this.shown.length * HEIGHT}px`;
    this.none.hidden = this.shown.length > 0;
    this.none.textContent = this.rows.length ? "no row passes the filter" : this.empty;
    this.draw();
  }

  draw() {
    const first = Math.max(0, Math.floor(this.body.scrollTop / HEIGHT) - MARGIN);
    const last = Math.min(this.shown.length, Math.ceil((this.body.scrollTop + this.body.clientHeight) / HEIGHT) + MARGIN);
    while (this.pool.length < last - first) this.pool.push(this.make());
    this.pool.forEach((row, k) => {
      const data = this.shown[first + k];
      if (first + k < last) this.fill(row, data, first + k);
      else row.element.hidden = true;
    });
  }

  make() {
    const cells = this.columns.map((column) =>
      element("span", { class: `c ${column.key}${column.right ? " right" : ""}`, role: "cell" }));
    const row = element(this.link ? "a" : "div", { class: "row", role: "row", hidden: true }, ...cells);
    this.body.append(row);
    return { element: row, cells, texts: [] };
  }

  fill(row, data, index) {
    const { element: own, cells, texts } = row;
    if (own.hidden) own.hidden = false;
    if (row.index !== index) {
      own.style.transform = `translateY(${index * HEIGHT}px)`;
      own.setAttribute("aria-rowindex", index + 2);
      row.index = index;
    }
    const name = this.name(data);
    if (row.name !== name) {
      row.name = own.dataset.name = name;
      if (this.link) own.setAttribute("href", this.link(data));
    }
    const current = this.current !== undefined && this.current === name;
    if (row.current !== current) {
      row.current = current;
      if (current) own.setAttribute("aria-current", "true");
      else own.removeAttribute("aria-current");
    }
    this.columns.forEach((column, k) => {
      const cell = column.cell(data);
      const [text, tone] = Array.isArray(cell) ? cell : [cell, ""];
      const mark = `${tone}\n${text}`;
      if (texts[k] === mark) return;
      texts[k] = mark;
      cells[k].textContent = text;
      cells[k].className = `c ${column.key}${column.right ? " right" : ""} ${tone}`;
      if (column.hint) cells[k].title = column.hint(data);
    });
  }

  /** Marks a row, and brings it into sight if it is not. */
  select(name) {
    this.current = name;
    const index = this.shown.findIndex((row) => this.name(row) === name);
    if (index >= 0) {
      const [top, bottom] = [index * HEIGHT, (index + 1) * HEIGHT];
      const { scrollTop, clientHeight } = this.body;
      if (top < scrollTop || bottom > scrollTop + clientHeight) this.body.scrollTop = top - clientHeight / 2;
    }
    this.draw();
  }

  /** The row `by` rows below the selected one. */
  beside(by) {
    const index = this.shown.findIndex((row) => this.name(row) === this.current);
    return index < 0 ? this.shown[0] : this.shown[index + by];
  }

  key(event) {
    const by = { ArrowDown: 1, ArrowUp: -1, PageDown: 15, PageUp: -15 }[event.key];
    if (!by || !this.shown.length) return;
    event.preventDefault();
    const row = this.pool.find((one) => one.element === document.activeElement);
    const index = Math.min(this.shown.length - 1, Math.max(0, (row ? row.index : -1) + by));
    const top = index * HEIGHT;
    if (top < this.body.scrollTop) this.body.scrollTop = top;
    if (top + HEIGHT > this.body.scrollTop + this.body.clientHeight) this.body.scrollTop = top + HEIGHT - this.body.clientHeight;
    this.draw();
    this.pool.find((one) => !one.element.hidden && one.index === index)?.element.focus({ preventScroll: true });
  }
}
