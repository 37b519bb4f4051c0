"use strict";
// One view at a time: the cohort, or a patient, and of a patient one part. The address says which one. Without this script
// everything is on one page, one below the other.
(() => {
  const root = document.documentElement;
  const views = [...document.querySelectorAll("main > .view")];
  const partsOf = (view) => [...view.querySelectorAll(":scope > .part")];
  if (!views.length) return;
  const title = document.title;
  const links = [...document.querySelectorAll('body > nav a[href^="#"], .parts a[href^="#"]')];
  const nameOf = (address) => {
    const text = address.slice(1);
    try { return decodeURIComponent(text); } catch { return text; }
  };
  // Links of earlier reports began with `p-`.
  const find = (name) => document.getElementById(name) ?? (name.startsWith("p-") ? document.getElementById(name.slice(2)) : null);
  // Text of a hidden view is still found by the browser's own search, which shows the view.
  const set = (element, shown) => {
    if (shown) element.removeAttribute("hidden");
    else if (!element.hasAttribute("hidden")) element.setAttribute("hidden", "until-found");
  };

  delete root.dataset.views;
  let [current, everything] = [null, false];
  // Shows the view and the part in which an element is.
  const show = (target) => {
    const view = target?.closest("main > .view") ?? current ?? views[0];
    const isNew = view !== current;
    current = view;
    const parts = partsOf(view);
    const part = parts.find((one) => one.contains(target)) ?? parts[0];
    for (const one of views) set(one, everything || one === view);
    for (const one of views) for (const [k, each] of partsOf(one).entries()) set(each, everything || (one === view ? each === part : k === 0));
    root.dataset.view = everything ? "all" : view.id;
    const here = new Set([view.id, part?.id]);
    for (const link of links) {
      const name = nameOf(link.getAttribute("href"));
      const isHere = link.dataset.part ? view.contains(link) && link.dataset.part === part?.dataset.part : here.has(find(name)?.id);
      if (isHere && !everything) {
        link.setAttribute("aria-current", "page");
        link.scrollIntoView({ block: "nearest", inline: "nearest", behavior: "instant" });
      } else link.removeAttribute("aria-current");
    }
    const head = view === views[0] ? null : view.querySelector("h2")?.textContent;
    document.title = head ? `${head} · ${title}` : title;
    return { view, part, isNew };
  };

  // Follows the address. A step back in the history also returns to the place on the page.
  const follow = () => {
    const name = nameOf(location.hash);
    if (name === "all") everything = true;
    else if (name === "top" || name === "") everything = false;
    const target = name === "" ? views[0] : find(name);
    const { view, part, isNew } = show(target);
    const top = history.state?.top;
    if (Number.isFinite(top)) scrollTo({ top, behavior: "instant" });
    else if (target && (everything || ![view, part, document.getElementById("top")].includes(target))) {
      target.scrollIntoView({ behavior: isNew ? "instant" : "auto" });
    } else if (target || name === "all") scrollTo({ top: 0, behavior: "instant" });
    if (isNew && target && !everything) {
      view.tabIndex = -1;
      view.focus({ preventScroll: true });
    }
  };
  try { history.scrollRestoration = "manual"; } catch { /* a page without a history */ }
  const remember = () => {
    try { history.replaceState({ top: scrollY }, ""); } catch { /* the same */ }
  };
  addEventListener("click", (event) => { if (event.target.closest?.('a[href^="#"]')) remember(); }, true);
  addEventListener("pagehide", remember);
  addEventListener("hashchange", follow);
  addEventListener("beforematch", (event) => { if (event.target.matches?.(".view, .part")) show(event.target); });
  // As in the dashboard: the next and the previous patient, and back to the cohort.
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.closest?.("input, select, textarea, canvas")) return;
    const link = { j: '[rel="next"]', k: '[rel="prev"]' }[event.key];
    if (link) current.querySelector(`header ${link}`)?.click();
    else if (event.key === "Escape" && current !== views[0]) document.querySelector(".home")?.click();
  });
  follow();
})();
