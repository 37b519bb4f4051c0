"use strict";
// A time slider for each patient's beat: a dot moves along every trace and around the loop, and where frames of the
// ventricle were kept, a heart beats beside the loop. It needs `cardiotwinReading` of report.js.
(() => {
  const { pointsOf, axis, show, element, atX } = globalThis.cardiotwinReading;
  const make = (name, attributes = {}, ...content) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...content);
    return made;
  };

  // The lines of a chart by name, with functions between pixels and values.
  const read = (svg) => {
    const [x0, x1, y0, y1] = svg.dataset.area.split(",").map(Number);
    const lines = [...svg.querySelectorAll("path.line")].map((path) => ({
      name: path.dataset.name, kind: path.classList[1], points: pointsOf(path),
    }));
    return { svg, lines, x: axis(svg.dataset.x, x0, x1), y: axis(svg.dataset.y, y1, y0), group: null };
  };
  const nearest = (points, x, y) => {
    let best = [x, y, Infinity];
    for (let k = 1; k < points.length; k++) {
      const [[ax, ay], [bx, by]] = [points[k - 1], points[k]];
      const [dx, dy] = [bx - ax, by - ay];
      const s = Math.min(Math.max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1), 0), 1);
      const [px, py] = [ax + s * dx, ay + s * dy], d = Math.hypot(px - x, py - y);
      if (d < best[2]) best = [px, py, d];
    }
    return best;
  };

  for (const player of document.querySelectorAll(".player")) {
    const room = player.parentElement, length = Number(player.dataset.length);
    const of = (role) => room.querySelector(`svg.plot[data-role="${role}"]`);
    const timed = ["pressure", "volume", "flow"].map(of).filter(Boolean).map(read);
    const [pressure, volume, loop] = ["pressure", "volume", "loop"].map((role) => of(role) && read(of(role)));
    if (!timed.length || !(length > 0)) continue;

    const button = make("button", { type: "button", class: "play", "aria-label": "play the beat" }, "▶");
    const slider = make("input", { type: "range", min: 0, max: length, step: 1, value: 0, "aria-label": "time in the beat (ms)" });
    const output = make("output", {});
    player.append(button, slider, output);
    player.hidden = false;

    const at = make("span", { class: "at", title: "time in the beat" });
    let now = 0, playing = false, heart = null, wanted = null;
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;

    const mark = (chart, places) => {
      chart.group?.remove();
      chart.group = element("g", { class: "now", "pointer-events": "none" });
      const [, , y0, y1] = chart.svg.dataset.area.split(",").map(Number);
      for (const { x, y, kind } of places) {
        if (y === null) chart.group.append(element("line", { x1: x, x2: x, y1: y0, y2: y1 }));
        else chart.group.append(element("circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: 4.2, class: `mark ${kind}` }));
      }
      chart.svg.append(chart.group);
    };
    const valueAt = (chart, kind, ms) => {
      const line = chart?.lines.find((line) => line.kind === kind);
      const y = line ? atX(line.points, chart.x.pixel(ms)) : null;
      return y === null ? null : chart.y.value(y);
    };
    const go = (ms) => {
      now = ms;
      slider.value = ms;
      for (const chart of timed) {
        const x = chart.x.pixel(ms);
        const dots = chart.lines.map(({ points, kind }) => ({ x, y: atX(points, x), kind })).filter((dot) => dot.y !== null);
        mark(chart, [{ x, y: null }, ...dots]);
      }
      const words = [];
      const dots = [];
      for (const [kind, name] of [["measured", "measured"], ["step1", "step 1"], ["step2", "step 2"], ["step3", "step 3"]]) {
        const [p, v] = [valueAt(pressure, kind, ms), valueAt(volume, kind, ms)];
        const parts = [p !== null && `${show(p)} mmHg`, v !== null && `${show(v)} mL`].filter(Boolean);
        if (parts.length) words.push(`${name} ${parts.join(", ")}`);
        const line = loop?.lines.find((line) => line.kind === kind);
        if (!line || p === null || v === null) continue;
        // Between frames of the image the loop is smooth and the trace straight.
        const [x, y] = nearest(line.points, loop.x.pixel(v), loop.y.pixel(p));
        dots.push({ x, y, kind });
      }
      if (loop) mark(loop, dots);
      output.textContent = [`${Math.round(ms)} ms`, ...words].join(" · ");
      at.textContent = `${Math.round(ms)} ms`;
    };

    const shown = (on) => {
      playing = on;
      button.textContent = on ? "❚❚" : "▶";
      button.setAttribute("aria-label", on ? "pause the beat" : "play the beat");
    };
    let before = null;
    const tick = (stamp) => {
      if (!playing || heart) return;
      const passed = before === null ? 0 : Math.min(stamp - before, 100);
      before = stamp;
      go((now + 0.5 * passed) % length);
      requestAnimationFrame(tick);
    };
    const play = () => {
      shown(true);
      if (heart) return heart.play();
      before = null;
      requestAnimationFrame(tick);
    };
    const pause = () => {
      shown(false);
      heart?.pause();
    };
    const seek = (ms) => {
      go(ms);
      heart?.setTime(ms);
    };
    button.addEventListener("click", () => {
      wanted = !playing;
      if (playing) pause(); else play();
    });
    slider.addEventListener("input", () => {
      wanted = false;
      pause();
      seek(Number(slider.value));
    });
    seek(0);

    // The heart, drawn only while it is in sight, because a browser draws few of them at a time.
    const given = room.querySelector("script.heart-data");
    if (!given) continue;
    const data = JSON.parse(given.textContent);
    const field = make("select", { "aria-label": "colours" }, make("option", { value: "Sa_kPa" }, "active stress"), make("option", { value: "lambda" }, "fibre stretch"));
    const bar = make("span", { class: "colours" });
    const whole = make("button", { type: "button", "aria-pressed": "false" }, "whole");
    const turn = make("button", { type: "button", "aria-pressed": "false" }, "turn");
    const reset = make("button", { type: "button" }, "reset");
    const place = make("div", { class: "stage" });
    const caption = make("figcaption", {}, make("b", {}, "Heart"), make("span", { class: "quiet" }, `, ${given.dataset.name}: drag to turn, click and wheel to zoom`));
    const figure = make("figure", { class: "moving" }, caption, make("p", { class: "controls" }, field, bar, at, whole, turn, reset), place);
    const fresh = () => make("canvas", {
      role: "img", "aria-label": `${given.dataset.name} in 3D over the beat; arrow keys turn, plus and minus zoom, space plays, Home resets`,
    });
    const beside = of("loop")?.closest("figure");
    if (beside) beside.before(figure); else room.querySelector(".figures").append(figure);

    const colours = () => {
      const { least, most, css } = heart.colours(field.value);
      const NS = "http://www.w3.org/2000/svg";
      const svg = document.createElementNS(NS, "svg");
      svg.setAttribute("viewBox", `0 0 ${css.length} 1`);
      svg.setAttribute("preserveAspectRatio", "none");
      css.forEach((fill, k) => svg.append(element("rect", { x: k, y: 0, width: 1.02, height: 1, fill })));
      const digits = field.value === "lambda" ? 2 : 0;
      bar.replaceChildren(least.toFixed(digits), svg, `${most.toFixed(digits)}${field.value === "lambda" ? "" : " kPa"}`);
    };
    const begin = () => {
      const canvas = fresh();
      place.replaceChildren(canvas);
      const viewer = globalThis.cardiotwinHeart?.(canvas, data, { autoplay: false, field: field.value, onTime: go, onPlay: shown });
      if (!viewer) {
        figure.remove();
        return false;
      }
      heart = viewer;
      heart.setWhole(whole.getAttribute("aria-pressed") === "true");
      heart.setTime(now);
      colours();
      whole.hidden = !heart.hasWhole;
      return true;
    };
    const end = () => {
      if (!heart) return;
      pause();
      heart.destroy();
      heart = null;
      turn.setAttribute("aria-pressed", "false");
    };
    field.addEventListener("change", () => { heart?.setField(field.value); if (heart) colours(); });
    whole.addEventListener("click", () => {
      const on = whole.getAttribute("aria-pressed") !== "true";
      whole.setAttribute("aria-pressed", on);
      heart?.setWhole(on);
    });
    turn.addEventListener("click", () => {
      const on = turn.getAttribute("aria-pressed") !== "true";
      turn.setAttribute("aria-pressed", on);
      heart?.turn(on);
    });
    reset.addEventListener("click", () => heart?.reset());
    const near = new IntersectionObserver((entries) => {
      if (entries[entries.length - 1].isIntersecting) enter(); else end();
    }, { rootMargin: "100px" });
    const enter = () => {
      if (heart) return;
      if (!begin()) return near.disconnect();
      if (wanted ?? !still) play();
    };
    near.observe(figure);
    const box = figure.getBoundingClientRect();
    if (!figure.closest("[hidden]") && box.top < innerHeight && box.bottom > 0) enter();
  }
})();
