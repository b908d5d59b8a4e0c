"use strict";
// Heat maps: their colours, the border of what they hold for, slices of a third coordinate, and at the pointer the values
// of all maps of the same coordinates. A zoom of one is a zoom of all.
(() => {
  const GS = GoughStewart, { element, page, state } = GS;
  const FINE = 420, DECADES = 3;

  GS.HEAT_STOPS = ["#00204d", "#31446b", "#666970", "#958f78", "#cbba69", "#ffe945"];
  GS.heatColours = () => {
    const colour = GS.gradient(GS.HEAT_STOPS.map((hex, k, { length }) => [k / (length - 1), hex]));
    return Array.from({ length: 256 }, (_, k) => colour(k / 255));
  };
  // Colours of kinds: the first is the ground.
  GS.kindColours = (chart) => chart.map.classes.map((_, k) => GS.theme().kinds[k % GS.theme().kinds.length]);

  // The numbers of a map, slice by slice.
  class HeatMap {
    constructor(chart, { x, rows, all, inside }) {
      Object.assign(this, { chart, x, rows, inside, values: all[0].y, size: x.length * rows.length, isLog: chart.map?.scale === "log" });
      this.kinds = chart.map?.classes.length || 0;
      let low = Infinity, high = -Infinity;
      this.present = new Set();
      this.values.forEach((v, k) => {
        if (this.kinds) this.present.add(v);
        if (!Number.isFinite(v) || (inside && !(inside[k] > 0)) || (this.isLog && !(v > 0))) return;
        low = Math.min(low, v);
        high = Math.max(high, v);
      });
      if (low > high) [low, high] = [this.isLog ? 1 : 0, this.isLog ? 10 : 1];
      if (this.isLog) high = Math.max(Math.min(high, low * 10 ** DECADES), 1.01 * low);
      this.ends = [low, high];
      this.scaledEnds = this.ends.map((v) => (this.isLog ? Math.log10(v) : v));
    }

    // Off the scale, values are cut, since they would spoil the interpolation beside them.
    scaled(v) {
      const [low, high] = this.scaledEnds, span = high - low || 1, value = this.isLog ? Math.log10(v) : v;
      return Number.isNaN(value) ? high + span : Math.min(Math.max(value, low - span), high + span);
    }

    // A slice as an image; with a border it is finer than the grid, so that the border is not a staircase.
    image(slice) {
      const m = this.x.length, n = this.rows.length, from = slice * this.size;
      if (!this.inside) return { values: this.values.subarray(from, from + this.size), shape: [n, m] };
      const times = Math.max(1, Math.round(FINE / Math.max(m, n))), values = new Float64Array(m * n * times * times);
      const place = (p, count) => {
        const at = Math.min(Math.max((p + 0.5) / times - 0.5, 0), count - 1), low = Math.min(Math.floor(at), count - 2);
        return [low, at - low];
      };
      for (let q = 0; q < n * times; q++) {
        const [j, b] = place(q, n);
        for (let p = 0; p < m * times; p++) {
          const [i, a] = place(p, m), corner = [0, 1, m, m + 1].map((d) => from + j * m + i + d), share = [(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b];
          const mean = (of) => corner.reduce((sum, k, c) => sum + share[c] * of(k), 0), isIn = mean((k) => this.inside[k]) > 0;
          values[q * m * times + p] = this.kinds ? (isIn ? 0 : this.kindAt(corner, share)) : isIn ? mean((k) => this.scaled(this.values[k])) : NaN;
        }
      }
      return { values, shape: [n * times, m * times] };
    }

    // Beyond the border: the kind of the nearest corner that is beyond.
    kindAt(corner, share) {
      const order = [0, 1, 2, 3].sort((a, b) => share[b] - share[a]);
      return this.values[corner[order.find((c) => this.values[corner[c]] !== 0) ?? order[0]]];
    }

    // The border of a slice as segments with gaps between them, by linear interpolation on the edges of cells.
    border(slice) {
      const found = { x: [], y: [] }, m = this.x.length, from = slice * this.size, field = this.inside;
      for (let j = 0; field && j + 1 < this.rows.length; j++) {
        for (let i = 0; i + 1 < m; i++) {
          const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]], cut = [];
          corners.forEach(([p, q], c) => {
            const [r, s] = corners[(c + 1) % 4], one = field[from + q * m + p], other = field[from + s * m + r];
            if (one > 0 === other > 0) return;
            const share = one / (one - other);
            cut.push([this.x[p] + share * (this.x[r] - this.x[p]), this.rows[q] + share * (this.rows[s] - this.rows[q])]);
          });
          for (let c = 0; c + 1 < cut.length; c += 2) ["x", "y"].forEach((axis, k) => found[axis].push(cut[c][k], cut[c + 1][k], NaN));
        }
      }
      return found;
    }
  }

  // Adds image, border, marked point and colour bar to a Bokeh figure; returns what changes with slice and theme.
  GS.drawHeat = (chart, figure, data) => {
    const map = new HeatMap(chart, data), F = (field) => ({ field }), half = (values) => (values.length > 1 ? (values.at(-1) - values[0]) / (values.length - 1) / 2 : 0.5);
    const [dx, dy] = [half(data.x), half(data.rows)], [low, high] = map.scaledEnds, colours = GS.heatColours().map(GS.css);
    const mapper = map.kinds
      ? new Bokeh.LinearColorMapper({ palette: GS.kindColours(chart), low: -0.5, high: map.kinds - 0.5 })
      : new Bokeh.LinearColorMapper({ palette: colours, low, high, nan_color: "rgba(128,128,128,0.14)" });
    const source = new Bokeh.ColumnDataSource({ data: { image: [] } }), edges = new Bokeh.ColumnDataSource({ data: { x: [], y: [] } });
    figure.image({ image: F("image"), source, x: data.x[0] - dx, y: data.rows[0] - dy, dw: data.x.at(-1) - data.x[0] + 2 * dx, dh: data.rows.at(-1) - data.rows[0] + 2 * dy, color_mapper: mapper });
    const border = figure.line({ x: F("x"), y: F("y"), source: edges, line_width: 1.5, line_cap: "round" });
    const [px, py] = chart.map?.point.length ? [chart.map.point[0] * chart.x.factor, chart.map.point[1] * chart.rows.factor] : [];
    const marks = px === undefined ? [] : [5, 2].map((width) => figure.scatter({ x: [px], y: [py], marker: "cross", size: 13, line_width: width }));
    let bar = null;
    if (!map.kinds) {
      const ticks = map.isLog ? GS.roundTicks(...map.ends) : null;
      bar = new Bokeh.ColorBar({ color_mapper: mapper, width: 10, padding: 6, background_fill_color: null, title: chart.map ? null : chart.y.unit || null, title_text_font_style: "normal",
        ...(ticks && { ticker: new Bokeh.FixedTicker({ ticks: ticks.map(Math.log10) }), major_label_overrides: new Map(ticks.map((v) => [Math.log10(v), GS.short(v)])) }) });
      figure.add_layout(bar, "right");
    }
    const show = (slice) => {
      const { values, shape } = map.image(slice);
      source.data = { image: [Bokeh.require("core/util/ndarray").ndarray(values, { dtype: "float64", shape })] };
      edges.data = map.border(slice);
      for (const mark of marks) mark.visible = slice === chart.map.first;
    };
    const dress = ({ ink, paper }) => {
      if (map.kinds) mapper.palette = GS.kindColours(chart);
      border.glyph.line_color = ink;
      marks.forEach((mark, k) => { mark.glyph.line_color = k ? ink : paper; });
    };
    show(GS.sliceOf(chart));
    return { map, bar, show, dress, half: [dx, dy] };
  };

  GS.sliceOf = (chart) => (chart.map?.slices ? state.slice ?? chart.map.first : 0);
  // Both coordinates in the same unit are drawn with the same scale, within what is shown.
  GS.heatRange = ({ data, heat, chart, host }, box, place) => {
    const [dx, dy] = heat.half, whole = [[data.x[0] - dx, data.x.at(-1) + dx], [data.rows[0] - dy, data.rows.at(-1) + dy]], [x, y] = box || whole;
    if (chart.x.unit !== chart.rows.unit || chart.x.labels.length || !host) return [x, y];
    const { width, height } = place || { width: host.clientWidth - 130, height: host.clientHeight - 60 }, per = Math.max((x[1] - x[0]) / width, (y[1] - y[0]) / height);
    const about = ([a, b], pixels) => [(a + b - per * pixels) / 2, (a + b + per * pixels) / 2];
    return [about(x, width), about(y, height)];
  };

  // What the key of a map says: kinds that occur, and the marked point.
  GS.heatLegend = ({ chart, figure }) => {
    const { map } = figure.heat, colours = map.kinds ? GS.kindColours(chart) : [];
    const items = [...map.present].sort((a, b) => a - b).map((k) => element("li", {}, element("i", { class: "kind", style: `background:${colours[k]}` }), chart.map.classes[k]));
    if (chart.map?.slices) items.push(element("li", { class: "slice" }, `at ${chart.map.slices.name} ${GS.short(figure.data.slices[GS.sliceOf(chart)])} ${chart.map.slices.unit}`.trim()));
    if (chart.map?.pointName && GS.sliceOf(chart) === chart.map.first) items.push(element("li", {}, "+ ", chart.map.pointName));
    return items;
  };

  const keyOf = (chart) => (chart.map ? `map ${chart.x.values} ${chart.rows.values} ${chart.map.slices?.values}` : Symbol("own"));
  GS.heatKey = keyOf;
  const cellAt = ({ figure: { data, heat } }, x, y) => {
    const cell = [[data.x, x, heat.half[0]], [data.rows, y, heat.half[1]]].map(([values, v, half]) => Math.round((v - values[0]) / (2 * half)));
    return cell[0] >= 0 && cell[0] < data.x.length && cell[1] >= 0 && cell[1] < data.rows.length ? cell : null;
  };
  GS.heatGroup = (key, follow) => {
    const own = { box: null, cell: null, tables: null, loading: null };
    const group = {
      isTime: false, panels: [], region: () => null, cursor: () => null, range: () => null, box: () => own.box,
      // the numbers of all maps of these coordinates
      load: (panel) => (own.loading ??= Promise.all(page.charts.filter((c) => c === panel.chart || (c.kind === "heat" && keyOf(c) === key)).map(async (chart) => ({ chart, values: await GS.array(chart.series[0].values) }))).then((tables) => { own.tables = tables; })),
      zoom: (box) => {
        const [panel] = group.panels, whole = panel && GS.heatRange({ ...panel.figure, host: null }, null);
        const inside = box && box.map((ends, k) => { const [a, b] = [...ends].sort((p, q) => p - q), [low, high] = whole[k]; return [Math.max(a, low), Math.min(b, high)]; });
        own.box = !inside || inside.every(([a, b], k) => a <= whole[k][0] && b >= whole[k][1]) ? null : inside;
        group.panels.forEach(follow);
      },
      clear: () => { own.cell = null; group.zoom(null); group.panels.forEach((panel) => { panel.told.hidden = true; }); },
      tell: (panel, cell) => {
        own.cell = cell;
        for (const other of group.panels) if (other !== panel) other.told.hidden = true;
        panel.told.hidden = !cell || !own.tables;
        if (panel.told.hidden) return;
        const { chart, figure } = panel, { data } = figure, [i, j] = cell, slice = GS.sliceOf(chart), at = (slice * data.rows.length + j) * data.x.length + i;
        const where = [[chart.x, i, data.x], [chart.rows, j, data.rows], ...(chart.map?.slices ? [[chart.map.slices, slice, data.slices]] : [])];
        const place = where.map(([axis, k, values]) => (axis.labels.length ? axis.labels[k] : `${axis.name} ${GS.short(values[k])} ${axis.unit}`.trim())).join(", ");
        const lines = own.tables.map(({ chart: c, values }) => {
          const v = values[at];
          return c.map?.classes.length ? element("b", {}, c.map.classes[v]) : element("div", {}, `${c.title} ${GS.short(v * c.y.factor, c.y.digits)} ${c.y.unit}`.trim());
        });
        panel.told.replaceChildren(element("div", {}, place), ...lines);
        const { x_scale: X, y_scale: Y } = figure.view.frame, px = X.compute(data.x[i]), py = Y.compute(data.rows[j]), { clientWidth, clientHeight } = panel.plot;
        const left = px + 12 + panel.told.offsetWidth > clientWidth ? Math.max(px - 12 - panel.told.offsetWidth, 0) : px + 12;
        panel.told.style.transform = `translate(${left}px, ${Math.max(Math.min(py - 10, clientHeight - panel.told.offsetHeight), 0)}px)`;
      },
      mark: () => {},
      hover: (x, panel, y) => group.tell(panel, x === null ? null : cellAt(panel, x, y)),
      click: (x, panel, y) => group.tell(panel, cellAt(panel, x, y)),
      // arrows go from pose to pose; + and − zoom about it, 0 shows all
      key: ({ key: pressed }, panel) => {
        const { data } = panel.figure, [i, j] = own.cell ?? [data.x.length >> 1, data.rows.length >> 1];
        const [a, b] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[pressed] || [0, 0];
        if (a || b) group.tell(panel, [Math.min(Math.max(i + a, 0), data.x.length - 1), Math.min(Math.max(j + b, 0), data.rows.length - 1)]);
        else if (pressed === "+" || pressed === "-") group.about(panel, data.x[i], data.rows[j], pressed === "+" ? 0.5 : 2);
        else if (pressed === "0") group.zoom(null);
        else if ((pressed === "PageUp" || pressed === "PageDown") && panel.chart.map?.slices) toSlice(GS.sliceOf(panel.chart) + (pressed === "PageUp" ? 1 : -1));
        else return false;
        return true;
      },
      about: (panel, x, y, factor) => {
        const { x_range: X, y_range: Y } = panel.figure.figure, ends = ({ start, end }, at) => [at + factor * (Math.min(start, end) - at), at + factor * (Math.max(start, end) - at)];
        group.zoom([ends(X, x), ends(Y, y)]);
      },
    };
    return group;
  };

  // The slice of a third coordinate that all maps show.
  const input = document.getElementById("slice");
  const toSlice = (k) => GS.set({ slice: Math.min(Math.max(Math.round(k), 0), Number(input.max)) });
  GS.sliceBar = async () => {
    if (!input) return;
    const chart = page.charts.find((each) => each.map?.slices), { slices } = chart.map, values = await GS.array(slices.values), output = document.querySelector("output[for=slice]");
    const place = () => {
      const k = GS.sliceOf(chart), text = `${GS.short(values[k] * slices.factor)} ${slices.unit}`.trim();
      input.value = k;
      input.setAttribute("aria-valuetext", text);
      output.textContent = text;
    };
    input.addEventListener("input", () => toSlice(Number(input.value)));
    place();
    GS.on("slice", place);
  };
})();
