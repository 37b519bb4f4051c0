// The page: addresses to views, the stream of updates, keys.
import { onUpdate, outlook, run, table, takeUp } from "./cohort.js";
import { CompareView } from "./compare.js";
import { PatientView } from "./patient.js";
import { QueueView } from "./queue.js";
import { ask, element } from "./words.js";

const at = (id) => document.getElementById(id);
const page = at("page");
let view = null;
let others = [];

/** Shows what the address names. */
function route() {
  const [kind, name, tab] = location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  view?.close();
  view = null;
  table.select(undefined);
  if (kind === "patient" && name) view = new PatientView(page, name, tab === "logs" ? "logs" : "results");
  else if (kind === "queue") view = new QueueView(page);
  else if (kind === "compare" && others.length) view = new CompareView(page, others);
  else page.replaceChildren();
  const shown = view ? (kind === "patient" ? "patient" : kind) : "cohort";
  document.body.dataset.page = shown;
  for (const link of document.querySelectorAll("#places a")) {
    if (link.dataset.page === shown) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  table.draw();
}

onUpdate((changed, whole) => {
  document.querySelector('#places [data-page="queue"]').hidden = !run.cluster;
  view?.update(changed, whole);
});

/** Follows the run. The browser connects again by itself, unless the server refuses it. */
function follow() {
  const news = new EventSource("/api/live");
  news.addEventListener("message", (event) => {
    takeUp(JSON.parse(event.data));
    delete document.body.dataset.lost;
  });
  news.addEventListener("error", () => {
    document.body.dataset.lost = "";
    at("coordinator").textContent = "⚠ the dashboard does not answer; trying again";
    at("coordinator").className = "bad";
    if (news.readyState === EventSource.CLOSED) setTimeout(follow, 3000);
  });
}

addEventListener("hashchange", route);
addEventListener("keydown", (event) => {
  const typing = event.target.matches("input[type=search], select, textarea");
  if (event.key === "Escape") {
    if (typing) event.target.blur();
    else if (location.hash.length > 2) location.hash = "#/";
    return;
  }
  if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "/") {
    event.preventDefault();
    at("filter").focus();
  } else if ((event.key === "j" || event.key === "k") && table.shown.length) {
    const next = table.beside(event.key === "j" ? 1 : -1);
    if (next) location.hash = table.link(next);
  }
});
// Durations go on between updates.
setInterval(() => {
  if (document.hidden || document.body.dataset.lost !== undefined) return;
  table.draw();
  outlook();
  view?.tick?.();
}, 1000);

follow();
route();
others = await ask("/api/compare").catch(() => []);
document.querySelector('#places [data-page="compare"]').hidden = !others.length;
if (location.hash.startsWith("#/compare")) route();
