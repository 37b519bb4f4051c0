// A patient: results as they come, the beat in time, attempts and logs.
import { Beat } from "./beat.js";
import { run, table } from "./cohort.js";
import { ask, element } from "./words.js";

/** Time between two looks at a log, ms. */
const LOG_PERIOD = 1000;
/** A report of progress in a log, which begins with its time. */
const REPORT = /^\d{4}-\d\d-\d\dT[\d:.]+Z  /;
/** Colours of a terminal in a log. */
const COLOURS = /\u001b\[[\d;]*m/g;
/** Shortest time between two questions for the results, ms. */
const SHORTEST = 500;

export class PatientView {
  constructor(page, name, tab) {
    Object.assign(this, { page, name, tab, html: null, timer: null, attempt: "", log: null, gone: false });
    const address = `#/patient/${encodeURIComponent(name)}`;
    const tabs = element("div", { class: "tabs", role: "navigation", "aria-label": "parts of the patient" });
    for (const [key, to, title] of [["results", address, "results"], ["logs", `${address}/logs`, "attempts and logs"]]) {
      const link = element("a", { href: to, textContent: title });
      if (key === tab) link.setAttribute("aria-current", "page");
      tabs.append(link);
    }
    const close = element("a", { class: "close", href: "#/", title: "back to the cohort (Esc)", "aria-label": "back to the cohort", textContent: "✕" });
    tabs.append(element("span", { class: "space" }), close);
    this.trouble = element("p", { class: "absent", hidden: true });
    this.now = element("p", { class: "now", role: "status", hidden: true });
    this.beatBar = element("div", { class: "beat", hidden: true });
    this.body = element("div", { class: "results" });
    this.logs = element("div", { class: "logs", hidden: tab !== "logs" });
    page.replaceChildren(tabs, this.trouble, this.now, this.beatBar, this.body, this.logs);
    page.scrollTop = 0;
    if (tab === "logs") this.makeLogs();
    else this.clock = setInterval(() => { if (!document.hidden) this.readProgress(); }, LOG_PERIOD);
    this.load();
    table.select(name);
  }

  /** Asks again after an update that concerns this patient. */
  update(changed, whole) {
    if (!whole && !changed.has(this.name)) return;
    if (this.timer) return;
    this.timer = setTimeout(() => {
      this.timer = null;
      this.load();
    }, SHORTEST);
  }

  close() {
    this.gone = true;
    clearTimeout(this.timer);
    clearInterval(this.clock);
    this.beat?.close();
  }

  async load() {
    let found;
    try {
      found = await ask(`/api/patient/${encodeURIComponent(this.name)}`);
    } catch (error) {
      if (this.gone) return;
      const refused = run.refused.find((one) => one.patient === this.name);
      this.trouble.hidden = false;
      this.trouble.textContent = refused ? refused.errors.join("\n") : error.message;
      return;
    }
    if (this.gone) return;
    this.trouble.hidden = true;
    if (this.tab === "logs") this.showAttempts(found.attempts);
    else if (found.html !== this.html) this.show(found);
  }

  /** Puts new results in the place of the old ones. What the reader opened stays open. */
  show(found) {
    const opened = [...this.body.querySelectorAll("details")].map((one) => one.open);
    const top = this.page.scrollTop;
    this.html = found.html;
    const section = document.createElement("template");
    section.innerHTML = found.html;
    this.body.replaceChildren(section.content);
    [...this.body.querySelectorAll("details")].forEach((one, k) => { one.open = Boolean(opened[k]); });
    globalThis.cardiotwinRead?.(this.body);
    if (this.beat) this.beat.attach(this.body);
    else this.beat = new Beat(this.beatBar, this.body, found.cycle_length_ms);
    this.beat.heart(this.name, found.heart);
    this.page.scrollTop = top;
  }

  makeLogs() {
    this.attempts = element("select", { "aria-label": "attempt" });
    this.attempts.addEventListener("change", () => {
      this.attempt = this.attempts.value;
      this.log = null;
      this.readLog();
    });
    this.follow = element("input", { type: "checkbox", checked: true });
    this.text = element("pre", { class: "log", tabIndex: 0, "aria-label": "log" });
    const label = element("label", {}, this.follow, " follow");
    this.table = element("tbody");
    const titles = ["step", "try", "state", "planned", "ended"].map((title) => element("th", { textContent: title }));
    const head = element("thead", {}, element("tr", {}, ...titles));
    this.logs.append(
      element("div", { class: "scroll" }, element("table", { class: "attempts" }, head, this.table)),
      element("div", { class: "tools" }, "log of ", this.attempts, label),
      this.text,
    );
    this.clock = setInterval(() => { if (!document.hidden) this.readLog(); }, LOG_PERIOD);
    this.readLog();
  }

  showAttempts(attempts) {
    const last = element("option", { value: "", textContent: "the last attempt" });
    const options = attempts.map((one) =>
      element("option", { value: one.name, textContent: `${one.step}, try ${one.generation}, ${one.state}` }));
    this.attempts.replaceChildren(last, ...options);
    this.attempts.value = this.attempt;
    this.table.replaceChildren(...attempts.map((one) => {
      const texts = [one.step, one.generation, one.state, clock(one.planned), one.ended ? clock(one.ended) : "-"];
      const row = element("tr", {}, ...texts.map((text) => element("td", { textContent: text })));
      row.addEventListener("click", () => {
        this.attempts.value = this.attempt = one.name;
        this.log = null;
        this.readLog();
      });
      return row;
    }));
  }

  /** Shows the task at work and the last line of its log above the results. */
  async readProgress() {
    let told = "";
    const row = run.patients.get(this.name);
    if (row?.state === "running") {
      const found = await ask(`/api/patient/${encodeURIComponent(this.name)}/log`).catch(() => null);
      const line = found?.text.split("\n").findLast((one) => REPORT.test(one)) ?? "no report yet";
      told = `${row.step} at work · ${line}`;
    }
    if (this.gone) return;
    this.now.hidden = !told;
    if (this.now.textContent !== told) this.now.textContent = told;
  }

  async readLog() {
    const of = this.attempt;
    const query = of ? `?attempt=${encodeURIComponent(of)}` : "";
    let text;
    try {
      const found = await ask(`/api/patient/${encodeURIComponent(this.name)}/log${query}`);
      text = found.text.replace(COLOURS, "") || (found.attempt ? "this attempt wrote nothing" : "no attempt of any task yet");
    } catch (error) {
      text = error.message;
    }
    if (this.gone || of !== this.attempt || text === this.log) return;
    this.log = this.text.textContent = text;
    if (this.follow.checked) this.text.scrollTop = this.text.scrollHeight;
  }
}

/** Date and time of the reader's place, to the second. */
function clock(text) {
  return new Date(text).toLocaleString("sv-SE");
}
