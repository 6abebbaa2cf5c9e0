"use strict";
// What goes wrong in this page is written into it, so that a look at the page shows it.
window.addEventListener("error", (event) => {
  document.body.dataset.errors = (document.body.dataset.errors || "") + event.message + "\n";
});
window.addEventListener("beforeprint", () => {
  document.querySelectorAll("details").forEach((one) => { one.open = true; });
});

function drawPlots() {
  const data = new Map();
  document.querySelectorAll("script.effort-data").forEach((one) => {
    data.set(one.dataset.run + "/" + one.dataset.joint, one);
  });
  const plots = [...document.querySelectorAll(".plot")];
  const menu = document.getElementById("effort-run");
  if (!menu) return;
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue("--" + name).trim();
  const names = ["measured", "predicted", "residual"];
  const font = getComputedStyle(document.body).fontFamily;
  const grid = { gridcolor: "#eceff2", zerolinecolor: "#cfd5dc", automargin: true };

  const bands = document.getElementById("effort-bands");
  const shades = ["band", "surely", "band"];

  function areas(figure) {
    if (bands && !bands.checked) return [];
    return figure.bands.map((area, k) => ({
      type: "scatter", mode: "none", x: area.x, y: area.y, yaxis: k === 2 ? "y2" : "y", fill: "toself",
      fillcolor: colour(shades[k]), hoverinfo: "skip", connectgaps: false,
    }));
  }

  function lines(figure) {
    return figure.lines.map((line, k) => ({
      type: "scatter", mode: "lines", name: names[k], x: line.x, y: line.y,
      yaxis: k === 2 ? "y2" : "y", connectgaps: false,
      line: { color: colour(names[k]), width: k === 0 ? 3.2 : 1.2 },
    }));
  }

  function layout(figure) {
    return {
      showlegend: false, hovermode: "x unified", dragmode: touch ? false : "zoom",
      margin: { l: 58, r: 8, t: 8, b: 40 }, autosize: true,
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: font, size: 12, color: colour("soft") },
      xaxis: { ...grid, anchor: "y2", zeroline: false, title: { text: figure.time, standoff: 6 } },
      yaxis: { ...grid, domain: [0.38, 1], title: { text: figure.unit, standoff: 4 } },
      yaxis2: { ...grid, domain: [0, 0.28], nticks: 4 },
      shapes: figure.rests.map(([from, to]) => ({
        type: "rect", xref: "x", yref: "paper", x0: from, x1: to, y0: 0, y1: 1,
        fillcolor: colour("rest"), line: { width: 0 }, layer: "below",
      })),
    };
  }

  const config = {
    responsive: true, displayModeBar: false,
  };

  function draw(plot) {
    const source = data.get(menu.value + "/" + plot.dataset.joint);
    if (plot.dataset.run === menu.value || !source) return;
    plot.dataset.run = menu.value;
    const figure = JSON.parse(source.textContent);
    const caption = plot.parentElement.querySelector(".caption");
    caption.textContent = figure.caption + (figure.held ? " · " : "");
    const held = document.createElement("span");
    held.className = figure.few ? "few" : "";
    held.textContent = figure.held;
    caption.append(held);
    Plotly.react(plot, [...areas(figure), ...lines(figure)], layout(figure), config);
  }

  // Those in sight first, the others one by one while the page stays responsive.
  function drawAll() {
    const height = window.innerHeight;
    const away = (plot) => {
      const box = plot.getBoundingClientRect();
      return Math.max(box.top - height, -box.bottom, 0);
    };
    const queue = plots.slice().sort((a, b) => away(a) - away(b));
    const next = () => {
      const plot = queue.shift();
      if (!plot) return;
      draw(plot);
      setTimeout(next, 0);
    };
    next();
  }

  menu.addEventListener("change", drawAll);
  if (bands) {
    bands.addEventListener("change", () => {
      plots.forEach((plot) => { delete plot.dataset.run; });
      drawAll();
    });
  }
  window.addEventListener("beforeprint", () => {
    plots.forEach((plot) => { draw(plot); Plotly.relayout(plot, { width: 660, height: 250 }); });
  });
  window.addEventListener("afterprint", () => {
    plots.forEach((plot) => Plotly.relayout(plot, { width: null, height: null, autosize: true }));
  });
  drawAll();
}

// Pictures of findings; one in a closed part of the page is drawn when that is opened.
function drawPictures() {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue("--" + name).trim();
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const colours = ["predicted", "residual", "good", "measured", "poor", "fair"].map(colour);
  const grid = { gridcolor: "#eceff2", zerolinecolor: "#cfd5dc", automargin: true };

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
      name, /^[xy]axis\d/.test(name) ? { ...grid, zeroline: false, ...value } : value,
    ]));
    return {
      showlegend: figure.traces.length > 1, legend: { orientation: "h", y: 1.02, yanchor: "bottom" },
      dragmode: touch ? false : "zoom", margin: { l: 58, r: 8, t: 8, b: 40 }, autosize: true,
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", bargap: 0.06,
      font: {
        family: getComputedStyle(document.body).fontFamily, size: 12, color: colour("soft"),
      },
      ...more,
      xaxis: { ...grid, zeroline: false, title: { text: figure.x, standoff: 6 }, ...own.xaxis },
      yaxis: { ...grid, title: { text: figure.y, standoff: 4 }, ...own.yaxis },
    };
  }

  function draw(picture) {
    if (picture.dataset.drawn || picture.closest("details:not([open])")) return;
    picture.dataset.drawn = "yes";
    const figure = JSON.parse(picture.nextElementSibling.textContent);
    const config = { responsive: true, displayModeBar: false };
    Plotly.react(picture, figure.traces.map(trace), layout(figure), config);
  }

  const drawAll = () => document.querySelectorAll(".picture").forEach(draw);
  document.querySelectorAll("details").forEach((one) => one.addEventListener("toggle", drawAll));
  window.addEventListener("beforeprint", drawAll);
  drawAll();
}
