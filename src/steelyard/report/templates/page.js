"use strict";
// What goes wrong in this page is written into it, so that a look at the page shows it.
window.addEventListener("error", (event) => {
  document.body.dataset.errors = (document.body.dataset.errors || "") + event.message + "\n";
});
window.addEventListener("unhandledrejection", (event) => {
  document.body.dataset.errors = (document.body.dataset.errors || "") + event.reason + "\n";
});
window.addEventListener("beforeprint", () => {
  document.querySelectorAll("details").forEach((one) => { one.open = true; });
});

// Light or dark as the system has it, until the button changes it; paper is always light.
function chooseTheme() {
  const root = document.documentElement, button = document.getElementById("theme");
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  function set(theme) {
    root.dataset.theme = theme;
    button.textContent = theme === "dark" ? "Light colours" : "Dark colours";
    window.dispatchEvent(new Event("theme"));
  }
  let screen = root.dataset.theme;
  button.addEventListener("click", () => set(root.dataset.theme === "dark" ? "light" : "dark"));
  dark.addEventListener("change", () => set(dark.matches ? "dark" : "light"));
  window.addEventListener("beforeprint", () => { screen = root.dataset.theme; set("light"); });
  window.addEventListener("afterprint", () => set(screen));
  set(screen);
  button.hidden = false;
}

// A section that is folded opens when a link leads to it.
function openTarget() {
  const target = location.hash && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const fold = target && target.querySelector(":scope > details.fold");
  if (fold) fold.open = true;
}

const PREFIX = { "µ": 1e-6, m: 1e-3, k: 1e3, M: 1e6 };

// The number that a cell begins with, in the unit without prefix; null if it begins with none.
function numberIn(cell) {
  const text = cell.textContent.replace(/[\s\u2060]/g, "").replace(/\u2212/g, "-");
  const found = text.match(/^[<>≤≥±≈]?([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)(.*)$/);
  if (!found) return null;
  const unit = found[2].match(/^(µ|m|k|M)?(?:m|s|A|V|Nm|N|g|Hz|W|B|rad)(?![a-z])/);
  return Number(found[1]) * ((unit && PREFIX[unit[1]]) || 1);
}

// Less, equal or more, for one column; cells without a number or words come last either way.
function compare(a, b, numbers, sign) {
  const [x, y] = [a, b].map((cell) => (numbers ? numberIn(cell) : cell.textContent.trim() || null));
  if (x === null || y === null) return (x === null) - (y === null);
  return sign * (numbers ? x - y : x.localeCompare(y, "en", { numeric: true }));
}

// Headings of columns sort the rows: up, down, as they were. A row of class "follows" stays
// below the row before it; rows of a table's foot stay where they are.
function makeSortable(table) {
  const body = table.tBodies[0], headings = [...table.tHead.rows[0].cells], groups = [];
  [...body.rows].forEach((row) => {
    if (row.classList.contains("follows") && groups.length) groups[groups.length - 1].push(row);
    else groups.push([row]);
  });
  if (groups.length < 2 || groups.some(([row]) => row.cells.length !== headings.length)) return;
  function sort(heading, column) {
    const order = { ascending: "descending", descending: "none" }[heading.ariaSort] || "ascending";
    headings.forEach((one) => one.removeAttribute("aria-sort"));
    if (order !== "none") heading.setAttribute("aria-sort", order);
    const cells = groups.map(([row]) => row.cells[column]).filter((one) => /[^\s–]/.test(one.textContent));
    const numbers = cells.every((one) => one.tagName === "TD" && numberIn(one) !== null);
    const sign = order === "descending" ? -1 : 1;
    const sorted = groups.slice().sort(([a], [b]) => compare(a.cells[column], b.cells[column], numbers, sign));
    body.append(...(order === "none" ? groups : sorted).flat());
  }
  headings.forEach((heading, column) => {
    if (!heading.textContent.trim()) return;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.append(...heading.childNodes);
    heading.append(button);
    button.addEventListener("click", () => sort(heading, column));
  });
}

// Colours of figures: "--name" in a figure is the colour of that name in the style sheet.
function themed(value) {
  if (typeof value === "string") {
    return value.startsWith("--")
      ? getComputedStyle(document.documentElement).getPropertyValue(value).trim() : value;
  }
  if (Array.isArray(value)) return value.map(themed);
  if (value === null || typeof value !== "object") return value;
  return Object.fromEntries(Object.entries(value).map(([name, one]) => [name, themed(one)]));
}

const GRID = { gridcolor: "--grid", zerolinecolor: "--zero", automargin: true };
const CONFIG = { responsive: true, displayModeBar: false };

// What all figures share.
function basis() {
  const touch = window.matchMedia("(pointer: coarse)").matches;
  return {
    dragmode: touch ? false : "zoom", margin: { l: 58, r: 8, t: 8, b: 40 }, autosize: true,
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: "--soft" },
    hoverlabel: { bgcolor: "--card", bordercolor: "--line", font: { color: "--ink" } },
  };
}

