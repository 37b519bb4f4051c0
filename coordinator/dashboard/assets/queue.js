// The cluster: jobs that have not ended, node-hours, charge, the age of the queue's answer.
import { run } from "./cohort.js";
import { Table } from "./table.js";
import { duration, element } from "./words.js";

const TONES = { running: "good", doubtful: "warn", unknown: "warn", stopping: "warn" };

const columns = [
  { key: "id", title: "job", value: (row) => row.id || null, cell: (row) => row.id || "-" },
  { key: "jobstate", title: "state", value: (row) => row.state, cell: (row) => [row.state, TONES[row.state] ?? ""] },
  { key: "jobname", title: "name", value: (row) => row.name, cell: (row) => row.name },
  { key: "jobpatients", title: "patients", value: (row) => row.patients.length, cell: (row) => row.patients.join(", "), hint: (row) => row.patients.join(", ") },
  { key: "note", title: "reason", value: (row) => row.why || null, cell: (row) => row.why, hint: (row) => row.why },
];

export class QueueView {
  constructor(page) {
    this.told = element("dl", { class: "facts" });
    this.place = element("div", { class: "fill" });
    page.replaceChildren(element("h1", { textContent: "Queue" }), this.told, this.place);
    this.table = new Table(this.place, columns, { label: "jobs", name: (row) => `${row.name} ${row.id}`, empty: "no job is in the queue" });
    this.update();
  }

  update() {
    const { cluster } = run;
    this.place.hidden = !run.known;
    if (!cluster) {
      this.told.replaceChildren(element("dd", { textContent: run.known ? "This run has no jobs on a cluster." : "" }));
      this.table.set([]);
      return;
    }
    const running = cluster.jobs.filter((job) => job.state === "running").length;
    const facts = [
      ["site", cluster.site],
      ["jobs", `${running} running, ${cluster.jobs.length - running} pending`],
      ["node-hours so far", cluster.node_hours.toFixed(2)],
      ["node-hours to come", `about ${cluster.node_hours_left.toFixed(2)}`],
      ["charge so far", cluster.charge > 0 ? `${cluster.charge.toFixed(2)} ${cluster.charge_unit}` : null],
      ["expected end", cluster.expected_end ? new Date(cluster.expected_end).toLocaleString("sv-SE") : null],
      ["the queue answered", cluster.as_of ? `${duration((Date.now() - cluster.seen_ms) / 1000)} ago` : "never"],
      ["no answer", cluster.no_answer],
      ["nothing is submitted", cluster.holds],
    ];
    this.told.replaceChildren(...facts.filter(([, value]) => value !== null && value !== undefined)
      .flatMap(([name, value]) => [element("dt", { textContent: name }), element("dd", { textContent: value })]));
    this.table.set(cluster.jobs);
  }

  /** The age of the queue's answer goes on between updates. */
  tick() {
    this.update();
  }

  close() {}
}
