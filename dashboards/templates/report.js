/* Charts that zoom together: every drawing with numbers beside it becomes a uPlot chart; without scripts the drawing stays. */
"use strict";
(() => {
  const given = JSON.parse(document.getElementById("plots").textContent);
  const figures = [...document.querySelectorAll("figure[data-plot]")];
  if (!figures.length || !window.uPlot) return;
  const COVERAGE = 2; // standard uncertainties of the band, as in the drawings
  const DAY = 86400;
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const two = (number) => String(number).padStart(2, "0");
  const utc = (seconds) => new Date(seconds * 1000);
  const day = (at) => `${two(at.getUTCMonth() + 1)}-${two(at.getUTCDate())}`;
  const clock = (at) => `${two(at.getUTCHours())}:${two(at.getUTCMinutes())}`;
  const moment = (seconds) => `${utc(seconds).getUTCFullYear()}-${day(utc(seconds))} ${clock(utc(seconds))} UTC`;
  const short = (number) => Number(number.toPrecision(5)).toString().replace("-", "\u2212");

  const ends = given.times.flatMap((times) => [times[0], times[times.length - 1]]);
  const first = Math.min(...ends), last = Math.max(...ends);
  const margin = Math.max((last - first) / 50, 1);
  const everything = [first - margin, last + margin];
  let shown = everything;
  let charts = [];
  let busy = false;

  const show = (low, high) => {
    const width = Math.min(Math.max(high - low, 1), everything[1] - everything[0]);
    const start = Math.min(Math.max(low, everything[0]), everything[1] - width);
    shown = [start, start + width];
    busy = true;
    for (const chart of charts) chart.setScale("x", { min: shown[0], max: shown[1] });
    busy = false;
  };

  const marks = (chart, splits, axis, space, step) =>
    splits.map((at) => {
      const date = utc(at);
      if (step >= 28 * DAY) return `${date.getUTCFullYear()}-${two(date.getUTCMonth() + 1)}`;
      if (step >= DAY || clock(date) + date.getUTCSeconds() === "00:000") return day(date);
      return step >= 60 ? clock(date) : `${clock(date)}:${two(date.getUTCSeconds())}`;
    });

  const reach = (lines) => (chart, low, high) => {
    if (low === null) return [0, 1];
    if (high - low < 1e-12 * Math.max(Math.abs(low), Math.abs(high))) {
      low -= 0.1 * (Math.abs(low) || 1);
      high += 0.1 * (Math.abs(high) || 1);
    }
    let wide = [low, high];
    for (const [, , value] of lines) {
      const stretched = [Math.min(wide[0], value), Math.max(wide[1], value)];
      if (stretched[1] - stretched[0] <= 3 * (high - low)) wide = stretched;
    }
    const edge = 0.04 * (wide[1] - wide[0]);
    return [wide[0] - edge, wide[1] + edge];
  };

  const extras = (plot) => (chart) => {
    const pen = chart.ctx, box = chart.bbox, ratio = devicePixelRatio || 1;
    pen.save();
    pen.font = `${11 * ratio}px system-ui, sans-serif`;
    pen.textBaseline = "alphabetic";
    pen.lineWidth = 1.4 * ratio;
    const known = plot.values.filter((value) => value !== null);
    for (const [grade, side, value] of plot.lines) {
      const y = chart.valToPos(value, "y", true);
      if (y < box.top || y > box.top + box.height) continue;
      pen.strokeStyle = pen.fillStyle = colour(grade === "alarm" ? "--red" : "--amber");
      pen.setLineDash([6 * ratio, 4 * ratio]);
      pen.beginPath();
      pen.moveTo(box.left, y);
      pen.lineTo(box.left + box.width, y);
      pen.stroke();
      // its name at the end that lies farther from the line
      const right = Math.abs(known[known.length - 1] - value) > Math.abs(known[0] - value);
      pen.textAlign = right ? "right" : "left";
      pen.fillText(`${grade} ${side} ${short(value)}`, box.left + (right ? box.width - 5 * ratio : 5 * ratio), y - 4 * ratio);
    }
    pen.setLineDash([]);
    pen.strokeStyle = colour("--red");
    pen.lineWidth = 1.8 * ratio;
    const foot = box.top + box.height - 4 * ratio, arm = 3.5 * ratio;
    for (const at of plot.lost) {
      const x = chart.valToPos(at, "x", true);
      if (x < box.left || x > box.left + box.width) continue;
      pen.beginPath();
      pen.moveTo(x - arm, foot - arm); pen.lineTo(x + arm, foot + arm);
      pen.moveTo(x + arm, foot - arm); pen.lineTo(x - arm, foot + arm);
      pen.stroke();
    }
    pen.restore();
  };

  const build = (figure) => {
    const plot = given.plots[Number(figure.dataset.plot)];
    const times = given.times[plot.at];
    const off = (sign) => plot.values.map((value, i) => (value === null ? null : value + sign * COVERAGE * plot.sigmas[i]));
    const box = figure.querySelector(".plot"), readout = figure.querySelector(".readout");
    box.replaceChildren();
    const axis = (more) => ({ stroke: colour("--soft"), grid: { stroke: colour("--grid"), width: 1 }, ticks: { show: false }, font: "12px system-ui, sans-serif", ...more });
    const edge = { stroke: "transparent", width: 0, points: { show: false } };
    const size = () => ({ width: Math.max(box.clientWidth, 200), height: 230 });
    const chart = new uPlot(
      {
        ...size(),
        tzDate: (at) => uPlot.tzDate(utc(at), "UTC"),
        legend: { show: false },
        cursor: { sync: { key: "time", scales: ["x", null] }, drag: { x: true, y: false }, y: false },
        scales: { x: { time: true, min: shown[0], max: shown[1] }, y: { range: reach(plot.lines) } },
        axes: [
          axis({ values: marks, space: 60, size: 28 }),
          axis({ label: plot.label, labelSize: 20, labelFont: "12px system-ui, sans-serif", size: 56, values: (c, splits) => splits.map(short) }),
        ],
        series: [{}, { stroke: colour("--line"), width: 2 }, edge, edge],
        bands: [{ series: [2, 3], fill: colour("--band") }],
        hooks: {
          draw: [extras(plot)],
          setScale: [(c, key) => { if (key === "x" && !busy && c.status) show(c.scales.x.min, c.scales.x.max); }],
          setCursor: [
            (c) => {
              const i = c.cursor.idx;
              const value = i === null || i === undefined ? null : plot.values[i];
              readout.textContent = value === null || value === undefined ? "\u00a0"
                : `${moment(times[i])}: ${short(value)}${plot.sigmas[i] ? ` \u00b1 ${short(plot.sigmas[i])}` : ""}`;
            },
          ],
        },
      },
      [times, plot.values, off(1), off(-1)],
      box,
    );
    chart.over.ondblclick = () => show(...everything);
    new ResizeObserver(() => chart.setSize(size())).observe(box);
    return chart;
  };

  const tools = () => {
    const bar = document.createElement("div");
    bar.className = "zoom";
    bar.setAttribute("role", "group");
    bar.setAttribute("aria-label", "Part of the record that all charts show");
    const button = (text, does) => {
      const made = document.createElement("button");
      made.type = "button";
      made.textContent = text;
      made.onclick = does;
      bar.append(made);
    };
    button("All", () => show(...everything));
    for (const [text, days] of [["Last 90 d", 90], ["Last 30 d", 30], ["Last 7 d", 7], ["Last day", 1], ["Last hour", 1 / 24]])
      if (days * DAY < 0.9 * (last - first) && (days >= 1 || last - first < 3 * DAY))
        button(text, () => show(last - days * DAY, last + 0.02 * days * DAY));
    const width = () => shown[1] - shown[0];
    button("Closer", () => show(shown[0] + width() / 4, shown[1] - width() / 4));
    button("Wider", () => show(shown[0] - width() / 2, shown[1] + width() / 2));
    button("Earlier", () => show(shown[0] - width() / 2, shown[1] - width() / 2));
    button("Later", () => show(shown[0] + width() / 2, shown[1] + width() / 2));
    const hint = document.createElement("span");
    hint.textContent = "Drag across a chart to zoom all of them; a double click shows everything.";
    bar.append(hint);
    return bar;
  };

  for (const figure of figures) {
    const box = document.createElement("div");
    box.className = "plot";
    box.setAttribute("role", "img");
    box.setAttribute("aria-label", figure.querySelector("svg").getAttribute("aria-label"));
    const readout = document.createElement("p");
    readout.className = "readout";
    readout.setAttribute("aria-hidden", "true");
    readout.textContent = "\u00a0";
    figure.prepend(box, readout);
    figure.classList.add("live");
  }
  const draw = () => { charts.forEach((chart) => chart.destroy()); charts = figures.map(build); show(...shown); };
  draw();
  figures[0].parentElement.before(tools());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
})();