function drawPlots() {
  const data = new Map();
  document.querySelectorAll("script.effort-data").forEach((one) => {
    data.set(one.dataset.run + "/" + one.dataset.joint, one);
  });
  const plots = [...document.querySelectorAll(".plot")];
  const menu = document.getElementById("effort-run");
  if (!menu) return;
  const bands = document.getElementById("effort-bands");
  const shades = ["--band", "--surely", "--band"];
  const styles = [
    { name: "measured", line: { color: "--measured", width: 4.2 } },
    { name: "predicted", line: { color: "--predicted", width: 1.6, dash: "8px,5px" } },
    { name: "residual", line: { color: "--residual", width: 1.2 } },
  ];

  function areas(figure) {
    if (bands && !bands.checked) return [];
    return figure.bands.map((area, k) => ({
      type: "scatter", mode: "none", x: area.x, y: area.y, yaxis: k === 2 ? "y2" : "y", fill: "toself",
      fillcolor: shades[k], hoverinfo: "skip", connectgaps: false,
    }));
  }

  function lines(figure) {
    return figure.lines.map((line, k) => ({
      type: "scatter", mode: "lines", ...styles[k], x: line.x, y: line.y,
      yaxis: k === 2 ? "y2" : "y", connectgaps: false,
    }));
  }

  function layout(figure) {
    return {
      ...basis(), showlegend: false, hovermode: "x unified",
      xaxis: { ...GRID, anchor: "y2", zeroline: false, title: { text: figure.time, standoff: 6 } },
      yaxis: { ...GRID, domain: [0.38, 1], title: { text: `effort [${figure.unit}]`, standoff: 4 } },
      yaxis2: { ...GRID, domain: [0, 0.28], nticks: 4 },
      shapes: figure.rests.map(([from, to]) => ({
        type: "rect", xref: "x", yref: "paper", x0: from, x1: to, y0: 0, y1: 1,
        fillcolor: "--rest", line: { width: 0 }, layer: "below",
      })),
    };
  }

  function draw(plot) {
    const source = data.get(menu.value + "/" + plot.dataset.joint);
    if (plot.dataset.run === menu.value || !source) return;
    plot.dataset.run = menu.value;
    const figure = JSON.parse(source.textContent);
    const caption = plot.parentElement.querySelector(".caption");
    caption.textContent = figure.caption + (figure.covered ? " · " : "");
    const covered = document.createElement("span");
    covered.className = figure.few ? "few" : "";
    covered.textContent = figure.covered;
    caption.append(covered);
    Plotly.react(plot, themed([...areas(figure), ...lines(figure)]), themed(layout(figure)), CONFIG);
  }

  // Those in sight at once, the others one by one while the page stays responsive.
  function drawAll() {
    const height = window.innerHeight;
    const away = (plot) => {
      const box = plot.getBoundingClientRect();
      return Math.max(box.top - height, -box.bottom, 0);
    };
    const queue = plots.slice().sort((a, b) => away(a) - away(b));
    const next = () => {
      do {
        if (!queue.length) return;
        draw(queue.shift());
      } while (queue.length && away(queue[0]) === 0);
      setTimeout(next, 0);
    };
    next();
  }

  function drawAgain() {
    plots.forEach((plot) => { delete plot.dataset.run; });
    drawAll();
  }

  menu.addEventListener("change", drawAll);
  if (bands) bands.addEventListener("change", drawAgain);
  window.addEventListener("theme", drawAgain);
  window.addEventListener("beforeprint", () => plots.forEach(draw));
  drawAll();
}

// Numbers of an array as `packed` wrote them, in single precision.
function unpacked(array) {
  return new Float32Array(Uint8Array.from(atob(array.bdata), (one) => one.charCodeAt(0)).buffer);
}

