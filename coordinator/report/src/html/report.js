"use strict";
// The report is complete without this script: it adds the theme switch, reading values off plots, and where one is.
(() => {
  const root = document.documentElement;
  const dark = () => root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  const set = (theme) => {
    root.dataset.theme = theme;
    try { localStorage.setItem("cardiotwin-theme", theme); } catch { /* a file opened without storage */ }
  };
  for (const button of document.querySelectorAll(".theme")) button.addEventListener("click", () => set(dark() ? "light" : "dark"));
  addEventListener("hashchange", () => { if (location.hash === "#dark" || location.hash === "#light") set(location.hash.slice(1)); });
  addEventListener("beforeprint", () => { for (const d of document.querySelectorAll("details")) d.open = true; });

  // Where one is, on a page without views.
  const links = new Map([...document.querySelectorAll('body > nav a[href^="#"]')].map((a) => [decodeURIComponent(a.hash.slice(1)), a]));
  const seen = new IntersectionObserver((entries) => {
    for (const e of entries) {
      const link = links.get(e.target.id);
      if (!link) continue;
      if (e.isIntersecting) {
        for (const other of links.values()) other.removeAttribute("aria-current");
        link.setAttribute("aria-current", "true");
        link.scrollIntoView({ block: "nearest", inline: "nearest" });
      } else link.removeAttribute("aria-current");
    }
  }, { rootMargin: "-15% 0px -80% 0px" });
  for (const s of document.querySelectorAll("section.patient:not(.view)")) seen.observe(s);

  // Reading values off.
  const readout = document.createElement("div");
  readout.id = "readout";
  readout.hidden = true;
  document.body.append(readout);
  const NS = "http://www.w3.org/2000/svg";
  const points = new WeakMap();
  const pointsOf = (path) => {
    if (!points.has(path)) points.set(path, path.getAttribute("d").split(/[ML]/).slice(1).map((p) => p.split(" ").map(Number)));
    return points.get(path);
  };
  const axis = (text, from, to) => {
    const [lo, hi, kind, unit] = text.split(",");
    const [a, b] = [Number(lo), Number(hi)];
    return {
      unit,
      value: (px) => {
        const f = (px - from) / (to - from);
        return kind === "log" ? a * (b / a) ** f : a + (b - a) * f;
      },
      pixel: (value) => from + (to - from) * (kind === "log" ? Math.log(value / a) / Math.log(b / a) : (value - a) / (b - a)),
    };
  };
  const show = (v) => (v === 0 ? "0" : Number(v.toPrecision(Math.abs(v) >= 1000 ? 4 : 3)).toString()).replace("-", "\u2212");
  const element = (name, attributes) => {
    const e = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(attributes)) e.setAttribute(key, value);
    return e;
  };
  const atX = (line, x) => {
    if (!line.length || x < line[0][0] || x > line[line.length - 1][0]) return null;
    let i = line.findIndex((p) => p[0] >= x);
    if (i < 1) i = 1;
    const [a, b] = [line[i - 1], line[i]];
    return b ? a[1] + (b[1] - a[1]) * (b[0] === a[0] ? 0 : (x - a[0]) / (b[0] - a[0])) : a[1];
  };
  globalThis.cardiotwinReading = { pointsOf, axis, show, element, atX };
  const read = (within) => { for (const svg of within.querySelectorAll("svg.plot[data-read]")) {
    const [x0, x1, y0, y1] = svg.dataset.area.split(",").map(Number);
    const xs = axis(svg.dataset.x, x0, x1), ys = axis(svg.dataset.y, y1, y0);
    const lines = [...svg.querySelectorAll("path.line")].reverse();
    let cursor = null;
    const leave = () => { cursor?.remove(); cursor = null; readout.hidden = true; };
    svg.addEventListener("pointerleave", leave);
    svg.addEventListener("pointermove", (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      cursor?.remove();
      if (at.x < x0 || at.x > x1 || at.y < y0 || at.y > y1) return leave();
      cursor = element("g", { class: "cursor", "pointer-events": "none" });
      const rows = [];
      if (svg.dataset.read === "x") {
        cursor.append(element("line", { x1: at.x, x2: at.x, y1: y0, y2: y1 }));
        rows.push(`${show(xs.value(at.x))} ${xs.unit}`);
        for (const path of lines) {
          const y = atX(pointsOf(path), at.x);
          if (y === null) continue;
          cursor.append(element("circle", { cx: at.x, cy: y, r: 3 }));
          rows.push(`${path.dataset.name}: ${show(ys.value(y))} ${ys.unit}`);
        }
      } else {
        let best = null;
        for (const path of lines) for (const [x, y] of pointsOf(path)) {
          const d = Math.hypot(x - at.x, y - at.y);
          if (!best || d < best.d) best = { d, x, y, name: path.dataset.name };
        }
        if (!best || best.d > 40) return leave();
        cursor.append(element("circle", { cx: best.x, cy: best.y, r: 3 }));
        rows.push(best.name, `${show(xs.value(best.x))} ${xs.unit}`, `${show(ys.value(best.y))} ${ys.unit}`);
      }
      svg.append(cursor);
      readout.replaceChildren(...rows.map((text) => Object.assign(document.createElement("div"), { textContent: text })));
      readout.hidden = false;
      const room = readout.getBoundingClientRect();
      readout.style.left = `${Math.min(event.clientX + 16, innerWidth - room.width - 8)}px`;
      readout.style.top = `${Math.max(8, Math.min(event.clientY - room.height - 12, innerHeight - room.height - 8))}px`;
    });
  } };
  read(document);
  // For pages that get plots later.
  globalThis.cardiotwinRead = read;
})();
