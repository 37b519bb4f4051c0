// Words and numbers, as the command line writes them.

/** States in the order of the table, each with its sign and its class of colour. */
export const STATES = {
  failed: { rank: 0, sign: "✕", tone: "bad" },
  refused: { rank: 1, sign: "✕", tone: "bad" },
  unknown: { rank: 2, sign: "?", tone: "warn" },
  off: { rank: 3, sign: "▲", tone: "warn" },
  running: { rank: 4, sign: "▶", tone: "going" },
  waiting: { rank: 5, sign: "○", tone: "quiet" },
  cancelled: { rank: 6, sign: "–", tone: "warn" },
  done: { rank: 7, sign: "●", tone: "good" },
};

/** States in which nothing goes on any more. */
export const OVER = ["done", "off", "failed", "refused", "cancelled"];

/** A row as people see it: a patient whose verified twin is outside of the tolerances is done, but off. */
export const judged = (row) => (row.state === "done" && row.note.includes("not personalised") ? { ...row, state: "off" } : row);

/** Compares names so that P10 follows P9. */
export const byName = new Intl.Collator("en", { numeric: true }).compare;

const two = (value) => String(value).padStart(2, "0");

/** Seconds as `00:01:23`, short ones as `3.2 s`. */
export function duration(seconds) {
  if (!Number.isFinite(seconds) || seconds < 0) return "-";
  if (seconds < 60) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  return `${two(Math.floor(whole / 3600))}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

/** A remaining time in words: `about 3 min`. */
export function remaining(seconds) {
  if (seconds < 90) return `about ${Math.max(5, Math.ceil(seconds / 5) * 5)} s`;
  if (seconds < 5400) return `about ${Math.round(seconds / 60)} min`;
  return `about ${(seconds / 3600).toFixed(1)} h`;
}

/** A number with about three significant digits, or a dash. */
export function number(value) {
  if (value === null || value === undefined) return "-";
  const size = Math.abs(value);
  if (size === 0) return "0";
  if (size >= 1e5 || size < 1e-3) return value.toExponential(2);
  return value.toFixed(size >= 100 ? 1 : size >= 1 ? 2 : 4);
}

/** A share as signed percent, or a dash. */
export function percent(share) {
  if (share === null || share === undefined) return "-";
  return `${share < 0 ? "−" : "+"}${Math.abs(100 * share).toFixed(1)} %`;
}

/** An element with properties and children; `class` and `data-…` are attributes. */
export function element(name, properties = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(properties)) {
    if (key === "class" || key.includes("-")) made.setAttribute(key, value);
    else made[key] = value;
  }
  made.append(...children);
  return made;
}

/** The answer to a question to the server, or an error with the server's words. */
export async function ask(path, kind = "json") {
  let response;
  try {
    response = await fetch(path);
  } catch {
    throw new Error("the dashboard does not answer");
  }
  if (!response.ok) throw new Error((await response.text()).trim());
  return response[kind]();
}
