// Two runs side by side: quantities that differ, patient by patient.
import { Table } from "./table.js";
import { ask, byName, element, number, percent } from "./words.js";

const columns = [
  { key: "patient", title: "patient", value: (row) => row.patient, cell: (row) => row.patient },
  { key: "quantity", title: "quantity", value: (row) => row.quantity, cell: (row) => row.quantity },
  { key: "before", title: "other run", right: true, value: (row) => row.before, cell: (row) => number(row.before) },
  { key: "after", title: "this run", right: true, value: (row) => row.after, cell: (row) => number(row.after) },
  {
    key: "difference", title: "difference", right: true,
    value: (row) => (row.relative_difference === null ? null : -Math.abs(row.relative_difference)),
    cell: (row) => [percent(row.relative_difference), Math.abs(row.relative_difference ?? 0) > 0.25 ? "far" : Math.abs(row.relative_difference ?? 0) > 0.1 ? "off" : ""],
  },
];

export class CompareView {
  constructor(page, runs) {
    this.gone = false;
    this.told = element("p", { class: "quiet", role: "status", textContent: "reading both runs …" });
    this.filter = element("input", { type: "search", placeholder: "filter", "aria-label": "filter by patient and quantity" });
    this.all = element("input", { type: "checkbox" });
    this.choice = element("select", { "aria-label": "other run" }, ...runs.map((run, k) => element("option", { value: k, textContent: run })));
    const again = element("button", { type: "button", textContent: "read again" });
    const tools = element("div", { class: "tools" }, "this run beside ", this.choice, this.filter,
      element("label", {}, this.all, " equal values, too"), again);
    const place = element("div", { class: "fill" });
    page.replaceChildren(element("h1", { textContent: "Two runs" }), tools, this.told, place);
    this.table = new Table(place, columns, {
      label: "quantities", name: (row) => `${row.patient} ${row.quantity}`, empty: "no patient is in both runs",
    });
    this.table.filter = (row) => {
      if (!this.all.checked && row.before === row.after) return false;
      const text = `${row.patient} ${row.quantity}`.toLowerCase();
      return this.filter.value.toLowerCase().split(/\s+/).every((word) => text.includes(word));
    };
    this.filter.addEventListener("input", () => this.table.arrange());
    this.all.addEventListener("change", () => this.table.arrange());
    this.choice.addEventListener("change", () => this.load());
    again.addEventListener("click", () => this.load());
    this.load();
  }

  async load() {
    let found;
    try {
      found = await ask(`/api/compare/${this.choice.value}`);
    } catch (error) {
      if (!this.gone) this.told.textContent = error.message;
      return;
    }
    if (this.gone) return;
    const same = found.quantities.filter((row) => row.before === row.after).length;
    const only = [["only in the other run", found.only_before], ["only in this run", found.only_after]]
      .filter(([, names]) => names.length)
      .map(([words, names]) => `; ${words}: ${names.sort(byName).slice(0, 10).join(", ")}${names.length > 10 ? ` and ${names.length - 10} more` : ""}`);
    this.told.textContent = `${found.quantities.length - same} quantities differ, ${same} are the same${only.join("")}`;
    this.table.set(found.quantities);
  }

  update() {}

  close() {
    this.gone = true;
  }
}