// The controls of a replay below a picture in space. Returns what draws it at the time that is set.
function replayed(picture, frames) {
  const controls = picture.nextElementSibling.nextElementSibling;
  const [button, slider, time] = controls.children;
  const t = unpacked(frames.t), all = frames.points.map(unpacked);
  let before = null;

  // Between two frames points are on straight lines.
  function show() {
    const now = Number(slider.value);
    let k = 0;
    while (k < t.length - 2 && t[k + 1] <= now) k += 1;
    const share = t.length > 1 ? (now - t[k]) / (t[k + 1] - t[k]) : 0;
    const along = (axis) => all.map((points) => {
      const size = points.length / t.length, found = [];
      for (let p = k * size + axis; p < (k + 1) * size; p += 3) {
        const next = t.length > 1 ? points[p + size] : points[p];
        found.push((1 - share) * points[p] + share * next);
      }
      return found;
    });
    time.textContent = `${now.toFixed(1)} s`;
    Plotly.restyle(picture, { x: along(0), y: along(1), z: along(2) }, all.map((_, k) => k));
  }

  function step(stamp) {
    if (before === null) return;
    const last = Number(slider.max), now = Number(slider.value) + (stamp - before) / 1000;
    slider.value = now > last ? 0 : now;
    before = stamp;
    show();
    requestAnimationFrame(step);
  }

  function play(on) {
    button.textContent = on ? "Pause" : "Play";
    before = on ? performance.now() : null;
    if (on) requestAnimationFrame(step);
  }

  button.addEventListener("click", () => play(before === null));
  slider.addEventListener("input", () => { play(false); show(); });
  controls.hidden = false;
  return show;
}

// Pictures of sections; one in a closed part of the page is drawn when that is opened.
function drawPictures() {
  const colours = ["--blue", "--vermillion", "--green", "--purple", "--amber", "--arm"];
  const replays = new Map();

  function trace(one, k) {
    const tint = colours[k % colours.length];
    const common = { name: one.name, x: one.x, y: one.y };
    if (one.kind === "bars") return { ...common, type: "bar", marker: { color: tint } };
    const points = one.kind === "points";
    return {
      ...common, type: "scatter", mode: points ? "markers" : "lines", connectgaps: false,
      marker: { color: tint, size: 5 }, line: { color: tint, width: 1.6 }, ...one.more,
    };
  }

  function layout(figure) {
    const own = figure.layout || {};
    const more = Object.fromEntries(Object.entries(own).map(([name, value]) => [
      name, /^[xy]axis\d/.test(name) ? { ...GRID, zeroline: false, ...value } : value,
    ]));
    return {
      ...basis(), bargap: 0.06,
      showlegend: figure.traces.length > 1, legend: { orientation: "h", y: 1.02, yanchor: "bottom" },
      ...more,
      xaxis: { ...GRID, zeroline: false, title: { text: figure.x, standoff: 6 }, ...own.xaxis },
      yaxis: { ...GRID, title: { text: figure.y, standoff: 4 }, ...own.yaxis },
    };
  }

  function draw(picture) {
    if (picture.dataset.drawn || picture.closest("details:not([open])")) return;
    picture.dataset.drawn = "yes";
    const figure = JSON.parse(picture.nextElementSibling.textContent);
    Plotly.react(picture, themed(figure.traces.map(trace)), themed(layout(figure)), CONFIG);
    if (!figure.frames) return;
    if (!replays.has(picture)) replays.set(picture, replayed(picture, figure.frames));
    replays.get(picture)();
  }

  const drawAll = () => document.querySelectorAll(".picture").forEach(draw);
  // one after the other, so that a click between two of them is answered
  const drawInTurn = () => document.querySelectorAll(".picture:not([data-drawn])").forEach(
    (one) => setTimeout(() => { if (one.isConnected) draw(one); }, 0),
  );
  document.addEventListener("toggle", drawAll, true);
  window.addEventListener("content", drawInTurn);
  window.addEventListener("theme", () => {
    document.querySelectorAll(".picture").forEach((one) => { delete one.dataset.drawn; });
    drawAll();
  });
  drawAll();
}

const PAPER = 680;  // Width of a page of A4 or Letter between the margins of the style sheet [px].

// Figures on paper are as wide as it: a browser that prints tells no figure its new width.
function fitToPaper() {
  const relayout = (change) => document.querySelectorAll(".js-plotly-plot").forEach((one) => {
    Plotly.relayout(one, change(one));
  });
  const width = (one) => (one.closest(".plots.three") ? 0.32 * PAPER : PAPER);
  window.addEventListener("beforeprint", () => relayout((one) => ({ width: width(one) })));
  window.addEventListener("afterprint", () => relayout(() => ({ width: null, autosize: true })));
}

