// The beat in time: one slider moves a line through every plot over time, a point along the loop, and the heart.
import { ask, element } from "./words.js";

const NS = "http://www.w3.org/2000/svg";
const SPEEDS = [["1×", 1], ["½×", 0.5], ["¼×", 0.25]];

const svgElement = (name, attributes) => {
  const made = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
};

/** Straight lines between samples, in the plot's own units of length. */
function along(points, x) {
  let [low, high] = [0, points.length - 1];
  if (high < 1 || x < points[0][0] || x > points[high][0]) return null;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (points[middle][0] <= x) low = middle;
    else high = middle;
  }
  const [a, b] = [points[low], points[high]];
  return b[0] === a[0] ? a[1] : a[1] + ((b[1] - a[1]) * (x - a[0])) / (b[0] - a[0]);
}

/** A plot of the report with its axes and lines, as its attributes give them. */
class Plot {
  constructor(svg) {
    this.svg = svg;
    [this.x0, this.x1, this.y0, this.y1] = svg.dataset.area.split(",").map(Number);
    const ends = (text) => {
      const [from, to, , unit] = text.split(",");
      return { from: Number(from), to: Number(to), unit };
    };
    [this.x, this.y] = [ends(svg.dataset.x), ends(svg.dataset.y)];
    this.lines = [...svg.querySelectorAll("path.line")].map((path) => ({
      source: path.classList[1],
      name: path.dataset.name,
      points: path.getAttribute("d").split(/[ML]/).slice(1).map((pair) => pair.split(" ").map(Number)),
    }));
    this.cursor = svgElement("g", { class: "at", "pointer-events": "none" });
    svg.append(this.cursor);
  }

  placeX(value) {
    return this.x0 + ((value - this.x.from) / (this.x.to - this.x.from)) * (this.x1 - this.x0);
  }

  placeY(value) {
    return this.y1 - ((value - this.y.from) / (this.y.to - this.y.from)) * (this.y1 - this.y0);
  }

  valueY(y) {
    return this.y.from + ((this.y1 - y) / (this.y1 - this.y0)) * (this.y.to - this.y.from);
  }

  /** Values of all lines at a time, by source. */
  at(time) {
    const x = this.placeX(time);
    const values = {};
    for (const line of this.lines) {
      const y = along(line.points, x);
      if (y !== null) values[line.source] = { y, value: this.valueY(y), name: line.name };
    }
    return values;
  }

  /** Moves the cursor to a time: a vertical line and a point on each line. */
  showTime(time) {
    const x = this.placeX(time);
    const points = Object.entries(this.at(time)).map(([source, { y }]) => svgElement("circle", { class: source, cx: x, cy: y, r: 3.4 }));
    this.cursor.replaceChildren(svgElement("line", { x1: x, x2: x, y1: this.y0, y2: this.y1 }), ...points);
  }

  showPoints(points) {
    this.cursor.replaceChildren(...points.map(({ source, x, y }) =>
      svgElement("circle", { class: source, cx: this.placeX(x), cy: this.placeY(y), r: 5 })));
  }
}

export class Beat {
  constructor(bar, results, cycle) {
    Object.assign(this, { bar, cycle, time: 0, frame: null, viewer: null, speed: 1 });
    this.button = element("button", { type: "button", class: "play", "aria-label": "play", textContent: "▶" });
    this.button.addEventListener("click", () => (this.frame === null ? this.play() : this.pause()));
    this.slider = element("input", { type: "range", min: 0, max: cycle, step: 1, value: 0, "aria-label": "time in the beat, ms" });
    this.slider.addEventListener("input", () => {
      this.pause();
      this.show(Number(this.slider.value));
    });
    const speed = element("select", { "aria-label": "speed" }, ...SPEEDS.map(([text, value]) => element("option", { value, textContent: text })));
    speed.addEventListener("change", () => { this.speed = Number(speed.value); });
    this.told = element("output", { class: "told" });
    bar.append(element("div", { class: "controls" }, this.button, this.slider, speed, this.told));
    this.attach(results);
  }

