// The cohort: its rows as they change, the table, the header.
import { Table } from "./table.js";
import { OVER, STATES, byName, duration, element, judged, number, remaining } from "./words.js";

const at = (id) => document.getElementById(id);

/** Everything that the server told; `patients` by name. */
export const run = { known: false, patients: new Map(), counts: {}, refused: [], cluster: null, estimate: null };

/** Rows in their natural order: failures first. */
let rows = [];
const states = new Set();
const listeners = [];

/** Calls `listener(changed)` after each update, with the names of the patients that changed. */
export const onUpdate = (listener) => listeners.push(listener);

const columns = [
  {
    key: "patient", title: "patient", value: (row) => row.patient, hint: (row) => row.state,
    cell: (row) => [`${STATES[row.state].sign} ${row.patient}`, STATES[row.state].tone],
  },
  { key: "step", title: "step", value: (row) => row.step, cell: (row) => row.step },
  { key: "state", title: "state", value: (row) => STATES[row.state].rank, cell: (row) => [row.state, STATES[row.state].tone] },
  {
    key: "iteration", title: "in step 1", right: true, value: (row) => (row.iteration ? row.iteration[0] : null),
    cell: (row) => (row.iteration ? `${row.iteration[0]}/${row.iteration[1]}` : "-"),
  },
  { key: "cost", title: "cost", right: true, value: cost, cell: (row) => number(cost(row)) },
  {
    key: "since", title: "time in state", right: true, value: (row) => (row.since_ms === null ? null : -row.since_ms),
    cell: (row) => (row.since_ms === null ? "-" : duration((Date.now() - row.since_ms) / 1000)),
  },
  {
    key: "note", title: "note", value: (row) => note(row) || null, hint: note,
    cell: (row) => [note(row), isStalled(row) ? "warn" : ""],
  },
];

function cost(row) {
  return row.step2_cost ?? row.step1_cost ?? null;
}

function isStalled(row) {
  return Boolean(row.step1_quality?.startsWith("stalled"));
}

function note(row) {
  const parts = [];
  if (isStalled(row) && !row.note.includes(row.step1_quality)) parts.push(row.step1_quality);
  if (row.failure_class) parts.push(`[${row.failure_class}] ${row.note}`);
  else if (row.note) parts.push(row.note);
  return parts.join("; ");
}

export const table = new Table(at("patients"), columns, {
  label: "patients", name: (row) => row.patient, link: (row) => `#/patient/${encodeURIComponent(row.patient)}`,
  empty: "no patient yet",
});

table.filter = (row) => {
  if (states.size && !states.has(row.state)) return false;
  const words = at("filter").value.trim().toLowerCase().split(/\s+/).filter(Boolean);
  if (!words.length) return true;
  const text = `${row.patient} ${row.step} ${row.state} ${row.failure_class ?? ""} ${note(row)}`.toLowerCase();
  return words.every((word) => text.includes(word));
};
at("filter").addEventListener("input", () => table.arrange());

/** A patient whose files have errors, as a row. */
const refusedRow = ({ patient, errors }) => ({
  patient, step: "input", state: "refused", iteration: null, step1_cost: null, step1_quality: null, step2_cost: null,
  since_ms: null, failure_class: "input", note: errors[0] + (errors.length > 1 ? `; ${errors.length - 1} more` : ""),
});

/** Takes up a message of the server. */
export function takeUp(message) {
  const changed = new Set(message.patients.map((row) => row.patient).concat(message.gone));
  if (message.whole) run.patients.clear();
  for (const row of message.patients) run.patients.set(row.patient, judged(row));
  for (const name of message.gone) run.patients.delete(name);
  const { cohort, waiting, coordinator_running, counts, refused, cluster, estimate } = message;
  Object.assign(run, { known: true, cohort, waiting, coordinator_running, counts, refused, cluster, estimate });
  if (run.cluster) run.cluster.seen_ms = Date.parse(run.cluster.as_of);
  at("trouble").hidden = !message.trouble;
  at("trouble").textContent = message.trouble ? `The run cannot be read: ${message.trouble}` : "";
  if (message.whole || changed.size || refused.length) {
    const kept = new Set(refused.map((one) => one.patient));
    rows = [...run.patients.values()].filter((row) => !kept.has(row.patient)).concat(refused.map(refusedRow));
    rows.sort((a, b) => STATES[a.state].rank - STATES[b.state].rank || byName(a.patient, b.patient));
    table.set(rows);
  }
  head();
  if (message.whole) performance.mark("cohort");
  for (const listener of listeners) listener(changed, message.whole);
}

