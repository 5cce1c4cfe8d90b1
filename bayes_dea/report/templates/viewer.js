// Fills one Bokeh layout per recording: every sample where few enough are in view, minimum, mean and maximum otherwise.
(() => {
"use strict";
const MOST_DOTS = 3000, MOST_BARS = 700, MOST_OPEN = 8;
const byId = (id) => document.getElementById(id);
const viewers = [], byRange = new Map();
let queue = Promise.resolve();

async function decode(settings, text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const raw = new Uint8Array(await new Response(stream).arrayBuffer());
  const out = {};
  let at = 0;
  for (const c of settings.columns) {
    const values = new Float64Array(c.n);
    for (let k = 0, rank = 1; k < c.bytes; k++, rank *= 256)
      for (let i = 0; i < c.n; i++) values[i] += rank * raw[at++];
    let sum = 0;
    for (let i = 0; i < c.n; i++) {
      let q = values[i];
      if (c.delta) q = sum += q % 2 ? -(q + 1) / 2 : q / 2;
      values[i] = q > 0 ? c.offset + (q - 1) * c.step : NaN;
    }
    out[c.name] = values;
  }
  return out;
}

function scaled(d, s) {
  for (const name of Object.keys(d)) {
    const f = /^._u/.test(name) ? s.inputFactor : /^(s_(y|p|sd)$|b_(y|r|p|sd))/.test(name) ? s.factor : 1;
    if (f !== 1) for (let i = 0; i < d[name].length; i++) d[name][i] /= f;
  }
  d.first = new Int32Array(d.b_t0.length + 1);  // of each bin: its first sample among those kept
  for (let k = 0, i = 0; k < d.b_t0.length; k++) {
    d.first[k] = i;
    if (d.b_kept[k] > 0.5) while (i < d.s_t.length && d.s_t[i] <= d.b_t1[k] + 0.25 * s.step) i++;
    d.first[k + 1] = i;
  }
  return d;
}

const low = (a, b) => (b < a || a !== a ? b : a), high = (a, b) => (b > a || a !== a ? b : a);

function firstBeyond(array, value) {
  let a = 0, b = array.length;
  while (a < b) { const m = (a + b) >> 1; if (array[m] < value) a = m + 1; else b = m; }
  return a;
}

function superscript(n) {
  return String(n).replace(/[-0-9]/g, (c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(c)]);
}

class Viewer {
  constructor(box) {
    this.box = box;
    this.target = box.querySelector(".plot");
    this.said = box.querySelector(".said");
    this.settings = JSON.parse(box.querySelector("script.settings").textContent);
    this.store = box.querySelector("script.data");
    this.log = false;
    this.wanted = null;
    this.used = 0;
    this.buttons();
  }

  buttons() {
    const s = this.settings;
    const does = {
      whole: () => this.show(false, ...this.whole()),
      before: () => this.edge(-1),
      after: () => this.edge(1),
      hold: () => (this.log ? this.show(false, ...this.whole()) : this.show(true, ...this.held())),
      larger: () => this.resize(),
    };
    for (const b of this.box.querySelectorAll("button[data-do]")) {
      const name = b.dataset.do;
      if ((name === "before" || name === "after") && !s.edges.length || name === "hold" && s.hold === null) b.hidden = true;
      b.addEventListener("click", () => { does[name](); this.open(); });
    }
  }

  open() {
    this.used = performance.now();
    if (!this.opening) this.opening = queue = queue.then(() => this.embed()).catch(giveUp);
    return this.opening;
  }

  async embed() {
    if (!this.data) {
      this.data = scaled(await decode(this.settings, this.store.textContent), this.settings);
      this.store.remove();
    }
    const known = new Set(Bokeh.documents);
    await Bokeh.embed.embed_item(JSON.parse(byId("viewer-layout").textContent), this.target.id);
    this.document = Bokeh.documents.find((d) => !known.has(d));
    const model = (name) => this.document.get_model_by_name(name);
    this.range = model("x_range");
    this.plots = ["main", "residual", "input"].map(model);
    this.sources = {};
    for (const name of ["bars", "dots", "curve"]) this.sources[name] = model(name);
    byRange.set(this.range, this);
    const s = this.settings, unit = (u) => (u ? ` / ${u}` : "");
    const [main, residual, input] = this.plots;
    main.left[0].axis_label = s.channel + unit(s.unit);
    residual.left[0].axis_label = "residual" + unit(s.unit);
    input.left[0].axis_label = s.input + unit(s.inputUnit);
    this.axes = this.plots.map((p) => p.below[0]);
    this.linear = this.axes.map((a) => [a.ticker, a.formatter]);
    const wanted = this.wanted || [false, ...this.whole()];
    if (this.big) this.heights();
    this.show(...wanted);
    for (const p of this.plots) p.on_event("doubletap", () => this.show(false, ...this.whole()));
    this.redraw();
    closeOldest(this);
  }

  close() {
    if (!this.document) return;
    byRange.delete(this.range);
    this.document.clear();
    const i = Bokeh.documents.indexOf(this.document);
    if (i >= 0) Bokeh.documents.splice(i, 1);
    this.target.replaceChildren();
    this.document = this.opening = null;
  }

  whole() {
    const d = this.data, from = d.b_t0[0], to = d.b_t1[d.b_t1.length - 1], pad = 0.01 * (to - from);
    return [from - pad, to + pad];
  }

  held() {
    const s = this.settings, end = this.data.b_t1[this.data.b_t1.length - 1];
    return [Math.log10(s.step) - 0.1, Math.log10(end - s.hold) + 0.05];
  }

  edge(direction) {
    if (!this.document) return;
    const e = this.settings.edges, step = this.settings.step, from = this.range.start, to = this.range.end;
    const zoomed = !this.log && this.near !== undefined && e[this.near] > from && e[this.near] < to && to - from < 4.5;
    let k = zoomed ? this.near + direction : direction > 0 ? 0 : e.length - 1;
    k = (k + e.length) % e.length;
    this.near = k;
    const gap = Math.min(k > 0 ? e[k] - e[k - 1] : Infinity, k + 1 < e.length ? e[k + 1] - e[k] : Infinity);
    const width = Math.max(40 * step, Math.min(400 * step, 2.4, 1.6 * gap));
    this.show(false, e[k] - 0.2 * width, e[k] + 0.8 * width);
  }

  show(log, from, to) {
    this.wanted = [log, from, to];
    if (!this.document) return;
    const turned = log !== this.log;
    this.log = log;
    this.box.querySelector("[data-do=hold]").setAttribute("aria-pressed", log);
    const bounds = log ? this.held() : this.whole();
    this.range.setv({bounds: null});
    this.range.setv({start: from, end: to, reset_start: bounds[0], reset_end: bounds[1]});
    this.range.setv({bounds, min_interval: log ? 0.02 : 8 * this.settings.step});
    const label = log ? `time since the edge at ${+this.settings.hold.toPrecision(6)} s / s (logarithmic)` : "time / s";
    this.axes.forEach((axis, i) => {
      if (!log) axis.setv({ticker: this.linear[i][0], formatter: this.linear[i][1]});
      if (i === 2) axis.axis_label = label;
    });
    if (turned) this.redraw();
  }

  resize() {
    this.big = !this.big;
    this.box.querySelector("[data-do=larger]").textContent = this.big ? "Smaller" : "Larger";
    this.box.closest("article").classList.toggle("large", this.big);
    if (this.document) this.heights();
  }

  heights() {
    const base = this.base || (this.base = this.plots.map((p) => p.height));
    this.plots.forEach((p, i) => { p.height = Math.round(base[i] * (this.big ? 1.6 : 1)); });
  }

  // both ends of the range have moved by then, and what is painted in this frame has its data already
  later() {
    if (this.due) return;
    this.due = true;
    queueMicrotask(() => { this.due = false; if (this.document) this.redraw(); });
  }

  // One pass over the bins in view: their samples where these are kept and few enough, else bars of several bins.
  redraw() {
    const d = this.data, s = this.settings, z = s.z, log = this.log;
    const from = this.range.start, to = this.range.end;
    this.wanted = [log, from, to];
    const at = log ? (t) => Math.log10(Math.max(t - s.hold, 0.5 * s.step)) : (t) => t;
    const back = log ? (x) => s.hold + Math.pow(10, x) : (x) => x;
    const t0 = Math.max(back(from), log ? s.hold : -Infinity), t1 = back(to), last = d.b_t0.length - 1;
    const a = Math.max(0, firstBeyond(d.b_t1, t0) - 1), b = Math.min(last, firstBeyond(d.b_t0, t1));
    const fine = d.first[b + 1] - d.first[a] <= MOST_DOTS && d.first[b + 1] > d.first[a];
    // on logarithmic time the rise itself would take all of the height
    const seen = log ? Math.max(from, Math.log10(4 * s.step)) : from;
    const thin = (to - from) / MOST_BARS;
    const bars = {left: [], right: [], middle: [], y_min: [], y_max: [], y_mean: [], r_min: [], r_max: [], r_mean: [], u_min: [], u_max: []};
    const dots = {x: [], t: [], y: [], p: [], r: []};
    const curve = {x: [], p: [], p_min: [], p_max: [], low50: [], high50: [], low90: [], high90: [], r50: [], r90: [], R50: [], R90: [], u: []};
    let yLow = NaN, yHigh = NaN, rHigh = 0, uLow = NaN, uHigh = NaN, widest = 0;
    const push = (x, p, pMin, pMax, sd, u) => {
      curve.x.push(x); curve.p.push(p); curve.p_min.push(pMin); curve.p_max.push(pMax); curve.u.push(u);
      curve.low50.push(pMin - z[0] * sd); curve.high50.push(pMax + z[0] * sd);
      curve.low90.push(pMin - z[1] * sd); curve.high90.push(pMax + z[1] * sd);
      curve.r50.push(-z[0] * sd); curve.R50.push(z[0] * sd); curve.r90.push(-z[1] * sd); curve.R90.push(z[1] * sd);
      if (x < seen || x > to) return;
      yLow = low(yLow, pMin - 2 * sd); yHigh = high(yHigh, pMax + 2 * sd);
      uLow = low(uLow, u); uHigh = high(uHigh, u);
      rHigh = high(rHigh, 2.2 * sd);
    };
    for (let k = a; k <= b;) {
      if (fine && d.b_kept[k] > 0.5) {
        for (let i = d.first[k]; i < d.first[k + 1]; i++) {
          const t = d.s_t[i];
          if (log && t <= s.hold) continue;
          const x = at(t), y = d.s_y[i], p = d.s_p[i], r = y - p;
          push(x, p, p, p, d.s_sd[i], d.s_u[i]);
          if (y === y) {
            dots.x.push(x); dots.t.push(t); dots.y.push(y); dots.p.push(p); dots.r.push(r);
            if (x >= seen && x <= to) { yLow = low(yLow, y); yHigh = high(yHigh, y); rHigh = high(rHigh, Math.abs(r)); }
          }
        }
        k++;
        continue;
      }
      if (log && d.b_t1[k] <= s.hold + 0.5 * s.step) { k++; continue; }
      const left = at(d.b_t0[k] - s.step), start = k;
      let right = left, n = 0, ySum = 0, rSum = 0, pSum = 0, sdSum = 0, uSum = 0, rows = 0;
      let yMin = NaN, yMax = NaN, rMin = NaN, rMax = NaN, pMin = NaN, pMax = NaN, uMin = NaN, uMax = NaN;
      do {
        const m = d.b_n[k];
        if (m > 0.5) { n += m; ySum += m * d.b_y_mean[k]; rSum += m * d.b_r_mean[k]; }
        if (d.b_p_mean[k] === d.b_p_mean[k]) { rows++; pSum += d.b_p_mean[k]; sdSum += d.b_sd[k]; uSum += d.b_u_mean[k]; }
        yMin = low(yMin, d.b_y_min[k]); yMax = high(yMax, d.b_y_max[k]);
        rMin = low(rMin, d.b_r_min[k]); rMax = high(rMax, d.b_r_max[k]);
        pMin = low(pMin, d.b_p_min[k]); pMax = high(pMax, d.b_p_max[k]);
        uMin = low(uMin, d.b_u_min[k]); uMax = high(uMax, d.b_u_max[k]);
        right = at(d.b_t1[k]);
        k++;
      } while (k <= b && right - left < thin && !(fine && d.b_kept[k] > 0.5));
      widest = Math.max(widest, k - start);
      const x = (left + right) / 2;
      push(x, pSum / rows, pMin, pMax, sdSum / rows, uSum / rows);
      const shown = right >= seen && left <= to;
      if (shown) { uLow = low(uLow, uMin); uHigh = high(uHigh, uMax); }
      if (n) {
        bars.left.push(left); bars.right.push(right); bars.middle.push(x);
        bars.y_min.push(yMin); bars.y_max.push(yMax); bars.y_mean.push(ySum / n);
        bars.r_min.push(rMin); bars.r_max.push(rMax); bars.r_mean.push(rSum / n);
        bars.u_min.push(uMin); bars.u_max.push(uMax);
        if (!shown) continue;
        yLow = low(yLow, yMin); yHigh = high(yHigh, yMax);
        rHigh = high(rHigh, Math.max(Math.abs(rMin), Math.abs(rMax)));
      }
    }
    this.sources.bars.data = bars;
    this.sources.dots.data = dots;
    this.sources.curve.data = curve;
    const fit = (plot, from, to) => {
      const pad = 0.04 * (to - from) || Math.abs(to) || 1;
      if (from === from && to === to) plot.y_range.setv({start: from - pad, end: to + pad});
    };
    fit(this.plots[0], yLow, yHigh);
    fit(this.plots[1], -rHigh, rHigh);
    fit(this.plots[2], uLow, uHigh);
    if (log) this.logTicks(from, to);
    this.tell(dots.x.length, bars.left.length, widest * s.rows);
  }

  logTicks(from, to) {
    const few = to - from < 2.2, ticks = [], labels = new Map();
    for (let e = Math.floor(from); e <= to; e++)
      for (const m of few ? [1, 2, 5] : [1]) {
        const x = e + Math.log10(m);
        if (x < from || x > to) continue;
        ticks.push(x);
        labels.set(x, e >= -3 && e < 5 ? String(+(m * Math.pow(10, e)).toPrecision(3)) : (m > 1 ? m + "·" : "") + "10" + superscript(e));
      }
    const Fixed = Bokeh.Models.get("FixedTicker");
    for (const axis of this.axes) {
      axis.ticker = new Fixed({ticks});
      axis.major_label_overrides = labels;
    }
  }

  tell(dots, bars, rows) {
    const n = (x) => String(x).replace(/\B(?=(\d{3})+$)/g, " "), words = [];
    const ms = rows * this.settings.step;
    if (dots) words.push(`every sample (${n(dots)})`);
    if (bars && rows > 1) words.push(`minimum, mean and maximum of up to ${n(rows)} samples (${+ms.toPrecision(2)} s)`);
    else if (bars) words.push(`every sample (${n(bars)})`);
    this.said.textContent = words.length ? "Shown: " + words.join("; elsewhere ") + "." : "Nothing was measured here.";
  }
}

function closeOldest(kept) {
  const open = viewers.filter((v) => v.document && v !== kept).sort((a, b) => a.used - b.used);
  while (open.length >= MOST_OPEN) open.shift().close();
}

function giveUp(error) {  // the pictures of the page without scripts are still there
  document.documentElement.classList.remove("live");
  console.error(error);
}

window.bayesDeaRedraw = (range) => { const v = byRange.get(range); if (v) v.later(); };
window.bayesDeaViewers = viewers;

function begin() {
  if (!window.Bokeh || !window.DecompressionStream || !window.IntersectionObserver) return;
  document.documentElement.classList.add("live");
  const watch = new IntersectionObserver((seen) => {
    for (const e of seen) if (e.isIntersecting) viewers.find((v) => v.box === e.target).open();
  }, {rootMargin: "500px"});
  for (const box of document.querySelectorAll(".viewer")) {
    const v = new Viewer(box);
    viewers.push(v);
    watch.observe(box);
  }
}
begin();
})();