  /** Takes the plots of new results. */
  attach(results) {
    const plots = [...results.querySelectorAll("svg.plot[data-read]")].map((svg) => new Plot(svg));
    this.overTime = plots.filter((plot) => plot.x.unit === "ms");
    this.pressure = this.overTime.find((plot) => plot.y.unit === "mmHg");
    this.volume = this.overTime.find((plot) => plot.y.unit === "mL");
    this.loop = plots.find((plot) => plot.x.unit === "mL" && plot.y.unit === "mmHg");
    this.bar.hidden = !this.pressure;
    this.show(this.time);
  }

  show(time) {
    this.time = time;
    this.slider.value = time;
    for (const plot of this.overTime) plot.showTime(time);
    const pressures = this.pressure?.at(time) ?? {};
    const volumes = this.volume?.at(time) ?? {};
    const sources = ["measured", "step1", "step2", "step3"].filter((source) => pressures[source]);
    this.loop?.showPoints(sources.filter((source) => volumes[source])
      .map((source) => ({ source, x: volumes[source].value, y: pressures[source].value })));
    const told = sources.map((source) => element("span", { class: source },
      `${pressures[source].name}: ${pressures[source].value.toFixed(0)} mmHg${volumes[source] ? `, ${volumes[source].value.toFixed(0)} mL` : ""}`));
    this.told.replaceChildren(element("b", { textContent: `${time.toFixed(0)} ms` }), ...told);
    this.viewer?.setTime(time);
  }

  play() {
    let last = performance.now();
    const step = (now) => {
      this.show((this.time + (now - last) * this.speed) % this.cycle);
      last = now;
      this.frame = requestAnimationFrame(step);
    };
    this.frame = requestAnimationFrame(step);
    this.button.textContent = "❚❚";
    this.button.setAttribute("aria-label", "pause");
  }

  pause() {
    if (this.frame !== null) cancelAnimationFrame(this.frame);
    this.frame = null;
    this.button.textContent = "▶";
    this.button.setAttribute("aria-label", "play");
  }

  /** Shows the wall beside the plots, where a simulation left its beat and the browser can draw it. */
  async heart(patient, mark) {
    if (!mark || mark === this.mark || !globalThis.cardiotwinHeart) return;
    this.mark = mark;
    let data;
    try {
      data = await ask(`/api/patient/${encodeURIComponent(patient)}/heart`);
    } catch {
      return; // The section itself says which file cannot be read.
    }
    if (mark !== this.mark) return;
    const canvas = element("canvas", { class: "heart3d", role: "img", "aria-label": `wall of ${patient}: drag or arrow keys turn it` });
    const panel = element("div", { class: "wall" }, canvas);
    this.bar.append(panel);
    const viewer = globalThis.cardiotwinHeart(canvas, data, { autoplay: false });
    if (!viewer) return panel.remove();
    this.viewer?.destroy();
    this.panel?.remove();
    [this.viewer, this.panel] = [viewer, panel];
    const field = element("select", { "aria-label": "colour" },
      element("option", { value: "Sa_kPa", textContent: "active stress" }), element("option", { value: "lambda", textContent: "fibre stretch" }));
    const scale = element("output", { class: "quiet" });
    const paint = () => {
      viewer.setField(field.value);
      const { least, most } = viewer.colours(field.value);
      scale.textContent = field.value === "lambda" ? `${least.toFixed(2)} to ${most.toFixed(2)}` : `${least} to ${most} kPa`;
    };
    field.addEventListener("change", paint);
    const tools = element("div", { class: "walltools" }, field, scale);
    if (viewer.hasWhole) {
      const whole = element("input", { type: "checkbox" });
      whole.addEventListener("change", () => viewer.setWhole(whole.checked));
      tools.append(element("label", {}, whole, " whole"));
    }
    const turning = element("input", { type: "checkbox" });
    turning.addEventListener("change", () => viewer.turn(turning.checked));
    tools.append(element("label", {}, turning, " turn"));
    panel.append(tools);
    paint();
    viewer.setTime(this.time);
  }

  close() {
    this.pause();
    this.viewer?.destroy();
  }
}
