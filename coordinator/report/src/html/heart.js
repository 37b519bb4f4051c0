"use strict";
// A ventricle that beats and can be turned, drawn with WebGL alone. It is inlined in the report and served by the
// dashboard, so it needs no network, no eval and no inline style.
//
// cardiotwinHeart(canvas, data, options) draws `heart.json` (schemas/json/heart.schema.json) into a canvas and returns a
// viewer, or null if the browser has no WebGL or the data have no frames of the beat: the page then keeps its pictures.
//
//   options  onTime(ms): the instant that is shown while the heart plays
//            onPlay(playing): whether it plays
//            field: "Sa_kPa" (default) or "lambda"; whole: false (default) shows it cut open
//            autoplay: true (default); never where the reader prefers reduced motion
//            speed: beat's milliseconds per millisecond, 0.5 by default
//   viewer   setTime(ms), play(), pause(), turn(on), setField(name), setWhole(on), reset(), destroy()
//            playing, turning, length_ms, times_ms, hasWhole, field
//            colours(name): { least, most, css } with a colour for each band of the interval
(() => {
  // The colours of the pictures: dark violet to light yellow for stress, violet over green to yellow for stretch.
  const STOPS = {
    Sa_kPa: [[40, 11, 84], [101, 21, 110], [159, 42, 99], [212, 72, 66], [245, 125, 21], [250, 193, 39], [252, 255, 164]],
    lambda: [[68, 1, 84], [68, 57, 131], [49, 104, 142], [33, 145, 140], [53, 183, 121], [144, 215, 67], [253, 231, 37]],
  };
  const PASSIVE = [176, 184, 192];
  const BANDS = 12;
  const ABSENT = 255;
  const LIGHT = unit([-0.4, 0.45, 0.8]);
  const AZIMUTH = 10, ELEVATION = 16; // degrees, as in the pictures

  const VERTEX = `
    attribute vec3 place; attribute vec3 normal; attribute float tone;
    uniform mat3 view; uniform vec3 middle; uniform vec2 scale;
    varying vec3 seen; varying float shown;
    void main() {
      vec3 at = view * (place - middle);
      seen = view * normal;
      shown = tone;
      gl_Position = vec4(at.xy * scale, -at.z * 0.002, 1.0);
    }`;
  const FRAGMENT = `
    precision mediump float;
    varying vec3 seen; varying float shown;
    uniform sampler2D ramp; uniform vec3 light; uniform vec3 passive; uniform vec4 line;
    void main() {
      if (line.a > 0.0) { gl_FragColor = line; return; }
      vec3 n = normalize(seen);
      if (n.z < 0.0) n = -n;
      float bright = 0.58 + 0.42 * max(dot(n, light), 0.0);
      vec3 colour = shown < -0.01 ? passive : texture2D(ramp, vec2(clamp(shown, 0.0, 0.999), 0.5)).rgb;
      gl_FragColor = vec4(colour * bright, 1.0);
    }`;

  function unit(a) {
    const length = Math.hypot(...a);
    return length > 0 ? a.map((x) => x / length) : a;
  }
  function cross(a, b) {
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  }
  const mixed = (a, b, s) => a + s * (b - a);

  function bytes(base64) {
    const text = atob(base64);
    const all = new Uint8Array(text.length);
    for (let k = 0; k < text.length; k++) all[k] = text.charCodeAt(k);
    return all;
  }

  function band(name, k) {
    const stops = STOPS[name], at = k / (BANDS - 1) * (stops.length - 1);
    const i = Math.min(Math.floor(at), stops.length - 2);
    return stops[i].map((c, j) => Math.round(mixed(c, stops[i + 1][j], at - i)));
  }

  // Values of a quantity in all frames, and the interval that its colours cover: 0 upwards for stress, in tens; 98 % of
  // the values for stretch, in steps of 0.05.
  function quantity(name, given) {
    const all = bytes(given.values);
    const value = (byte) => mixed(given.least, given.most, byte / (ABSENT - 1));
    const counts = new Array(256).fill(0);
    for (const byte of all) counts[byte]++;
    const present = all.length - counts[ABSENT];
    const quantile = (share) => {
      let below = 0;
      for (let byte = 0; byte < ABSENT; byte++) {
        below += counts[byte];
        if (below > share * present) return value(byte);
      }
      return given.most;
    };
    let least = 0, most = Math.ceil(Math.max(quantile(0.995), 1) / 10) * 10;
    if (name === "lambda") {
      least = Math.floor(quantile(0.01) / 0.05) * 0.05;
      most = Math.max(Math.ceil(quantile(0.99) / 0.05) * 0.05, least + 0.05);
    }
    const tone = (byte) => Math.min(Math.max((value(byte) - least) / (most - least), 0), 1);
    const css = Array.from({ length: BANDS }, (_, k) => `rgb(${band(name, k).join(" ")})`);
    return { all, tone, colours: { least, most, css } };
  }

  // A vertex for each corner of each part, so that the light breaks at the edges between parts.
  function built(data) {
    const corners = [], passive = [], triangles = { cut: [], rest: [], front: [] }, edges = new Map();
    const add = (part, where) => {
      const vertex = new Map();
      for (const triangle of part.triangles) {
        for (const corner of triangle) {
          if (!vertex.has(corner)) {
            vertex.set(corner, corners.length);
            corners.push(corner);
            passive.push(!part.contracts);
          }
          triangles[where].push(vertex.get(corner));
        }
        if (where !== "cut") continue;
        for (let k = 0; k < 3; k++) {
          const [a, b] = [triangle[k], triangle[(k + 1) % 3]];
          // An edge inside the cut is met once in each direction.
          if (!edges.delete(`${b},${a}`)) edges.set(`${a},${b}`, [vertex.get(a), vertex.get(b)]);
        }
      }
    };
    for (const part of data.parts) add(part, part.surface === "cut" ? "cut" : "rest");
    for (const part of data.beat.front || []) add(part, "front");
    return { corners, passive, triangles, outline: [...edges.values()].flat() };
  }

  function program(gl) {
    const made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    return gl.getProgramParameter(made, gl.LINK_STATUS) ? made : null;
  }

  function cardiotwinHeart(canvas, data, options = {}) {
    if (!data || !data.beat || data.beat.time_ms.length < 2) return null;
    const gl = canvas.getContext("webgl", { alpha: true, antialias: true, premultipliedAlpha: true, preserveDrawingBuffer: true });
    const made = gl && program(gl);
    if (!made) return null;

    const { beat } = data;
    const times = beat.time_ms, length = times[times.length - 1];
    const { corners, passive, triangles, outline } = built(data);
    const raw = bytes(beat.points);
    const points = new Int16Array(raw.buffer, 0, raw.length >> 1);
    const n = points.length / 3 / times.length;
    const fields = Object.fromEntries(["Sa_kPa", "lambda"].map((name) => [name, quantity(name, beat[name])]));
    const facets = new Uint16Array([...triangles.cut, ...triangles.rest, ...triangles.front]);
    const hasWhole = triangles.front.length > 0;

    // Frame for all instants, so that the heart does not jump.
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    points.forEach((p, k) => {
      low[k % 3] = Math.min(low[k % 3], p);
      high[k % 3] = Math.max(high[k % 3], p);
    });
    const middle = low.map((x, i) => beat.origin_mm[i] + beat.step_mm * (x + high[i]) / 2);
    let radius = 0;
    for (let k = 0; k < points.length; k += 3) {
      const from = [0, 1, 2].map((i) => beat.origin_mm[i] + beat.step_mm * points[k + i] - middle[i]);
      radius = Math.max(radius, Math.hypot(...from));
    }

    const axisUp = unit(data.long_axis);
    const axisRight = unit(cross(axisUp, data.towards_viewer));
    const axisFront = cross(axisRight, axisUp);
    const still = globalThis.matchMedia?.("(prefers-reduced-motion: reduce)").matches;
    const speed = options.speed ?? 0.5;
    let azimuth = AZIMUTH, elevation = ELEVATION, zoom = 1;
    let field = options.field === "lambda" ? "lambda" : "Sa_kPa", whole = Boolean(options.whole) && hasWhole;
    let now = 0, playing = false, turning = false, before = null, request = 0, gone = false, visible = true;

    const place = new Float32Array(3 * corners.length), normal = new Float32Array(3 * corners.length);
    const tone = new Float32Array(corners.length);
    const buffers = {};
    for (const [name, values, size] of [["place", place, 3], ["normal", normal, 3], ["tone", tone, 1]]) {
      buffers[name] = { buffer: gl.createBuffer(), values, size, at: gl.getAttribLocation(made, name) };
    }
    const elements = (values) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, values, gl.STATIC_DRAW);
      return buffer;
    };
    const facetBuffer = elements(facets), lineBuffer = elements(new Uint16Array(outline));
    const at = Object.fromEntries(["view", "middle", "scale", "ramp", "light", "passive", "line"].map((name) => [name, gl.getUniformLocation(made, name)]));
    gl.useProgram(made);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, wrap, gl.CLAMP_TO_EDGE);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
    gl.uniform1i(at.ramp, 0);
    gl.uniform3fv(at.light, LIGHT);
    gl.uniform3fv(at.passive, PASSIVE.map((c) => c / 255));
    gl.uniform3fv(at.middle, middle);

    const paint = () => {
      const colours = new Uint8Array(Array.from({ length: BANDS }, (_, k) => band(field, k)).flat());
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, BANDS, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, colours);
    };

    // Places, normals and tones at the present instant, between two frames.
    const shape = () => {
      let k = times.findIndex((t) => t > now) - 1;
      if (k < 0) k = times.length - 2;
      const share = Math.min(Math.max((now - times[k]) / (times[k + 1] - times[k]), 0), 1);
      const { all, tone: toneOf } = fields[field];
      corners.forEach((corner, v) => {
        const [a, b] = [k * n + corner, (k + 1) * n + corner];
        for (let i = 0; i < 3; i++) place[3 * v + i] = beat.origin_mm[i] + beat.step_mm * mixed(points[3 * a + i], points[3 * b + i], share);
        tone[v] = passive[v] || all[a] === ABSENT || all[b] === ABSENT ? -1 : toneOf(mixed(all[a], all[b], share));
      });
      normal.fill(0);
      for (let t = 0; t < facets.length; t += 3) {
        const [a, b, c] = [3 * facets[t], 3 * facets[t + 1], 3 * facets[t + 2]];
        const [ux, uy, uz] = [place[b] - place[a], place[b + 1] - place[a + 1], place[b + 2] - place[a + 2]];
        const [wx, wy, wz] = [place[c] - place[a], place[c + 1] - place[a + 1], place[c + 2] - place[a + 2]];
        for (const v of [a, b, c]) {
          normal[v] += uy * wz - uz * wy;
          normal[v + 1] += uz * wx - ux * wz;
          normal[v + 2] += ux * wy - uy * wx;
        }
      }
      for (const { buffer, values, size, at: location } of Object.values(buffers)) {
        gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
        gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
        gl.enableVertexAttribArray(location);
        gl.vertexAttribPointer(location, size, gl.FLOAT, false, 0, 0);
      }
    };

    const draw = () => {
      if (gone) return;
      const ratio = globalThis.devicePixelRatio || 1;
      const [w, h] = [Math.round((canvas.clientWidth || canvas.width) * ratio), Math.round((canvas.clientHeight || canvas.height) * ratio)];
      if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
      gl.viewport(0, 0, w, h);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      const [e, a] = [elevation * Math.PI / 180, azimuth * Math.PI / 180];
      const towards = axisFront.map((x, i) => Math.cos(e) * (Math.cos(a) * x + Math.sin(a) * axisRight[i]) + Math.sin(e) * axisUp[i]);
      const right = unit(cross(axisUp, towards)), up = cross(towards, right);
      // Columns of the matrix from space to right, up, towards the viewer.
      gl.uniformMatrix3fv(at.view, false, [0, 1, 2].flatMap((i) => [right[i], up[i], towards[i]]));
      const fit = 0.97 * zoom / radius, side = Math.min(w, h);
      gl.uniform2f(at.scale, fit * side / w, fit * side / h);
      gl.uniform4f(at.line, 0, 0, 0, 0);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, facetBuffer);
      const [from, to] = whole ? [triangles.cut.length, facets.length] : [0, triangles.cut.length + triangles.rest.length];
      gl.drawElements(gl.TRIANGLES, to - from, gl.UNSIGNED_SHORT, 2 * from);
      if (whole || !outline.length) return;
      const ink = (getComputedStyle(canvas).color.match(/[\d.]+/g) || [0, 0, 0]).slice(0, 3).map((c) => Number(c) / 255);
      gl.uniform4f(at.line, ...ink, 1);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, lineBuffer);
      gl.drawElements(gl.LINES, outline.length, gl.UNSIGNED_SHORT, 0);
    };

    const tick = (stamp) => {
      request = 0;
      const passed = before === null ? 0 : Math.min(stamp - before, 100);
      before = stamp;
      if (playing) {
        now += speed * passed;
        if (now > length) now %= length;
        shape();
        options.onTime?.(now);
      }
      if (turning) azimuth += passed * 0.03;
      draw();
      if (playing || turning) again();
    };
    const again = () => {
      if (!request && !gone && visible) request = requestAnimationFrame(tick);
    };
    const start = () => {
      before = null;
      again();
    };

    const viewer = {
      length_ms: length, times_ms: times, hasWhole,
      get playing() { return playing; },
      get turning() { return turning; },
      get field() { return field; },
      colours: (name) => fields[name].colours,
      setTime(ms) {
        now = Math.min(Math.max(Number(ms) || 0, 0), length);
        shape();
        draw();
      },
      play() {
        playing = true;
        if (now >= length) now = 0;
        options.onPlay?.(true);
        start();
      },
      pause() {
        playing = false;
        options.onPlay?.(false);
      },
      turn(on) {
        turning = Boolean(on);
        start();
      },
      setField(name) {
        if (!fields[name]) return;
        field = name;
        paint();
        shape();
        draw();
      },
      setWhole(on) {
        whole = Boolean(on) && hasWhole;
        draw();
      },
      reset() {
        [azimuth, elevation, zoom] = [AZIMUTH, ELEVATION, 1];
        draw();
      },
      destroy() {
        gone = true;
        playing = turning = false;
        cancelAnimationFrame(request);
        ending.abort();
        watched?.disconnect();
        sized?.disconnect();
        gl.getExtension("WEBGL_lose_context")?.loseContext();
      },
    };

    const rotate = (right, up) => {
      azimuth += right;
      elevation = Math.min(Math.max(elevation + up, -89), 89);
      draw();
    };
    const enlarge = (factor) => {
      zoom = Math.min(Math.max(zoom * factor, 0.4), 6);
      draw();
    };
    const ending = new AbortController();
    const on = (name, act, more = {}) => canvas.addEventListener(name, act, { signal: ending.signal, ...more });
    canvas.tabIndex = 0;
    let held = null;
    on("pointerdown", (event) => {
      held = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    on("pointermove", (event) => {
      if (!held) return;
      rotate((held[0] - event.clientX) * 0.5, (event.clientY - held[1]) * 0.5);
      held = [event.clientX, event.clientY];
    });
    for (const name of ["pointerup", "pointercancel"]) on(name, () => { held = null; });
    on("dblclick", viewer.reset);
    // Without the focus or Ctrl, the wheel scrolls the page.
    on("wheel", (event) => {
      if (document.activeElement !== canvas && !event.ctrlKey) return;
      event.preventDefault();
      enlarge(Math.exp(-event.deltaY * 0.0015));
    }, { passive: false });
    const keys = {
      ArrowLeft: () => rotate(-6, 0), ArrowRight: () => rotate(6, 0), ArrowUp: () => rotate(0, 6), ArrowDown: () => rotate(0, -6),
      "+": () => enlarge(1.15), "-": () => enlarge(1 / 1.15), Home: viewer.reset, " ": () => (playing ? viewer.pause() : viewer.play()),
    };
    on("keydown", (event) => {
      if (!keys[event.key] || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      keys[event.key]();
    });
    on("webglcontextlost", (event) => {
      event.preventDefault();
      gone = true;
      playing = turning = false;
    });
    const watched = globalThis.IntersectionObserver && new IntersectionObserver((entries) => {
      visible = entries[entries.length - 1].isIntersecting;
      if (visible && (playing || turning)) start();
    });
    watched?.observe(canvas);
    const sized = globalThis.ResizeObserver && new ResizeObserver(draw);
    sized?.observe(canvas);

    paint();
    shape();
    draw();
    if (options.autoplay !== false && !still) viewer.play();
    return viewer;
  }

  globalThis.cardiotwinHeart = cardiotwinHeart;
})();