/** Whether nothing is left to do. */
export const isOver = () => Object.entries(run.counts).every(([state, n]) => !n || ["done", "failed", "cancelled"].includes(state));

/** Numbers of patients by state, refused ones included, in the order of the table. */
function counts() {
  const all = { ...run.counts };
  const off = [...run.patients.values()].filter((row) => row.state === "off").length;
  if (off) [all.off, all.done] = [off, (all.done ?? 0) - off];
  if (run.refused.length) all.refused = run.refused.length;
  return Object.keys(STATES).map((state) => [state, all[state] ?? 0]).filter(([, n]) => n > 0);
}

function ended() {
  if (run.counts.failed) return ["■ ended, with failures", "bad"];
  const off = counts().find(([name]) => name === "off");
  return off ? [`■ ended, ${off[1]} off`, "warn"] : ["■ ended", "good"];
}

function head() {
  at("cohort").textContent = run.cohort || "cardiotwin";
  document.title = `${run.cohort || "cardiotwin"} · cardiotwin`;
  const state = at("coordinator");
  const [words, tone] = run.coordinator_running
    ? ["● running", "good"]
    : isOver() && run.patients.size
      ? ended()
      : run.waiting
        ? ["○ the run has not begun; this page waits for it", "quiet"]
        : ["○ no coordinator is running", "warn"];
  if (state.textContent !== words) state.textContent = words;
  state.className = tone;
  chips();
  const total = counts().reduce((sum, [, n]) => sum + n, 0);
  // Only what is over fills the bar, from the left: a patient that runs is no progress yet.
  const parts = counts().sort(([a], [b]) => OVER.includes(b) - OVER.includes(a));
  at("progress").replaceChildren(...parts.map(([name, n]) => {
    const part = element("span", { class: `part ${name}`, title: `${n} ${name}` });
    part.style.flexGrow = n / total;
    return part;
  }));
  outlook();
}

function chips() {
  const wanted = counts();
  for (const state of states) if (!wanted.some(([name]) => name === state)) wanted.push([state, 0]);
  const group = at("chips");
  const mark = JSON.stringify([wanted, [...states]]);
  if (group.dataset.mark === mark) return;
  group.dataset.mark = mark;
  const focused = document.activeElement?.dataset?.state;
  group.replaceChildren(...wanted.map(([state, n]) => {
    const { sign, tone } = STATES[state];
    const chip = element("button", {
      type: "button", class: `chip ${tone}`, "data-state": state, "aria-pressed": states.has(state), textContent: `${sign} ${n} ${state}`,
    });
    chip.addEventListener("click", () => {
      if (!states.delete(state)) states.add(state);
      chips();
      table.arrange();
    });
    return chip;
  }));
  if (focused) group.querySelector(`[data-state="${focused}"]`)?.focus();
}

/** Node-hours and the expected end; counts down between updates. */
export function outlook() {
  const parts = [];
  let basis = "";
  const { cluster, estimate } = run;
  if (cluster) {
    const left = cluster.node_hours_left;
    const toCome = left <= 0 ? "" : left < 0.005 ? ", less than 0.01 to come" : `, about ${left.toFixed(2)} to come`;
    parts.push(`${cluster.node_hours.toFixed(2)} node-hours so far${toCome}`);
  }
  const end = estimate ? estimate.end_ms : cluster?.expected_end ? Date.parse(cluster.expected_end) : NaN;
  if (Number.isFinite(end) && !isOver()) {
    const left = (end - Date.now()) / 1000;
    const clock = new Date(end).toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit" });
    parts.push(left > 0 ? `${remaining(left)} left (until ${clock})` : "about to end");
    basis = estimate ? estimate.basis : "if as many jobs run at once as the limits allow";
  }
  at("outlook").textContent = parts.join(" · ");
  at("outlook").title = basis;
}