// What gzip has compressed [RFC 1951, RFC 1952], without optional parts of its head. At once, not in
// the background: paper and pictures of the page do not wait for what comes after it is loaded.
function unzipped(archive) {
  const data = Uint8Array.from(atob(archive), (one) => one.charCodeAt(0));
  const out = new Uint8Array(new DataView(data.buffer).getUint32(data.length - 4, true));
  const ORDER = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
  let at = 80, size = 0;

  function bits(count) {
    let value = 0;
    for (let k = 0; k < count; k += 1, at += 1) value |= ((data[at >> 3] >> (at & 7)) & 1) << k;
    return value;
  }

  // A prefix code: how many symbols have a code of each length, and the symbols in order.
  function codeOf(lengths) {
    const counts = new Uint16Array(16), symbols = [];
    for (let length = 1; length < 16; length += 1) {
      lengths.forEach((own, symbol) => { if (own === length) symbols.push(symbol); });
      counts[length] = symbols.length;
    }
    for (let length = 15; length > 0; length -= 1) counts[length] -= counts[length - 1];
    return { counts, symbols };
  }

  function symbolOf({ counts, symbols }) {
    let code = 0, index = 0;
    for (let length = 1; length < 16; length += 1) {
      code |= (data[at >> 3] >> (at & 7)) & 1;
      at += 1;
      if (code < counts[length]) return symbols[index + code];
      index += counts[length];
      code = (code - counts[length]) << 1;
    }
    throw new Error("the archive of plotly.js in this page is damaged");
  }

  // Lengths of a code, themselves compressed: 16 repeats the last one, 17 and 18 are many zeros.
  function lengthsOf(count, code) {
    const lengths = [];
    while (lengths.length < count) {
      const symbol = symbolOf(code);
      if (symbol < 16) lengths.push(symbol);
      else {
        const [times, value] = symbol === 16 ? [3 + bits(2), lengths[lengths.length - 1]]
          : [symbol === 17 ? 3 + bits(3) : 11 + bits(7), 0];
        for (let k = 0; k < times; k += 1) lengths.push(value);
      }
    }
    return lengths;
  }

  function codes(kind) {
    if (kind === 1) {
      const fixed = Array.from({ length: 288 }, (_, k) => (k < 144 ? 8 : k < 256 ? 9 : k < 280 ? 7 : 8));
      return [codeOf(fixed), codeOf(Array(30).fill(5))];
    }
    const literals = 257 + bits(5), distances = 1 + bits(5), own = Array(19).fill(0);
    const known = 4 + bits(4);
    for (let k = 0; k < known; k += 1) own[ORDER[k]] = bits(3);
    const lengths = lengthsOf(literals + distances, codeOf(own));
    return [codeOf(lengths.slice(0, literals)), codeOf(lengths.slice(literals))];
  }

  // The k-th range of lengths (`per` 4) or distances (`per` 2), which begins at 0, and a place in it.
  function inRange(k, per) {
    const extra = Math.max(Math.floor(k / per) - 1, 0);
    return (k < per ? k : (per + (k % per)) << extra) + bits(extra);
  }

  function expand([literals, distances]) {
    for (let symbol = symbolOf(literals); symbol !== 256; symbol = symbolOf(literals)) {
      if (symbol < 256) out[size++] = symbol;
      else {
        const length = symbol === 285 ? 258 : 3 + inRange(symbol - 257, 4);
        const from = size - 1 - inRange(symbolOf(distances), 2);
        for (let k = 0; k < length; k += 1) out[size++] = out[from + k];
      }
    }
  }

  for (let last = 0; !last;) {
    last = bits(1);
    const kind = bits(2);
    if (kind) expand(codes(kind));
    else {
      const from = ((at + 7) >> 3) + 4, length = data[from - 4] | (data[from - 3] << 8);
      out.set(data.subarray(from, from + length), size);
      size += length;
      at = 8 * (from + length);
    }
  }
  return new TextDecoder().decode(out);
}

function drawFigures() {
  const archive = document.getElementById("plotly");
  if (archive) {
    const script = document.createElement("script");
    script.textContent = unzipped(archive.textContent);
    document.head.append(script);
  }
  if (!window.Plotly) return;
  drawPlots();
  drawPictures();
  fitToPaper();
}

chooseTheme();
document.querySelectorAll("main table").forEach(makeSortable);
window.addEventListener("hashchange", openTarget);
openTarget();
drawFigures();
